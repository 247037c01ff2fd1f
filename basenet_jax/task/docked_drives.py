"""How long the base drives from pose to pose among boxes, true to its footprint.

Straight between two turns; or undocked, along a road, and docked.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import straight_duration, turn_duration
from basenet_jax.task.drive_space import footprint_fits
from basenet_jax.task.gates import Gates, gates, one_way_times
from basenet_jax.task.road_search import gears, road_times
from basenet_jax.task.roadmap import Roadmap
from basenet_jax.trigonometry import atan2, sin_cos, wrap_angle

SAME_POSE = 1e-6  # m or rad
_ROUNDING = 1e-5  # rad: a turn may go so far beyond what is free
_FEW = 24  # places, at least
_SAME_PLACE = 2e-5  # m or rad: turning places and headings that are one but for rounding


def drive_times(robot: Robot, roadmap: Roadmap, start: Gates, goal: "Gates | SharedGates") -> Float[Array, "S T"]:
    """Least times (s) for the base to drive from each pose to each; infinite where there is no way.

    It stays, or turns, drives straight and turns, or undocks straight to a turning place, turns, drives a road (with a
    turn at each via), turns and docks: whichever is free and takes the least.

    Args:
        robot: its base counts.
        roadmap: of the room.
        start: of the poses to drive from, by `gates`.
        goal: likewise, to drive to; of many, by `shared_gates`.
    """
    if isinstance(goal, SharedGates):
        return _least(robot, roadmap, start, goal.gates, _own_places(start), goal.places)
    return _least(robot, roadmap, start, goal, _own_places(start), _own_places(goal))


def drive_matrix(
    robot: Robot, roadmap: Roadmap, start: Float[ArrayLike, "S 3"], goal: Float[ArrayLike, "T 3"]
) -> Float[np.ndarray, "S T"]:
    """`drive_times` of many poses, on the host: of turning places and headings that they share, each is used once.

    Args:
        robot: its base counts.
        roadmap: of the room.
        start: poses (x, y, heading) in W.
        goal: likewise.
    """
    ends = [
        shared_gates(robot, compiled_gates(robot, roadmap, np.asarray(poses)), reverse=roadmap.reverse)
        for poses in (start, goal)
    ]
    return drives_between(robot, roadmap, *ends)


def drives_between(
    robot: Robot, roadmap: Roadmap, start: "SharedGates", goal: "SharedGates"
) -> Float[np.ndarray, "S T"]:
    """`drive_matrix` of poses whose gates are known."""
    return np.asarray(_matrix(robot, roadmap, start, goal))


@struct.dataclass
class Places:
    """P poses at turning places, and which of them each gate leads to."""

    pose: Float[Any, "P 3"]  # an omnidirectional base's heading there doesn't count
    which: Int[Any, "S K"]
    turned: Bool[Any, "S K"]  # whether the gate's heading is the opposite one


@struct.dataclass
class SharedGates:
    """Gates of many poses, and the few places that they lead to."""

    gates: Gates
    places: Places


def shared_gates(robot: Robot, ends: Gates, *, reverse: bool) -> SharedGates:
    """Gates with each turning place and heading that several of them lead to once, on the host."""
    return SharedGates(ends, _shared_places(robot, jax.device_get(ends), reverse=reverse))


def _own_places(ends: Gates) -> Places:
    """Each gate's own."""
    heading = jnp.broadcast_to(ends.pose[:, None, 2:], (*ends.time.shape, 1))
    pose = jnp.concatenate([ends.place, heading], axis=-1).reshape(-1, 3)
    return Places(pose, jnp.arange(ends.time.size).reshape(ends.time.shape), jnp.zeros(ends.time.shape, bool))


