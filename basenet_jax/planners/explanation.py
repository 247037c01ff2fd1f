"""Why objects can or can't be picked: base poses counted by the rule that each fails, and what stands in the way."""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.config import PickConfig
from basenet_jax.planners.candidates import WAYS, may_reach
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import DockedDrives
from basenet_jax.task.picking import Reason, Rules, Ways, pick, ways_to_pick
from basenet_jax.task.plan import Plan
from basenet_jax.world.boxes import Room
from basenet_jax.world.grasps import Grasps
from basenet_jax.world.scene import Scene

_ROUND_M = 3.0  # poses round an object are looked for so far from it, more than arms reach
_BUCKET = 512  # their number is rounded up to a multiple, so that few shapes are compiled


class InTheWay(NamedTuple):
    """What an object could be picked without."""

    names: tuple[str, ...]  # any one of them, or
    together: bool  # all of them


def count_reasons(setup: PlannerSetup, scene: Scene) -> Int[np.ndarray, "M reasons"]:
    """By slot and `Reason` (`NONE`: can be picked), the number of base poses; empty slots count nothing.

    In the paper's world of the grid's poses clear of the table, so no pose counts as `BASE_COLLIDES`. In rooms of those
    round each object, whatever stands there, within its reach; to those that count as `UNREACHABLE` no way leads.

    Args:
        setup: with the scene's room.
        scene: unbatched.
    """
    counts = np.zeros((scene.mask.shape[0], len(Reason)), int)
    for slot in np.flatnonzero(np.asarray(scene.mask)):  # one by one: the same program for any number of objects
        grasps = scene.grasps[slot]
        poses, there = _poses_round(setup, grasps)
        reason = np.asarray(_reasons(setup.robot, poses, grasps, scene.room, setup.world.pick))
        if isinstance(setup.drives, DockedDrives):
            drive = np.asarray(setup.drives.matrix(setup.robot, scene.robot_start[None], poses))[0]
            reason = np.where((reason == Reason.NONE) & ~np.isfinite(drive), int(Reason.UNREACHABLE), reason)
        counts[slot] = np.bincount(reason[there], minlength=len(Reason))
    return counts


def in_the_way(setup: PlannerSetup, scene: Scene, slot: int, box_names: Sequence[str]) -> InTheWay:
    """What keeps an object of a room from being picked, from any pose of the grid round it: tried without each thing.

    No names: it could not be picked in an empty room either.

    Args:
        setup: with the scene's room.
        scene: unbatched.
        slot: of the object.
        box_names: of the room's boxes, in their order; boxes of one name are one thing.
    """
    grasps = scene.grasps[slot]
    poses, there = _poses_round(setup, grasps)
    room = jax.tree.map(np.asarray, jax.device_get(scene.room))

    def can_be_picked_without(names: set[str]) -> bool:
        gone = np.array([name in names for name in box_names] + [False] * (room.boxes.low.shape[0] - len(box_names)))
        blocks = {each: getattr(room.boxes, each) & ~gone for each in ("blocks_base", "blocks_arm")}
        rest = dataclasses.replace(room, boxes=dataclasses.replace(room.boxes, **blocks))
        reason = np.asarray(_reasons(setup.robot, poses, grasps, rest, setup.world.pick))
        return bool(np.any((reason == Reason.NONE) & there))

    near = _names_near(room, np.asarray(scene.object_pose)[slot], box_names)
    if not near or not can_be_picked_without(set(near)):
        return InTheWay((), together=False)
    alone = tuple(name for name in near if can_be_picked_without({name}))
    return InTheWay(alone or near, together=not alone)


def what_waits(setup: PlannerSetup, scene: Scene, plan: Plan) -> list[tuple[int, tuple[int, ...]]]:
    """Slots of the objects that a plan picks in a way that needs others gone first, in its order, and theirs.

    Args:
        setup: with the scene's room.
        scene: unbatched.
        plan: of the scene.
    """
    if not Rules.of(setup.world.pick, scene.room).object_in_the_way:
        return []
    ways = jax.device_get(_ways(setup.robot, scene, plan.base_pose, plan.object_index, setup.world.pick))
    gone, waits = np.zeros(len(ways.blockers[0, 0]), bool), []
    for step, slot in enumerate(np.asarray(plan.object_index).tolist()):
        if slot < 0 or not plan.served[step]:
            continue
        time = np.where(np.any(ways.blockers[step] & ~gone, axis=-1), np.inf, ways.time[step])
        needed = np.flatnonzero(ways.blockers[step, int(np.argmin(time))])
        if np.isfinite(np.min(time)) and len(needed):
            waits.append((slot, tuple(needed.tolist())))
        gone[slot] = True
    return waits


@partial(jax.jit, static_argnames="config")
def _ways(robot: Robot, scene: Scene, base_pose: Array, slot: Array, config: PickConfig) -> Ways:
    """The ways of each step of a plan, all others standing."""
    at = jnp.maximum(slot, 0)
    grasps = jax.tree.map(lambda x: x[at], scene.grasps)
    others = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(at), *x.shape)), scene.object_boxes)
    own = at[:, None] == jnp.arange(len(scene.mask))
    others = dataclasses.replace(others, blocks_arm=others.blocks_arm & ~own)
    return ways_to_pick(robot, base_pose, grasps, scene.room, others, config, ways=WAYS)


def _poses_round(setup: PlannerSetup, grasps: Grasps) -> tuple[Float[Array, "K 3"], Bool[np.ndarray, " K"]]:
    """The poses looked at, and which of them count; the others fill up."""
    if setup.room.boxes.low.shape[-1] == 1:
        poses = setup.grid_poses
        return jnp.asarray(poses), np.ones(len(poses), bool)
    grid, (x, y) = setup.grid, np.asarray(grasps.pose)[0, :2]
    steps = [np.arange(np.ceil((at - _ROUND_M) / grid.step_m), (at + _ROUND_M) / grid.step_m) for at in (x, y)]
    headings = np.arange(grid.turns) * (2 * np.pi / grid.turns)
    axes = np.meshgrid(steps[0] * grid.step_m, steps[1] * grid.step_m, headings, indexing="ij")
    poses = np.stack(axes, axis=-1).reshape(-1, 3).astype(np.float32)
    near = _may_reach(setup.robot, np.resize(poses, (_padded(len(poses)), 3)), grasps)
    poses = poses[np.asarray(near)[: len(poses)]]
    size = _padded(len(poses))
    return jnp.asarray(np.resize(poses, (size, 3))), np.arange(size) < len(poses)


def _padded(count: int) -> int:
    return max(count, 1) + -max(count, 1) % _BUCKET


def _names_near(room: Room, place: np.ndarray, box_names: Sequence[str]) -> tuple[str, ...]:
    """Each name once, of boxes that are so near to an object that base or arm could touch them."""
    pose, half = room.boxes.pose[: len(box_names)], room.boxes.half_size[: len(box_names)]
    gap = np.linalg.norm(pose[:, :2] - place[:2], axis=1) - np.linalg.norm(half, axis=1)
    return tuple(dict.fromkeys(name for name, distance in zip(box_names, gap, strict=True) if distance <= _ROUND_M))


_may_reach = jax.jit(may_reach)


@jax.jit(static_argnames="config")
def _reasons(
    robot: Robot, base_pose: Float[Array, "K 3"], grasps: Grasps, room: Room, config: PickConfig
) -> Int[Array, " K"]:
    return pick(robot, base_pose, grasps, room, config).reason
