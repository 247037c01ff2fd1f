"""What is made once for a robot and a room, and asked often: stops, and the drives between them."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float, Int

from basenet_jax import struct
from basenet_jax.compilation import Stored
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import Drives, Ends, Goals


@struct.dataclass
class PreparedWorld:
    """K stops in a room, the same for all scenes in it."""

    drives: Drives
    poses: Float[Array, "K 3"]  # (x, y, heading) in W
    ends: Ends  # of the poses
    goals: Goals
    known: Float[Array, "K K"] | None  # s, from stop to stop; None: too many, so that planners ask for what they need

    @property
    def drive(self) -> Float[Array, "K K"]:
        """Times (s) of drives from stop to stop; infinite where there is no way."""
        assert self.known is not None
        return self.known

    def first_drives(self, robot: Robot, start: Float[Array, "B 3"]) -> Float[Array, "B K"]:
        """Times (s) of drives from some poses, such as where the robot starts, to all stops."""
        return self.drives.times(robot, self.drives.ends(robot, start), self.goals)

    def departures(
        self, robot: Robot, start: Float[Array, "3"], first_drive: Float[Array, " K"] | None = None
    ) -> Callable[[Int[Array, ""]], Float[Array, " K"]]:
        """What times (s) drives to all stops take from a stop, or, if its number is -1, from where the robot starts.

        Args:
            robot: its base counts.
            start: where it starts, (x, y, heading) in W.
            first_drive: those from there, if they are known.
        """
        if self.known is None:
            begin = self.drives.ends(robot, start[None])

            def ask(stop: Array) -> Array:
                here = jax.tree.map(lambda own, each: jnp.where(stop < 0, own, each[stop][None]), begin, self.ends)
                return self.drives.times(robot, here, self.goals)[0]

            return ask
        first = self.first_drives(robot, start[None])[0] if first_drive is None else first_drive
        return lambda stop: jnp.where(stop < 0, first, self.drive[stop])


def prepare_world(
    robot: Robot, drives: Drives, poses: Float[ArrayLike, "K 3"], *, all_pairs: bool = True
) -> PreparedWorld:
    """Prepares stops, on the host.

    Args:
        robot: its base counts.
        drives: of the room.
        poses: of the stops, (x, y, heading) in W.
        all_pairs: whether to compute the drives between all of them now.
    """
    stops = jnp.asarray(poses)
    ends, goals = drives.goals(robot, stops)
    if not all_pairs:
        return PreparedWorld(drives, stops, ends, ends, None)
    goals = jax.device_put(goals)
    return PreparedWorld(drives, stops, ends, goals, jnp.asarray(drives.between(robot, goals)))


def join_worlds(first: PreparedWorld, second: PreparedWorld) -> PreparedWorld:
    """The stops of both, in one room."""
    poses, ends = jax.tree.map(
        lambda a, b: jnp.concatenate([a, b]), (first.poses, first.ends), (second.poses, second.ends)
    )
    return PreparedWorld(first.drives, poses, ends, ends, None)


@Stored
def compiled_first_drives(robot: Robot, prepared: PreparedWorld, start: Float[Array, "3"]) -> Float[Array, " K"]:
    """`PreparedWorld.first_drives` of one pose, compiled."""
    return prepared.first_drives(robot, start[None])[0]
