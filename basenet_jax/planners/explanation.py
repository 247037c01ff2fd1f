"""Why objects can or can't be picked: all base poses of the grid, counted by the rule that each fails."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from basenet_jax.config import PickConfig
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason, pick
from basenet_jax.world.boxes import Room
from basenet_jax.world.grasps import Grasps
from basenet_jax.world.scene import Scene


def count_reasons(setup: PlannerSetup, scene: Scene) -> Int[np.ndarray, "M reasons"]:
    """By slot and `Reason` (`NONE`: can be picked), the number of candidate base poses; empty slots count nothing.

    The candidates are the grid's poses clear of the table, so no pose counts as `BASE_COLLIDES`.

    Args:
        setup: with the scene's table.
        scene: unbatched.
    """
    poses = jnp.asarray(setup.grid_poses)
    counts = np.zeros((scene.mask.shape[0], len(Reason)), int)
    for slot in np.flatnonzero(np.asarray(scene.mask)):  # one by one: the same program for any number of objects
        counts[slot] = _count(setup.robot, poses, scene.grasps[slot], scene.room, setup.world.pick)
    return counts


@jax.jit(static_argnames="config")
def _count(
    robot: Robot, base_pose: Float[Array, "K 3"], grasps: Grasps, room: Room, config: PickConfig
) -> Int[Array, " reasons"]:
    return jnp.bincount(pick(robot, base_pose, grasps, room, config).reason, length=len(Reason))
