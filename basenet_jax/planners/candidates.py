"""Base poses that planners choose from, and which objects can be picked from each."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from basenet_jax.config import GridConfig, PickConfig, WorldConfig
from basenet_jax.robot.kinematics import reach_sphere
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason, pick
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.clearance import base_collides
from basenet_jax.world.scene import Scene, Table

PAIRS_AT_ONCE = 12_288  # of pose and object, checked in one round: all that are near in a scene of ten objects
REACH_MARGIN = 0.005  # m: covers a converged solution's position error and rounding


_collides = jax.jit(base_collides)


@struct.dataclass
class Candidates:
    """K base poses and the M objects of a scene."""

    base_pose: Float[Array, "K 3"]  # (x, y, heading) in W
    serves: Bool[Array, "K M"]  # whether the object can be picked from the pose (by the map: is thought to be)
    pick_time: Float[Array, "K M"]  # s; infinite where it can't; 0 where it can but is not computed
    reason: Int[Array, " M"]  # a `Reason`: for an object that no pose serves, the rule reached farthest


def grid_poses(
    robot: Robot, table: Table, grid: GridConfig = GridConfig(), config: PickConfig = PickConfig()
) -> Float[np.ndarray, "K 3"]:
    """All poses of the planning grid, (x, y, heading in (-pi, pi]) in W, that don't collide with the table (rule 1)."""
    counts = [math.floor(half / grid.step_m + 1e-9) for half in grid.half_size_m]
    x, y = (np.arange(-count, count + 1) * grid.step_m for count in counts)
    turn = np.arange(grid.turns)
    heading = np.where(turn > grid.turns // 2, turn - grid.turns, turn) * (2 * np.pi / grid.turns)
    poses = np.stack(np.meshgrid(x, y, heading, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
    collides = _collides(robot, poses, table, config.base_clearance_m, config.touching_m)
    return poses[~np.asarray(collides)]


@jax.jit(static_argnames=("world", "pairs_at_once"))
def check_candidates(
    robot: Robot,
    scene: Scene,
    base_pose: Float[ArrayLike, "K 3"],
    world: WorldConfig = WorldConfig(),
    *,
    pairs_at_once: int = PAIRS_AT_ONCE,
) -> Candidates:
    """Validates and costs all pairs of pose and object by `pick`.

    Only pairs within the arm's reach, some 15 % on the paper's grid, are looked at in full.

    Args:
        robot: the robot.
        scene: unbatched.
        base_pose: that don't collide with the table (others are sorted out all the same).
        world: of the picks.
        pairs_at_once: checked in one round; one round for all that are near is fastest.
    """
    poses, grasps = jnp.asarray(base_pose), scene.grasps
    near = within_reach(robot, poses[:, None], grasps) & scene.mask
    pairs = near.size
    if not pairs:
        unserved = jnp.full(len(grasps), int(Reason.BASE_COLLIDES), jnp.int32)
        return Candidates(poses, near, jnp.zeros(near.shape), unserved)
    at_once = min(pairs_at_once, pairs)
    (index,) = jnp.nonzero(near.ravel(), size=pairs, fill_value=pairs)
    index = jnp.pad(index, (0, -pairs % at_once), constant_values=pairs)  # no pair, dropped when written

    def check(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        start, time, reason = state
        own = jax.lax.dynamic_slice(index, (start,), (at_once,))
        pose, slot = jnp.divmod(jnp.minimum(own, pairs - 1), len(grasps))
        picks = pick(robot, poses[pose], grasps[slot], scene.table, world.pick)
        time = time.at[own].set(jnp.where(picks.feasible, picks.time, jnp.inf), mode="drop")
        return start + at_once, time, reason.at[own].set(picks.reason, mode="drop")

    nothing = (jnp.array(0), jnp.full(pairs, jnp.inf), jnp.full(pairs, int(Reason.OUT_OF_REACH), jnp.int32))
    _, time, reason = jax.lax.while_loop(lambda state: state[0] < jnp.sum(near), check, nothing)
    time, reason = time.reshape(near.shape), reason.reshape(near.shape)
    serves = jnp.isfinite(time)
    return Candidates(
        base_pose=poses,
        serves=serves,
        pick_time=time,
        reason=jnp.where(jnp.any(serves, axis=0), Reason.NONE, jnp.max(reason, axis=0)),
    )


def join(first: Candidates, second: Candidates) -> Candidates:
    """The candidates of both, for one scene."""
    poses, serves, pick_time = (
        jnp.concatenate([getattr(each, name) for each in (first, second)])
        for name in ("base_pose", "serves", "pick_time")
    )
    farthest = jnp.maximum(first.reason, second.reason)
    return Candidates(poses, serves, pick_time, jnp.where(jnp.any(serves, axis=0), Reason.NONE, farthest))


def within_reach(
    robot: Robot, base_pose: Float[Array, "*batch 3"], grasp: Float[Array, "*batch 4"]
) -> Bool[Array, "*batch"]:
    """Whether a grasp is inside the sphere that the arm can't leave: necessary for a pick, cheap to know."""
    center, radius = reach_sphere(robot)
    in_base = robot.mount_position + robot.mount_rotation @ center
    sine, cosine = sin_cos(base_pose[..., 2])
    x = base_pose[..., 0] + cosine * in_base[0] - sine * in_base[1]
    y = base_pose[..., 1] + sine * in_base[0] + cosine * in_base[1]
    square = (grasp[..., 0] - x) ** 2 + (grasp[..., 1] - y) ** 2 + (grasp[..., 2] - in_base[2]) ** 2
    return square <= (radius + REACH_MARGIN) ** 2
