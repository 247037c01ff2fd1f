"""What many tests call of the package, compiled for one size each: whatever is asked is padded in NumPy.

XLA takes seconds for each size of `pick`, `execute` and the planners' programs, which is most of what tests cost. So
robots and tables are arguments, scenes have `SLOTS` slots (`mask` says which are used), and results come back as NumPy
arrays of the size that was asked for.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from numpy.typing import ArrayLike

from basenet_jax.config import AlignedConfig, GridConfig, NavigationConfig, PickConfig, WorldConfig
from basenet_jax.planners import candidates
from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.robot import kinematics
from basenet_jax.robot.model import Robot
from basenet_jax.task import navigation, picking
from basenet_jax.task import plan as judge
from basenet_jax.task.clutter import obtainable
from basenet_jax.task.picking import Pick, Reason
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world import clearance, generate
from basenet_jax.world.boxes import Room
from basenet_jax.world.grasps import top_down
from basenet_jax.world.scene import BY_SLOT, Scene

SLOTS, BATCH = 6, 4
ROWS = 256  # of picks, poses and states of the arm
PAIRS = 2048  # of drives, which are cheap
POSES = 1120  # of candidates: those of the coarse grid
PAIRS_AT_ONCE = 512  # of them and objects, so that it takes a few rounds

GRID = GridConfig(step_m=0.2, turns=4)  # coarse
ALIGNED = AlignedConfig(step_m=0.4)  # sparse: 88 stops

_execute = jax.jit(judge.execute, static_argnames=("config", "arm_check"))
_pick = jax.jit(picking.pick, static_argnames=("config", "arm_check"))
_navigation_time = jax.jit(navigation.navigation_time, static_argnames="config")
_base_collides = jax.jit(clearance.base_collides)
_arm_collides = jax.jit(clearance.arm_collides)
_forward_kinematics = jax.jit(kinematics.forward_kinematics)
_check_candidates = candidates.check_candidates  # compiled as it is; planners of tests may use the one below instead
_draw_scene = jax.jit(generate.draw_scene, static_argnames=("slots", "config"))


def by_rows(function: Callable[..., Any], *trees: Any, size: int = ROWS) -> Any:
    """A compiled function of batches, given parts of one size; the last is filled up with rows from the beginning.

    Args:
        function: of the trees.
        trees: of arrays with one common first axis, at least one row.
        size: of the parts.
    """
    trees = jax.device_get(trees)
    count = len(jax.tree.leaves(trees)[0])
    rows = np.resize(np.arange(count), -(-count // size) * size)
    parts = [
        jax.device_get(function(*jax.tree.map(lambda x, some=some: np.asarray(x)[some], trees)))
        for some in np.split(rows, len(rows) // size)
    ]
    return jax.tree.map(lambda *x: np.concatenate(x)[:count], *parts)


def _flat(*arrays: ArrayLike) -> tuple[tuple[int, ...], list[np.ndarray]]:
    """Arrays of vectors broadcast to one batch, which is returned too, as rows."""
    batch = np.broadcast_shapes(*(np.shape(x)[:-1] for x in arrays))
    return batch, [np.broadcast_to(x, (*batch, np.shape(x)[-1])).reshape(-1, np.shape(x)[-1]) for x in arrays]


def _tables(room: Room, batch: tuple[int, ...]) -> Room:
    """One for each row."""
    own = room.boxes.low.ndim - 1
    return jax.tree.map(lambda x: np.broadcast_to(x, (*batch, *x.shape[own:])).reshape(-1, *x.shape[own:]), room)


def _shaped(tree: Any, batch: tuple[int, ...]) -> Any:
    return jax.tree.map(lambda x: x.reshape(*batch, *x.shape[1:]), tree)


def pick(
    robot: Robot,
    base_pose: ArrayLike,
    grasp: ArrayLike,
    room: Room,
    config: PickConfig = PickConfig(),
    **more: Any,
) -> Pick:
    """`picking.pick` of any batch, by one top-down grasp each: x, y, z, yaw of tool0 in W."""
    batch, (poses, grasps) = _flat(base_pose, grasp)
    call = functools.partial(_pick, jax.device_get(robot), config=config, **more)
    return _shaped(by_rows(call, poses, top_down(grasps, np), _tables(room, batch)), batch)


def navigation_time(
    robot: Robot, start: ArrayLike, goal: ArrayLike, room: Room, config: NavigationConfig = NavigationConfig()
) -> np.ndarray:
    """`navigation.navigation_time` of any batch."""
    batch, rows = _flat(start, goal)
    call = functools.partial(_navigation_time, jax.device_get(robot), config=config)
    return _shaped(by_rows(call, *rows, _tables(room, batch), size=PAIRS), batch)


def base_collides(robot: Robot, base_pose: ArrayLike, room: Room) -> np.ndarray:
    """`clearance.base_collides` of any batch."""
    batch, rows = _flat(base_pose)
    return _shaped(
        by_rows(functools.partial(_base_collides, jax.device_get(robot)), *rows, _tables(room, batch), size=PAIRS),
        batch,
    )


def arm_collides(robot: Robot, base_pose: ArrayLike, joints: ArrayLike, room: Room) -> np.ndarray:
    """`clearance.arm_collides` of any batch."""
    batch, rows = _flat(base_pose, joints)
    return _shaped(by_rows(functools.partial(_arm_collides, jax.device_get(robot)), *rows, _tables(room, batch)), batch)


def forward_kinematics(robot: Robot, joints: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """`kinematics.forward_kinematics` of any batch."""
    batch, rows = _flat(joints)
    return _shaped(by_rows(functools.partial(_forward_kinematics, jax.device_get(robot)), *rows), batch)


def execute(robot: Robot, scene: Scene, plan: Plan, world: WorldConfig = WorldConfig()) -> Outcome:
    """The judge, of one scene or any batch."""
    scene, plan = jax.device_get((scene, plan))
    if single := scene.mask.ndim == 1:
        scene, plan = jax.tree.map(lambda x: np.asarray(x)[None], (scene, plan))
    slots = scene.mask.shape[1]
    call = functools.partial(_execute, jax.device_get(robot), config=world)
    outcome = by_rows(call, with_slots(scene, max(slots, SLOTS)), _with_steps(plan, max(slots, SLOTS)), size=BATCH)
    return jax.tree.map(lambda x: x[0, :slots] if single else x[:, :slots], outcome)


def with_slots(scene: Scene, slots: int) -> Scene:
    """Scenes with more or fewer slots; those left out must be empty, those added are, with numbers that make sense."""
    scene = jax.device_get(scene)
    assert not np.any(scene.mask[..., slots:]), "slots in use can't be left out"
    which = np.minimum(np.arange(slots), scene.mask.shape[-1] - 1)
    axis = scene.mask.ndim - 1
    own = {name: getattr(scene, name) for name in BY_SLOT}
    fields = jax.tree.map(lambda x: np.take(x, which, axis), own)
    used = scene.mask[..., which] & (np.arange(slots) < scene.mask.shape[-1])
    return dataclasses.replace(scene, **fields | {"mask": used})


def _with_steps(plan: Plan, slots: int) -> Plan:
    missing = [(0, 0), (0, slots - plan.served.shape[1])]
    return dataclasses.replace(
        plan,
        object_index=np.pad(plan.object_index, missing, constant_values=-1),
        base_pose=np.pad(plan.base_pose, [*missing, (0, 0)], mode="edge"),
        served=np.pad(plan.served, missing),
        reason=np.pad(plan.reason, missing),
    )


def draw_scene(seed: int, count: int, room: Room, slots: int = SLOTS) -> Scene:
    """A random scene of so many objects in so many slots, on the host; drawn in `SLOTS` where they are enough."""
    scene, placed = jax.device_get(_draw_scene(jax.random.key(seed), count, room, slots=max(SLOTS, count)))
    assert placed
    return with_slots(scene, slots)


def check_candidates(
    robot: Robot,
    scene: Scene,
    base_pose: ArrayLike,
    world: WorldConfig = WorldConfig(),
    *,
    pairs_at_once: int = PAIRS_AT_ONCE,
) -> Candidates:
    """`candidates.check_candidates` of any poses, always in rounds of `PAIRS_AT_ONCE`."""
    del pairs_at_once
    poses = np.asarray(base_pose, np.float32)
    count, slots = len(poses), scene.mask.shape[0]
    if not count:
        return jax.device_get(_check_candidates(robot, scene, poses, world=world))
    wide = with_slots(scene, max(SLOTS, slots))
    parts = [
        jax.device_get(_check_candidates(robot, wide, part, world=world, pairs_at_once=PAIRS_AT_ONCE))
        for part in np.split(np.resize(poses, (-(-count // POSES) * POSES, 3)), -(-count // POSES))
    ]
    serves, time, clutter = (
        jax.tree.map(lambda *each: np.concatenate(each)[:count, :slots], *(getattr(x, name) for x in parts))
        for name in ("serves", "pick_time", "clutter")
    )
    if clutter is not None:  # what is in the way at one part's poses may be had at another's
        time = clutter.times_among(~obtainable(clutter, np.ones(count, bool), np), np)
        serves = np.isfinite(time)
    reason = np.where(serves.any(axis=0), Reason.NONE, np.max([part.reason[:slots] for part in parts], axis=0))
    return dataclasses.replace(parts[0], base_pose=poses, serves=serves, pick_time=time, reason=reason, clutter=clutter)


def make_setup(robot: Robot, **changes: Any) -> PlannerSetup:
    """What the tests' planners are made for: the coarse grid."""
    return PlannerSetup(robot=jax.device_put(robot), **{"grid": GRID, **changes})