def _shared_places(robot: Robot, ends: Gates, *, reverse: bool) -> Places:
    """Each place and heading once, where opposite headings are one if it may drive in reverse; padded with copies."""
    heading = np.broadcast_to(0.0 if robot.omnidirectional else ends.pose[:, None, 2], ends.time.shape)
    halves = np.round(heading / np.pi) if reverse else 2 * np.round(heading / (2 * np.pi))
    pose = np.concatenate([ends.place, (heading - np.pi * halves)[..., None]], axis=-1)
    used = np.isfinite(ends.time)
    keys = np.round(pose[used] / _SAME_PLACE).astype(np.int64)
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    index = np.zeros(used.shape, np.int32)
    index[used] = which.ravel()
    shared = pose[used][first] if len(first) else pose[:1, 0]
    size = max(len(used) // 2, _FEW)  # poses along a side share their places: nearly always enough, whatever is moved
    while size < len(shared):
        size *= 2
    return Places(np.resize(shared, (size, 3)), index, halves % 2 == 1)


@jax.jit
def compiled_gates(robot: Robot, roadmap: Roadmap, pose: Float[ArrayLike, "S 3"]) -> Gates:
    """`gates` in a room, compiled."""
    return gates(robot, roadmap.space, jnp.asarray(pose))


@jax.jit
def _matrix(robot: Robot, roadmap: Roadmap, start: SharedGates, goal: SharedGates) -> Array:
    return _least(robot, roadmap, start.gates, goal.gates, start.places, goal.places)


def _least(
    robot: Robot, roadmap: Roadmap, start: Gates, goal: Gates, begin: Places, end: Places
) -> Float[Array, "S T"]:
    """Over all ways; the roads are those between `begin` and `end`."""
    roads = road_times(robot, roadmap, begin.pose, end.pose)
    leave, _ = one_way_times(start, reverse=roadmap.reverse)
    _, come = one_way_times(goal, reverse=roadmap.reverse)
    docked = jnp.inf
    for i in range(leave.shape[1]):
        for j in range(come.shape[1]):
            turned = begin.turned[:, None, i] ^ end.turned[:, j]
            road = roads[turned.astype(int), begin.which[:, None, i], end.which[:, j]]
            docked = jnp.minimum(docked, leave[:, None, i] + road + come[:, j])
    turn = goal.pose[:, 2] - start.pose[:, None, 2]
    if robot.omnidirectional:
        docked += turn_duration(robot, turn)
    shift = goal.pose[:, :2] - start.pose[:, None, :2]
    same = jnp.all(jnp.abs(shift) <= SAME_POSE, axis=-1) & (jnp.abs(wrap_angle(turn)) <= SAME_POSE)
    straight = jnp.min(jnp.stack(straight_ways(robot, roadmap, start, goal)), axis=0)
    return jnp.where(same, 0.0, jnp.minimum(docked, straight))


def straight_ways(robot: Robot, roadmap: Roadmap, start: Gates, goal: Gates) -> list[Float[Array, "S T"]]:
    """Times (s) to turn, drive straight and turn, infinite where that isn't free: forward, then in reverse if allowed.

    Of an omnidirectional base: to turn and drive, then to drive and turn. One turn if both poses are at one place.
    """
    heading, goal_heading = start.pose[:, None, 2], goal.pose[:, 2]
    x, y = goal.pose[:, 0] - start.pose[:, None, 0], goal.pose[:, 1] - start.pose[:, None, 1]
    length = jnp.sqrt(x * x + y * y)
    short = length <= SAME_POSE
    time = straight_duration(robot, length)
    middle = (start.pose[:, None, 0] + 0.5 * x, start.pose[:, None, 1] + 0.5 * y)

    def turn_out(angle: Array) -> Array:
        return _turn_within(robot, angle, start.left[:, None], start.right[:, None])

    def turn_in(angle: Array) -> Array:
        return _turn_within(robot, angle, goal.right, goal.left)

    if robot.omnidirectional:
        turns = (turn_out(goal_heading - heading), turn_in(goal_heading - heading))
        fits = [
            footprint_fits(roadmap.space, middle, (cosine, sine), (0.5 * x, 0.5 * y), askew=True)
            for sine, cosine in map(sin_cos, jnp.broadcast_arrays(goal_heading, heading))
        ]
    else:
        direction = atan2(y, x)
        size = jnp.where(short, 1.0, length)
        along = (jnp.where(short, 1.0, x / size), y / size)
        ways = (0.0, jnp.pi)[: len(gears(robot, roadmap))]
        fits = [footprint_fits(roadmap.space, middle, along, (0.5 * x, 0.5 * y))] * len(ways)
        turns = [turn_out(direction + gear - heading) + turn_in(goal_heading - direction - gear) for gear in ways]
    in_place = turn_out(goal_heading - heading)
    return [
        jnp.where(short, in_place, jnp.where(fit, time + turn, jnp.inf)) for fit, turn in zip(fits, turns, strict=True)
    ]


def _turn_within(robot: Robot, angle: Array, left: Array, right: Array) -> Array:
    """Time (s) of a turn the shorter way round; infinite where it goes further than is free."""
    angle = wrap_angle(angle)
    free = (angle <= left + _ROUNDING) & (-angle <= right + _ROUNDING) & (left >= 0)
    return jnp.where(free, turn_duration(robot, angle), jnp.inf)
