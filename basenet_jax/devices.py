"""Sharing the work of a batch out to several devices, by `jax.sharding` and `jax.shard_map`.

What is learned is kept on every device; the scenes, episodes or examples of a batch are shared out, each device taking
an equal number in a row. A program says with `split` and `apart` what belongs to a batch; on one device these do
nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

Tree = TypeVar("Tree")

_AXIS = "batch"


@dataclass(frozen=True)
class Devices:
    """The devices that a program runs on; hashable, so that it may be static under `jax.jit`."""

    mesh: Mesh | None = None  # one axis; None: wherever JAX puts it

    @property
    def count(self) -> int:
        """How many they are."""
        return 1 if self.mesh is None else self.mesh.size

    def split(self, batch: Tree, axis: int = 0) -> Tree:
        """Shares out a batch under jit; the compiler follows up what is computed from it, sums over it included.

        For programs of array operations. Where each device should go round a loop of its own, see `apart`.
        """
        return self._constrain(batch, _along(axis))

    def everywhere(self, tree: Tree) -> Tree:
        """Keeps whole copies on all devices, under jit."""
        return self._constrain(tree, P())

    def apart(
        self, function: Callable[..., Any], *, in_axes: Sequence[Any] = (0,), mean: bool = False
    ) -> Callable[..., Any]:
        """Every device calls a function with its part of the batch, without a word to the others.

        Args:
            function: of pytrees; what it closes over is seen by all devices.
            in_axes: for each argument the axis of the batch, or None for what all devices get alike; or a tree of them,
                as for `jax.vmap`.
            mean: the results are means over the batch, and so is what is returned; otherwise they are batches along
                their first axis, and are put together.

        Returns:
            A function of the same arguments, to be called under jit. The batch's size must be a multiple of `count`.
        """
        if self.mesh is None:
            return function

        def part(*arguments: Any) -> Any:
            result = function(*arguments)
            return jax.lax.pmean(result, _AXIS) if mean else result

        specs = jax.tree.map(
            lambda axis: P() if axis is None else _along(axis), tuple(in_axes), is_leaf=lambda axis: axis is None
        )
        # Loops begin with constants, which JAX would have marked one by one as differing between devices.
        return jax.shard_map(
            part, mesh=self.mesh, in_specs=specs, out_specs=P() if mean else _along(0), check_vma=False
        )

    def check(self, batches: dict[str, int]) -> None:
        """Refuses batches that can't be shared out equally.

        Raises:
            ValueError: one isn't a multiple of `count`; the message has its name.
        """
        for name, size in batches.items():
            if size % self.count:
                allowed = ", ".join(str(n) for n in range(1, self.count + 1) if size % n == 0)
                raise ValueError(
                    f"devices: found {self.count}, which don't divide {name} of {size}; up to there, {allowed} do"
                )

    def _constrain(self, tree: Tree, spec: P) -> Tree:
        if self.mesh is None:
            return tree
        return jax.lax.with_sharding_constraint(tree, NamedSharding(self.mesh, spec))


ONE_DEVICE = Devices()


def use_devices(count: int | None = None) -> Devices:
    """So many devices, the first ones of this process, or all of all processes.

    With `jax.distributed` several processes, on one machine or many, are one program: each of them runs the same calls,
    and "all" are the devices of all of them.

    Args:
        count: how many; by default all.

    Raises:
        ValueError: there aren't so many.
    """
    devices = jax.devices() if count is None else jax.local_devices()
    count = len(devices) if count is None else count
    if not 1 <= count <= len(devices):
        kind = devices[0].platform
        more = f"; XLA_FLAGS=--xla_force_host_platform_device_count={count} makes a CPU {count}"
        hint = more if kind == "cpu" and count > 1 else ""
        raise ValueError(f"devices: found {count}, allowed are 1 to {len(devices)}, all that JAX finds ({kind}){hint}")
    return ONE_DEVICE if count == 1 else Devices(Mesh(np.array(devices[:count]), (_AXIS,)))


def _along(axis: int) -> P:
    return P(*[None] * axis, _AXIS)
