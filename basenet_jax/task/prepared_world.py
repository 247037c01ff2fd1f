"""What is made once for a robot and a room, and asked often: stops, and the drives between them."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from basenet_jax import struct
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import Drives


@struct.dataclass
class PreparedWorld:
    """K stops in a room, the same for all scenes in it."""

    drives: Drives
    poses: Float[Array, "K 3"]  # (x, y, heading) in W
    ends: Any  # of the poses, see `task.drives`
    drive: Float[Array, "K K"]  # s, from stop to stop; infinite where there is no way

    def first_drives(self, robot: Robot, start: Float[Array, "B 3"]) -> Float[Array, "B K"]:
        """Times (s) of drives from some poses, such as where the robot starts, to all stops."""
        return self.drives.times(robot, self.drives.ends(robot, start), self.ends)


def prepare_world(robot: Robot, drives: Drives, poses: Float[ArrayLike, "K 3"]) -> PreparedWorld:
    """Prepares stops, on the host.

    Args:
        robot: its base counts.
        drives: of the room.
        poses: of the stops, (x, y, heading) in W.
    """
    stops = jnp.asarray(poses)
    return PreparedWorld(drives, stops, _ends(drives, robot, stops), jnp.asarray(drives.matrix(robot, stops, stops)))


@jax.jit
def _ends(drives: Drives, robot: Robot, poses: Array) -> Any:
    return drives.ends(robot, poses)
