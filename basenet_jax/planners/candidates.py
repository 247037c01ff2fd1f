"""Base poses that planners choose from, and which objects can be picked from each."""

import math
from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds, struct
from basenet_jax.compilation import Stored
from basenet_jax.config import GridConfig, PickConfig, WorldConfig
from basenet_jax.robot.kinematics import reach_sphere
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason, estimate_pick_time, pick
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import compiled_base_collides
from basenet_jax.world.grasps import Grasps
from basenet_jax.world.scene import Scene

PAIRS_AT_ONCE = 9_216  # of pose and object, checked in one round: all that are near in most scenes of ten objects
REACH_MARGIN = 0.005  # m: covers a converged solution's position error and rounding


@struct.dataclass
class Candidates:
    """K base poses and the M objects of a scene."""

    base_pose: Float[Array, "K 3"]  # (x, y, heading) in W
    serves: Bool[Array, "K M"]  # whether the object can be picked from the pose (by the map: is thought to be)
    pick_time: Float[Array, "K M"]  # s; infinite where it can't; 0 where it can but is not computed
    reason: Int[Array, " M"]  # a `Reason`: for an object that no pose serves, the rule reached farthest
    first_drive: Float[Array, " K"] | None = None  # s, from the robot's start, where `only_reachable` looked at it


def grid_poses(
    robot: Robot, room: Room, grid: GridConfig = GridConfig(), config: PickConfig = PickConfig()
) -> Float[np.ndarray, "K 3"]:
    """All poses of the planning grid, (x, y, heading in (-pi, pi]) in W, that collide with nothing (rule 1)."""
    places = _round_one_table(grid) if room.boxes.low.shape[-1] == 1 else _near_surfaces(room, grid)
    turn = np.arange(grid.turns)
    heading = np.where(turn > grid.turns // 2, turn - grid.turns, turn) * (2 * np.pi / grid.turns)
    poses = np.column_stack([np.repeat(places, grid.turns, axis=0), np.tile(heading, len(places))]).astype(np.float32)
    collides = compiled_base_collides(robot, poses, room, config.base_clearance_m, config.touching_m)
    return poses[~np.asarray(collides)]


def _round_one_table(grid: GridConfig) -> Float[np.ndarray, "P 2"]:
    counts = [math.floor(half / grid.step_m + 1e-9) for half in grid.half_size_m]
    sides = (np.arange(-count, count + 1) * grid.step_m for count in counts)
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2)


def _near_surfaces(room: Room, grid: GridConfig) -> Float[np.ndarray, "P 2"]:
    """All places of the grid that are near to a surface of a room."""
    boxes = jax.tree.map(np.asarray, jax.device_get(room.boxes))
    pose, half = (x[boxes.bears_objects].astype(float) for x in (boxes.pose, boxes.half_size))
    reach = np.hypot(*half.T)[:, None] + grid.reach_m
    low, high = np.min(pose[:, :2] - reach, axis=0), np.max(pose[:, :2] + reach, axis=0)
    first, last = np.ceil(low / grid.step_m), np.floor(high / grid.step_m)
    steps = (np.arange(a, b + 1) for a, b in zip(first, last, strict=True))
    places = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2) * grid.step_m
    sine, cosine = np.sin(pose[:, 2]), np.cos(pose[:, 2])
    x, y = (places[:, None] - pose[:, :2]).transpose(2, 0, 1)
    beyond = np.stack([np.abs(cosine * x + sine * y), np.abs(cosine * y - sine * x)], axis=-1) - half
    return places[np.any(np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) <= grid.reach_m, axis=1)]


