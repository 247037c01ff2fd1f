"""Planners hold to what they were made for: a robot that can rest beside the surfaces, and scenes in this room."""

from collections.abc import Callable, Sequence

import jax
import numpy as np
from jax import Array
from jaxtyping import Float

from basenet_jax.documents.fields import DocumentError
from basenet_jax.planners.protocol import BatchPlanner, Planner, PlannerSetup, PlanningError, PreparedPlanner
from basenet_jax.robot.rest import check_body, check_tables
from basenet_jax.task.drive_times import DriveTimes
from basenet_jax.task.drives import SAME_POSE_IN_TABLE
from basenet_jax.task.plan import Plan
from basenet_jax.world.boxes import Room, surface_top
from basenet_jax.world.scene import Scene

_ROUNDING = 1e-6  # m


def hold_to(setup: PlannerSetup, planner: Planner) -> Planner:
    """The planner, but that it refuses scenes in another room than it was made for, or a start without drive times.

    Args:
        setup: that it was made for.
        planner: whose `plan_batch` and preparations it keeps.
    """
    return (_TogetherInItsRoom if isinstance(planner, BatchPlanner) else _InItsRoom)(planner, setup)


def check_rest(setup: PlannerSetup) -> None:
    """That the robot's arm, before and after a pick, touches neither its body nor a surface.

    Raises:
        ValueError: it does, or may; the message names the robot, the joints, the link and what is allowed.
    """
    try:
        check_body(setup.robot, setup.world.pick)
        check_tables(setup.robot, surface_top(setup.room), setup.world.pick)
    except DocumentError as error:
        raise ValueError(f"robot {setup.robot.name}: {error}") from None


class _InItsRoom:
    """A planner of scenes in one room."""

    def __init__(self, planner: Planner, setup: PlannerSetup):
        self._planner, self._room = planner, jax.tree.map(np.asarray, jax.device_get(setup.room))
        self._drive_times = setup.drive_times

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`."""
        self._check(scene)
        return self._planner(scene, key)

    def preparations(self, scene: Scene) -> Sequence[Callable[[], object]]:
        """See `PreparedPlanner`; none where the planner has none."""
        return self._planner.preparations(scene) if isinstance(self._planner, PreparedPlanner) else ()

    def _check(self, scene: Scene) -> None:
        found = jax.tree.map(np.asarray, jax.device_get(scene.room))
        pairs = zip(jax.tree.leaves(self._room), jax.tree.leaves(found), strict=True)
        if not all(_same(own, whole) for own, whole in pairs):
            raise ValueError(f"room: found {_describe(found)}, allowed is the planner's, {_describe(self._room)}")
        if self._drive_times is not None:
            _check_starts(np.asarray(scene.robot_start).reshape(-1, 3), self._drive_times)


def _check_starts(starts: Float[np.ndarray, "B 3"], times: DriveTimes) -> None:
    apart = starts[:, None] - times.poses
    apart[..., 2] = np.abs((apart[..., 2] + np.pi) % (2 * np.pi) - np.pi)
    known = np.any(np.all(np.abs(apart) <= SAME_POSE_IN_TABLE, axis=-1), axis=1)
    if not np.all(known):
        found = [float(f"{x:.4g}") for x in starts[int(np.argmin(known))]]
        raise PlanningError(f"robot.start: found {found}, allowed are the poses of {times.source}, or add it to them")


def _same(own: np.ndarray, whole: np.ndarray) -> bool:
    """Whether all of a batch are as one's own; nearly always to the bit, which is found out in a few microseconds."""
    if whole.shape[whole.ndim - own.ndim :] != own.shape:
        return False
    return bool(np.all(whole == own)) or np.allclose(whole, own, rtol=0.0, atol=_ROUNDING)


def _describe(room: Room) -> str:
    """The first of a batch in a few words: how many boxes there are, and the size of a table that is alone."""
    boxes = jax.tree.map(lambda x: x.reshape(-1, *x.shape[room.boxes.low.ndim - 1 :])[0], room.boxes)
    (length, width), height, there = 2 * boxes.half_size[0], boxes.high[0], boxes.blocks_base | boxes.blocks_arm
    one = f"a table of {length:.3f} x {width:.3f} m, {height:.3f} m high"
    return one if len(there) == 1 else f"{np.sum(there)} boxes, the first {one.removeprefix('a table ')}"


class _TogetherInItsRoom(_InItsRoom):
    """A planner of batches of such scenes."""

    def plan_batch(self, scenes: Scene, key: Array) -> Plan:
        """See `BatchPlanner`."""
        self._check(scenes)
        assert isinstance(self._planner, BatchPlanner)
        return self._planner.plan_batch(scenes, key)
