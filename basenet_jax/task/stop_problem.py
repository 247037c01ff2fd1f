"""A scene as a choice of stops: what every planner of sequences, and the stop policy, consumes."""

from typing import Any

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.task.clutter import Clutter, obtainable
from basenet_jax.task.picking import Reason


@struct.dataclass
class StopProblem:
    """K stops in a room and the M objects of a scene there, or of a batch of scenes. Times in s.

    What a stop is to an object has the shape of `pick_time`. Nothing that an object without a place in `mask` holds
    matters.
    """

    poses: Float[Array, "K 3"]  # (x, y, heading) in W
    pick_time: Float[Array, "*batch K M"]  # infinite where the stop doesn't serve the object; see `times_among`
    first_drive: Float[Array, "*batch K"]  # from the robot's start; infinite where there is no way
    drive: Float[Array, "K K"]  # from stop to stop; 0 for staying
    mask: Bool[Array, "*batch M"]  # objects that can be had: a stop that can be driven to serves them
    reason: Int[Array, "*batch M"]  # a `Reason`: why an object can't be; NONE for the others, and for empty slots
    clutter: Clutter | None = None  # where objects are in each other's way; `pick_time` is with all others gone

    def times_among(self, standing: Bool[ArrayLike, "*batch M"]) -> Float[Array, "*batch K M"]:
        """Pick times (s) while these objects stand; infinite where the stop can't serve the object yet."""
        return self.pick_time if self.clutter is None else self.clutter.times_among(standing)


_EACH: Any = 0
_SHARED: Any = None
# Of a batch, for `jax.vmap`: what all of its scenes share, and the axis of what each has.
BATCH_AXES = StopProblem(
    poses=_SHARED, pick_time=_EACH, first_drive=_EACH, drive=_SHARED, mask=_EACH, reason=_EACH, clutter=_EACH
)


def make_problem(
    poses: Float[ArrayLike, "K 3"],
    drive: Float[ArrayLike, "K K"],
    pick_time: Float[ArrayLike, "*batch K M"],
    first_drive: Float[ArrayLike, "*batch K"],
    mask: Bool[ArrayLike, "*batch M"],
    reason: Int[ArrayLike, "*batch M"] = Reason.OUT_OF_REACH,
    numpy: Any = jnp,
    *,
    clutter: Clutter | None = None,
) -> StopProblem:
    """The problem of one scene or a batch; objects that no stop serves, or none that can be driven to, are left out.

    Args:
        poses: of the stops, (x, y, heading) in W.
        drive: from stop to stop (s).
        pick_time: s; infinite where the stop doesn't serve the object.
        first_drive: from the robot's start (s).
        mask: which objects there are.
        reason: why no stop serves an object.
        numpy: the module that computes it: `jax.numpy`, or NumPy on the host.
        clutter: the ways to pick, where objects are in each other's way; `pick_time` is then with all others gone.
    """
    there, reachable = numpy.asarray(mask), numpy.isfinite(first_drive)
    serves = numpy.isfinite(pick_time)
    served = reached = there & numpy.any(serves & reachable[..., None], axis=-2)
    if clutter is not None:
        served = there & obtainable(clutter, reachable, numpy)
        clutter = clutter.without(there & ~served, numpy)
        pick_time = numpy.min(clutter.time, axis=-1)
    unreachable = numpy.where(numpy.any(serves, axis=-2), int(Reason.UNREACHABLE), reason)
    lost = numpy.where(reached, int(Reason.OBJECT_IN_THE_WAY), unreachable)
    why = numpy.where(served | ~there, int(Reason.NONE), lost)
    fields: tuple[Any, ...] = (poses, pick_time, first_drive, drive, served, why, clutter)
    return StopProblem(*fields)