@partial(Stored, static=("world", "pairs_at_once"))
def check_candidates(
    robot: Robot,
    scene: Scene,
    base_pose: Float[ArrayLike, "K 3"],
    *,
    world: WorldConfig = WorldConfig(),
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
    near = may_reach(robot, poses[:, None], grasps) & scene.mask
    slots = len(scene.mask)
    if not near.size:
        unserved = jnp.full(slots, int(Reason.BASE_COLLIDES), jnp.int32)
        return Candidates(poses, near, jnp.zeros(near.shape), unserved)

    def check(pair: Int[Array, " P"]) -> tuple[Array, Array]:
        pose, slot = jnp.divmod(pair, slots)
        picks = pick(robot, poses[pose], grasps[slot], scene.room, world.pick)
        return jnp.where(picks.feasible, picks.time, jnp.inf), picks.reason

    nothing = (jnp.full(near.shape, jnp.inf), jnp.full(near.shape, int(Reason.OUT_OF_REACH), jnp.int32))
    time, reason = _where(near, check, nothing, pairs_at_once)
    serves = jnp.isfinite(time)
    return Candidates(
        base_pose=poses,
        serves=serves,
        pick_time=time,
        reason=jnp.where(jnp.any(serves, axis=0), Reason.NONE, jnp.max(reason, axis=0)),
    )


@jax.jit
def only_reachable(candidates: Candidates, first_drive: Float[Array, " K"]) -> Candidates:
    """The candidates without service from poses to which there is no way from the robot's start.

    Args:
        candidates: of a scene.
        first_drive: from where its robot starts to their poses (s).
    """
    reachable = jnp.isfinite(first_drive)[:, None]
    serves = candidates.serves & reachable
    lost = jnp.any(candidates.serves, axis=0) & ~jnp.any(serves, axis=0)
    return Candidates(
        base_pose=candidates.base_pose,
        serves=serves,
        pick_time=jnp.where(reachable, candidates.pick_time, jnp.inf),
        reason=jnp.where(lost, Reason.UNREACHABLE, candidates.reason),
        first_drive=first_drive,
    )


def estimate_times(
    robot: Robot,
    base_pose: Float[Array, "K 3"],
    grasps: Grasps,
    mask: Bool[Array, "*batch M"],
    config: PickConfig = PickConfig(),
    *,
    pairs_at_once: int = PAIRS_AT_ONCE,
) -> Float[Array, "*batch K M"]:
    """Estimated pick times (s) of all pairs of pose and object, for scenes that share the poses; infinite: none.

    Args:
        robot: the robot.
        base_pose: that don't collide with the table.
        grasps: of the objects, in W, "*batch M G".
        mask: which of them there are.
        config: of the picks.
        pairs_at_once: estimated in one round.
    """
    near = may_reach(robot, base_pose[:, None], jax.tree.map(lambda x: jnp.expand_dims(x, mask.ndim - 1), grasps))
    near &= mask[..., None, :]
    poses, slots = near.shape[-2:]
    flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[mask.ndim :]), grasps)

    def estimate(pair: Int[Array, " P"]) -> tuple[Array]:
        row, slot = jnp.divmod(pair, slots)
        scene, pose = jnp.divmod(row, poses)
        return (estimate_pick_time(robot, base_pose[pose], flat[scene * slots + slot], config),)

    return _where(near, estimate, (jnp.full(near.shape, jnp.inf),), pairs_at_once)[0]


def _where(
    chosen: Bool[Array, "..."],
    compute: Callable[[Int[Array, " P"]], tuple[Array, ...]],
    otherwise: tuple[Array, ...],
    at_once: int,
) -> tuple[Array, ...]:
    """Arrays like `otherwise`, computed from their flat indices where chosen, so many in a round."""

    def fill(index: Array, arrays: tuple[Array, ...]) -> tuple[Array, ...]:
        values = compute(jnp.minimum(index, chosen.size - 1))
        return tuple(array.at[index].set(value, mode="drop") for array, value in zip(arrays, values, strict=True))

    flat = tuple(array.ravel() for array in otherwise)
    filled = rounds.over_chosen(chosen.ravel(), fill, flat, min(at_once, chosen.size))
    return tuple(array.reshape(chosen.shape) for array in filled)


def join(first: Candidates, second: Candidates) -> Candidates:
    """The candidates of both, for one scene."""
    poses, serves, pick_time = (
        jnp.concatenate([getattr(each, name) for each in (first, second)])
        for name in ("base_pose", "serves", "pick_time")
    )
    farthest = jnp.maximum(first.reason, second.reason)
    known = None
    if first.first_drive is not None and second.first_drive is not None:
        known = jnp.concatenate([first.first_drive, second.first_drive])
    return Candidates(poses, serves, pick_time, jnp.where(jnp.any(serves, axis=0), Reason.NONE, farthest), known)


def may_reach(robot: Robot, base_pose: Float[Array, "*batch 3"], grasps: Grasps) -> Bool[Array, "*batch"]:
    """Whether one of an object's grasps is `within_reach`."""
    inside = within_reach(robot, base_pose[..., None, :], grasps.pose[..., :3])
    return jnp.any(inside & grasps.there, axis=-1)


def within_reach(
    robot: Robot, base_pose: Float[Array, "*batch 3"], position: Float[Array, "*batch 3"]
) -> Bool[Array, "*batch"]:
    """Whether a position (m) of tool0 in W is inside the sphere that it can't leave: necessary, cheap to know."""
    center, radius = reach_sphere(robot)
    in_base = robot.mount_position + robot.mount_rotation @ center
    sine, cosine = sin_cos(base_pose[..., 2])
    x = base_pose[..., 0] + cosine * in_base[0] - sine * in_base[1]
    y = base_pose[..., 1] + sine * in_base[0] + cosine * in_base[1]
    square = (position[..., 0] - x) ** 2 + (position[..., 1] - y) ** 2 + (position[..., 2] - in_base[2]) ** 2
    return square <= (radius + REACH_MARGIN) ** 2
