"""Base poses that planners choose from, and which objects can be picked from each."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Bool, Float, Int

from basenet_jax.config import GridConfig, PickConfig, WorldConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason, pick
from basenet_jax.world.clearance import base_collides
from basenet_jax.world.scene import Scene, Table


@struct.dataclass
class Candidates:
    """K base poses and the M objects of a scene."""

    base_pose: Float[np.ndarray, "K 3"]  # (x, y, heading) in W
    serves: Bool[np.ndarray, "K M"]  # whether the object can be picked from the pose (by the map: is thought to be)
    pick_time: Float[np.ndarray, "K M"]  # s; infinite where it can't; 0 where it can but is not computed
    reason: Int[np.ndarray, " M"]  # a `Reason`: for an object that no pose serves, the rule reached farthest


def grid_poses(
    robot: Robot, table: Table, grid: GridConfig = GridConfig(), config: PickConfig = PickConfig()
) -> Float[np.ndarray, "K 3"]:
    """All poses of the planning grid, (x, y, heading in (-pi, pi]) in W, that don't collide with the table (rule 1)."""
    counts = [math.floor(half / grid.step_m + 1e-9) for half in grid.half_size_m]
    x, y = (np.arange(-count, count + 1) * grid.step_m for count in counts)
    turn = np.arange(grid.turns)
    heading = np.where(turn > grid.turns // 2, turn - grid.turns, turn) * (2 * np.pi / grid.turns)
    poses = np.stack(np.meshgrid(x, y, heading, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
    collides = base_collides(robot, jnp.asarray(poses), table, config.base_clearance_m, config.touching_m)
    return poses[~np.asarray(collides)]


@partial(jax.jit, static_argnames="world")
def check_candidates(
    robot: Robot, scene: Scene, base_pose: Float[np.ndarray, "K 3"], world: WorldConfig = WorldConfig()
) -> Candidates:
    """Validates and costs all pairs of pose and object by `pick`."""
    picks = pick(robot, base_pose[:, None], scene.grasps, scene.table, world.pick)
    serves = picks.feasible & scene.mask
    return Candidates(
        base_pose=base_pose,
        serves=serves,
        pick_time=jnp.where(serves, picks.time, jnp.inf),
        reason=jnp.where(jnp.any(serves, axis=0), Reason.NONE, jnp.max(picks.reason, axis=0)),
    )
