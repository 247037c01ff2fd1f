"""How far from its mount an arm can grasp from above, for drawing its reach."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.config import PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task import arm_solutions
from basenet_jax.world.grasps import top_down

_STEP_M = 0.01
_FARTHEST_M = 2.5


def arm_reach(robot: Robot, height: float, config: PickConfig = PickConfig()) -> tuple[float, float] | None:
    """Least and greatest horizontal distance (m) between arm mount and a top-down grasp that inverse kinematics serves.

    None where it serves none at that height, which may be below the arm's lowest reach or above its highest. Distances
    are in steps of a centimetre, straight ahead of the mount; the arm turns about its mount, so other directions are
    alike but for joint limits.

    Args:
        robot: the robot.
        height: of tool0 above the floor at the grasp (m).
        config: of the pre-grasp, which is to be reached too.
    """
    distance = np.arange(_STEP_M, _FARTHEST_M, _STEP_M)
    reached = distance[np.asarray(_reached(robot, distance, height, config))]
    return (float(reached.min()), float(reached.max())) if len(reached) else None


@partial(jax.jit, static_argnames="config")
def _reached(robot: Robot, distance: Float[Array, " D"], height: Array, config: PickConfig) -> Bool[Array, " D"]:
    zero = jnp.zeros_like(distance)
    x, y = robot.mount_position[0] + distance, robot.mount_position[1] + zero
    grasps = top_down(jnp.stack([x, y, height + zero, zero], axis=-1))
    picks = arm_solutions.make_picks(jnp.zeros((len(distance), 3)), grasps)
    return jnp.any(jnp.isfinite(arm_solutions.solve(robot, picks, config).estimate), axis=0)
