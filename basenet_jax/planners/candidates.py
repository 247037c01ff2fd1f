"""Base poses that planners choose from, and which objects can be picked from each."""

import dataclasses
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
from basenet_jax.task.clutter import Clutter, as_bits, obtainable
from basenet_jax.task.gripper_blockers import gripper_blockers
from basenet_jax.task.picking import Reason, Rules, estimate_pick_time, pick, ways_to_pick
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import compiled_base_collides
from basenet_jax.world.grasps import Grasps
from basenet_jax.world.scene import Scene

PAIRS_AT_ONCE = 9_216  # of pose and object, checked in one round: all that are near in most scenes of ten objects
WAYS = 3  # kept for each pair where objects are in each other's way: the fastest, and the one that needs fewest gone
REACH_MARGIN = 0.005  # m: covers a converged solution's position error and rounding


@struct.dataclass
class Candidates:
    """K base poses and the M objects of a scene."""

    base_pose: Float[Array, "K 3"]  # (x, y, heading) in W
    serves: Bool[Array, "K M"]  # whether the object can be picked from the pose (by the map: is thought to be)
    pick_time: Float[Array, "K M"]  # s; infinite where it can't; 0 where it can but is not computed
    reason: Int[Array, " M"]  # a `Reason`: for an object that no pose serves, the rule reached farthest
    first_drive: Float[Array, " K"] | None = None  # s, from the robot's start, where `only_reachable` looked at it
    clutter: Clutter | None = (
        None  # where objects are in each other's way; the others' fields are with all gone that can
    )

    def rows(self, index: Int[np.ndarray, " P"]) -> "Candidates":
        """Some of the poses, of which each object that is served has one left."""
        own = (self.base_pose, self.serves, self.pick_time, self.first_drive, self.clutter)
        pose, serves, pick_time, first, clutter = jax.tree.map(lambda x: x[index], own)
        return Candidates(pose, serves, pick_time, self.reason, first, clutter)

    def times_among(self, standing: Bool[Array, " M"]) -> Float[Array, "K M"]:
        """Pick times (s) while these objects stand; infinite where the pose can't serve the object yet."""
        if self.clutter is not None:
            return self.clutter.times_among(standing)
        return jnp.where(self.serves, self.pick_time, jnp.inf)


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
    """Validates and costs all pairs of pose and object by `pick`, or where rule 5 holds by `ways_to_pick`.

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
    slots, objects = len(scene.mask), scene.object_boxes
    cluttered = Rules.of(world.pick, scene.room).object_in_the_way
    needed = gripper_blockers(robot, grasps, objects, world.pick)

    def check(pair: Int[Array, " P"]) -> tuple[Array, ...]:
        pose, slot = jnp.divmod(pair, slots)
        if not cluttered:
            picks = pick(robot, poses[pose], grasps[slot], scene.room, world.pick)
            return jnp.where(picks.feasible, picks.time, jnp.inf), picks.reason
        others = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(pair), *x.shape)), objects)
        own = slot[:, None] == jnp.arange(slots)
        others = dataclasses.replace(others, blocks_arm=others.blocks_arm & ~own)
        about = (robot, poses[pose], grasps[slot], scene.room, others, world.pick)
        ways = ways_to_pick(*about, ways=WAYS, needed=needed[slot] & ~own[:, None, None])
        return ways.time, ways.reason, as_bits(ways.blockers)

    reason = jnp.full(near.shape, int(Reason.OUT_OF_REACH), jnp.int32)
    times = jnp.full((*near.shape, WAYS) if cluttered else near.shape, jnp.inf)
    nothing: tuple[Array, ...] = (times, reason)
    if cluttered:
        nobody = as_bits(jnp.zeros(slots, bool))
        nothing = (*nothing, jnp.broadcast_to(nobody, (*times.shape, len(nobody))))
    if not near.size:
        unserved = jnp.full(slots, int(Reason.BASE_COLLIDES), jnp.int32)
        return Candidates(poses, near, jnp.zeros(near.shape), unserved, clutter=_as_clutter(nothing))
    checked = _where(near, check, nothing, pairs_at_once)
    clutter = _as_clutter(checked)
    time = checked[0] if clutter is None else _with_all_gone(clutter)
    return Candidates(
        base_pose=poses,
        serves=jnp.isfinite(time),
        pick_time=time,
        reason=_reason(jnp.max(checked[1], axis=0), time, clutter),
        clutter=clutter,
    )


def _as_clutter(checked: tuple[Array, ...]) -> Clutter | None:
    return Clutter(checked[0], checked[2]) if len(checked) > 2 else None


def _with_all_gone(clutter: Clutter) -> Float[Array, "K M"]:
    """Pick times (s) with all objects gone that any order of picks can have, from anywhere."""
    everywhere = jnp.ones(clutter.time.shape[0], bool)
    return clutter.times_among(~obtainable(clutter, everywhere))


def _reason(farthest: Int[Array, " M"], time: Float[Array, "K M"], clutter: Clutter | None) -> Int[Array, " M"]:
    """Of objects that no pose serves: the rule reached farthest, or what stays in the way of all ways to pick it."""
    if clutter is not None:
        has_way = jnp.any(jnp.isfinite(clutter.time), axis=(0, 2))
        farthest = jnp.where(has_way, int(Reason.OBJECT_IN_THE_WAY), farthest)
    return jnp.where(jnp.any(jnp.isfinite(time), axis=0), int(Reason.NONE), farthest)


@jax.jit
def only_reachable(candidates: Candidates, first_drive: Float[Array, " K"]) -> Candidates:
    """The candidates without service from poses to which there is no way from the robot's start.

    Args:
        candidates: of a scene.
        first_drive: from where its robot starts to their poses (s).
    """
    reachable = jnp.isfinite(first_drive)[:, None]
    clutter, time = candidates.clutter, jnp.where(reachable, candidates.pick_time, jnp.inf)
    lost = Reason.UNREACHABLE
    if clutter is not None:
        clutter = clutter.only(reachable)
        time = _with_all_gone(clutter)
        has_way = jnp.any(jnp.isfinite(clutter.time), axis=(0, 2))
        lost = jnp.where(has_way, int(Reason.OBJECT_IN_THE_WAY), int(Reason.UNREACHABLE))
    serves = candidates.serves & jnp.isfinite(time)
    all_lost = jnp.any(candidates.serves, axis=0) & ~jnp.any(serves, axis=0)
    return Candidates(
        base_pose=candidates.base_pose,
        serves=serves,
        pick_time=time,
        reason=jnp.where(all_lost, lost, candidates.reason),
        first_drive=first_drive,
        clutter=clutter,
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

    flat = tuple(array.reshape(chosen.size, *array.shape[chosen.ndim :]) for array in otherwise)
    filled = rounds.over_chosen(chosen.ravel(), fill, flat, min(at_once, chosen.size))
    return tuple(array.reshape(*chosen.shape, *array.shape[1:]) for array in filled)


def join(first: Candidates, second: Candidates) -> Candidates:
    """The candidates of both, for one scene."""
    poses, serves, pick_time, clutter = (
        jax.tree.map(lambda *both: jnp.concatenate(both), *(getattr(each, name) for each in (first, second)))
        for name in ("base_pose", "serves", "pick_time", "clutter")
    )
    if clutter is not None:  # what one can't have for something in the way, it may where the other takes that away
        pick_time = _with_all_gone(clutter)
        serves = jnp.isfinite(pick_time)
    farthest = jnp.maximum(first.reason, second.reason)
    known = None
    if first.first_drive is not None and second.first_drive is not None:
        known = jnp.concatenate([first.first_drive, second.first_drive])
    return Candidates(poses, serves, pick_time, _reason(farthest, pick_time, clutter), known, clutter)


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
