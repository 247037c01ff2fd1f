"""The state of a training as the arrays that Orbax stores, and back, bit by bit."""

import logging
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import orbax.checkpoint as ocp


class Leaf(msgspec.Struct, frozen=True):
    """What one leaf of a state is."""

    path: str
    dtype: str
    shape: tuple[int, ...]
    weak: bool  # a weakly typed array promotes differently: restored otherwise, the program would be another
    key: str | None  # the generator of typed PRNG keys, which are stored as their uint32 data

    @property
    def looks(self) -> str:
        """What must agree between what is stored and what is expected."""
        return f"{self.path}: {self.dtype}{list(self.shape)}"


def describe(tree: Any) -> list[Leaf]:
    """What the leaves of a pytree are; of typed keys in an abstract one, the generator stays unknown."""
    leaves = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        array = leaf if isinstance(leaf, jax.ShapeDtypeStruct) else jnp.asarray(leaf)
        key = str(jax.random.key_impl(array)) if isinstance(array, jax.Array) and _is_key(array) else None
        name = jax.tree_util.keystr(path, simple=True, separator="/")
        leaves.append(Leaf(name, str(array.dtype), array.shape, bool(getattr(array, "weak_type", False)), key))
    return leaves


def misfit(found: list[Leaf], wanted: list[Leaf]) -> str | None:
    """Where a state differs from what is expected, as words to follow its name; weak types may differ."""
    found_looks, wanted_looks = [leaf.looks for leaf in found], [leaf.looks for leaf in wanted]
    if found_looks == wanted_looks:
        return None
    surplus = next((looks for looks in found_looks if looks not in wanted_looks), "nothing more")
    missing = next((looks for looks in wanted_looks if looks not in found_looks), "nothing more")
    return f"is of another state (found {surplus}, needs {missing})"


def write_arrays(folder: Path, leaves: list[jax.Array]) -> None:
    """Writes the leaves as NumPy arrays, without the empty ones, which Orbax refuses.

    Raises:
        OSError, RuntimeError, ValueError: Orbax can't write it; which of them depends on what failed.
    """
    data = (jax.random.key_data(leaf) if _is_key(leaf) else leaf for leaf in leaves)
    arrays = {f"{index:05d}": np.asarray(leaf) for index, leaf in enumerate(data) if leaf.size}
    absl = logging.getLogger("absl")
    level = absl.level
    absl.setLevel(logging.CRITICAL)  # a full disk is told in one line, not in Orbax's three tracebacks
    try:
        with ocp.Checkpointer(ocp.PyTreeCheckpointHandler()) as checkpointer:
            checkpointer.save(folder.absolute(), args=ocp.args.PyTreeSave(arrays))
    finally:
        absl.setLevel(level)


def read_state(folder: Path, leaves: list[Leaf], like: Any) -> Any:
    """Reads a state that was written with these leaves into the structure of `like`.

    Raises:
        OSError, ValueError: it can't be read.
    """
    with ocp.Checkpointer(ocp.PyTreeCheckpointHandler()) as checkpointer:
        arrays = checkpointer.restore(folder.absolute())
    like_leaves, structure = jax.tree.flatten(like)
    restored = (
        _rebuild(leaf, arrays.get(f"{index:05d}"), like_leaf)
        for index, (leaf, like_leaf) in enumerate(zip(leaves, like_leaves, strict=True))
    )
    return jax.tree.unflatten(structure, restored)


def _rebuild(leaf: Leaf, data: np.ndarray | None, like: Any) -> jax.Array:
    if data is None:
        value = jnp.zeros(leaf.shape, leaf.dtype)
    elif leaf.key is not None:
        value = jax.random.wrap_key_data(jnp.array(data), impl=leaf.key)
    else:
        value = jnp.array(data)  # a copy: the program may give its buffer away
    if leaf.weak:
        blank = jnp.broadcast_to(jnp.asarray(value.dtype.type(0).item()), leaf.shape)  # of a Python number: weak
        if blank.dtype == value.dtype:
            value = blank.at[...].set(value)  # keeps the weak type of what is written to
    return jax.device_put(value, like.sharding) if getattr(like, "committed", False) else value


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
