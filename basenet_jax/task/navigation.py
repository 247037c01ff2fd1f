"""How long the base drives from pose to pose: round the table, by turning, driving and turning."""

import functools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from basenet_jax.config import NavigationConfig
from basenet_jax.geometry import relative
from basenet_jax.robot.kinematics import Vector, components
from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import straight_duration, turn_duration
from basenet_jax.trigonometry import atan2, wrap_angle
from basenet_jax.world.boxes import Room

# Corners of the table in order round it, as signs of its half sides: neighbours (cyclically) are adjacent, and the
# straight line between adjacent via points is always free.
_CORNERS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])


def navigation_time(
    robot: Robot,
    start: Float[Array, "*batch 3"],
    goal: Float[Array, "*batch 3"],
    room: Room,
    config: NavigationConfig = NavigationConfig(),
) -> Float[Array, "*batch"]:
    """Least time (s) for the base to drive from one pose to another round the table; infinite if there is no way.

    The base turns, drives and turns along a polyline (straight, or over one or two adjacent via points, corners of
    the grown table), all forward or all in reverse, stopping at every corner; each part is a trapezoidal profile.
    The polyline may not enter the open rectangle "table grown by half the base's shorter side, less a slack".

    Args:
        robot: its base's sides, speeds and accelerations count.
        start: pose (x, y, heading) in W.
        goal: likewise.
        room: with one table.
        config: margins, whether it may be in reverse, and whether to drive straight through anything.
    """
    p, q = _seen_from_table(room, start, goal)
    straight = _leg(robot, p[:2], q[:2], room, config)
    turned = turn_duration(robot, q[2] - p[2])
    if config.straight:
        time = straight.duration + turned
    else:
        legs = _Ways(robot, config.reverse, p, q, straight, *_over_vias(robot, p, q, room, config))
        time = jnp.where(straight.short, turned, _least_way(legs))
    same = straight.short & (jnp.abs(wrap_angle(q[2] - p[2])) <= config.same_pose)
    return jnp.where(same, 0.0, time)


def navigation_path(
    robot: Robot,
    start: ArrayLike,
    goal: ArrayLike,
    room: Room,
    config: NavigationConfig = NavigationConfig(),
) -> Float[np.ndarray, "points 2"]:
    """The polyline (m, in W) that `navigation_time` is the time of; one drive at a time, for pictures.

    Raises:
        ValueError: the goal can't be reached.
    """
    ends = [np.asarray(start)[:2], np.asarray(goal)[:2]]
    short, durations, corners = jax.device_get(_compare_ways(robot, start, goal, room, config))
    if config.straight or short:
        return np.stack(ends)
    best = int(np.argmin(durations))
    if not np.isfinite(durations[best]):
        raise ValueError(f"goal: {np.asarray(goal).tolist()} can't be reached from {np.asarray(start).tolist()}")
    half = np.asarray(room.table_half_size) + np.min(np.asarray(robot.footprint_half_size)) + config.via_clearance_m
    x, y, yaw = np.asarray(room.boxes.pose, float)[0]
    turned = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    vias = [(x, y) + _CORNERS[corner] * half @ turned for corner in corners[best] if corner >= 0]
    return np.stack([ends[0], *vias, ends[1]])


@functools.partial(jax.jit, static_argnames="config")
def _compare_ways(
    robot: Robot, start: ArrayLike, goal: ArrayLike, room: Room, config: NavigationConfig
) -> tuple[Array, Array, Array]:
    """Whether it is too short to drive, every way's duration, and the corners that each goes over (-1: none)."""
    p, q = _seen_from_table(room, jnp.asarray(start), jnp.asarray(goal))
    straight = _leg(robot, p[:2], q[:2], room, config)
    ways = list(_all_ways(_Ways(robot, config.reverse, p, q, straight, *_over_vias(robot, p, q, room, config))))
    corners = [(*over, -1, -1)[:2] for _, over in ways]
    return straight.short, jnp.stack([duration for duration, _ in ways]), jnp.array(corners)


def _seen_from_table(
    room: Room, start: Float[Array, "*batch 3"], goal: Float[Array, "*batch 3"]
) -> tuple[Vector, Vector]:
    """Both poses in the frame of the room's one box."""
    if room.boxes.low.shape[-1] != 1:
        raise ValueError("room: found several boxes; drives of a point go round one table that is alone, others dock")
    p, q = (components(relative(jnp.asarray(room.boxes.pose[..., 0, :]), pose)) for pose in (start, goal))
    return p, q


_Point = Sequence[Array | np.ndarray]  # x, y


class _Leg(NamedTuple):
    """A straight drive between two points."""

    direction: Array  # rad
    duration: Array  # s
    free: Array  # whether it stays out of the grown table
    short: Array  # whether it is too short to have a direction


class _Ways(NamedTuple):
    """All legs of the ways from pose p to pose q; those to and from vias have a leading axis of four."""

    robot: Robot
    reverse: bool
    p: Vector
    q: Vector
    straight: _Leg
    outward: _Leg  # from p to each via
    round: _Leg  # from each via to the next
    inward: _Leg  # from each via to q


def _over_vias(robot: Robot, p: Vector, q: Vector, room: Room, config: NavigationConfig) -> tuple[_Leg, _Leg, _Leg]:
    """The legs from p to each via point, from each via point to the next one round the table, and from each to q."""
    half = room.table_half_size + (jnp.min(robot.footprint_half_size) + config.via_clearance_m)
    corners = _CORNERS.reshape(4, *(1,) * max(p[0].ndim, q[0].ndim, half.ndim - 1), 2)
    vias = (corners[..., 0] * half[..., 0], corners[..., 1] * half[..., 1])
    following = tuple(jnp.roll(via, -1, axis=0) for via in vias)
    ends = ((p[:2], vias), (vias, following), (vias, q[:2]))
    outward, between, inward = (_leg(robot, a, b, room, config) for a, b in ends)
    return outward, between, inward


def _least_way(ways: _Ways) -> Array:
    """The least duration over all allowed ways."""
    best = jnp.inf
    for duration, _ in _all_ways(ways):
        best = jnp.minimum(best, duration)
    return jnp.asarray(best)


def _all_ways(ways: _Ways) -> Iterator[tuple[Array, tuple[int, ...]]]:
    """Yields the duration of every way in its better gear, infinite if not allowed, and the corners that it goes over.

    What ways share (turns at both ends, legs) is computed once for all vias; only sums are unrolled, which on a CPU
    take a third of the time that they take as arrays over vias.
    """
    robot, heading, goal_heading = ways.robot, ways.p[2], ways.q[2]
    gears = (0.0, jnp.pi)[: 1 + ways.reverse]  # in reverse the base's heading is opposite to the direction of travel

    def turn(angle: Array) -> Array:
        return turn_duration(robot, angle)

    def first_turns(leg: _Leg) -> list[Array]:
        return [turn(leg.direction + gear - heading) for gear in gears]

    def last_turns(leg: _Leg) -> list[Array]:
        return [turn(goal_heading - leg.direction - gear) for gear in gears]

    def better(first: list[Array], last: list[Array]) -> Array:
        return functools.reduce(jnp.minimum, (a + b for a, b in zip(first, last, strict=True)))

    yield better(first_turns(ways.straight), last_turns(ways.straight)) + _cost(ways.straight), ()
    first, last = first_turns(ways.outward), last_turns(ways.inward)
    outward, inward = ([_at(legs, via) for via in range(4)] for legs in (ways.outward, ways.inward))
    out_cost, in_cost, first, last = zip(
        *((_cost(outward[v]), _cost(inward[v]), [x[v] for x in first], [x[v] for x in last]) for v in range(4)),
        strict=True,
    )
    for via in range(4):
        turned = turn(inward[via].direction - outward[via].direction)
        yield better(first[via], last[via]) + (out_cost[via] + turned + in_cost[via]), (via,)
        following, edge = (via + 1) % 4, _at(ways.round, via)
        for begin, end, direction in ((via, following, edge.direction), (following, via, edge.direction + jnp.pi)):
            onto, off = turn(direction - outward[begin].direction), turn(inward[end].direction - direction)
            legs = (out_cost[begin] + onto) + _cost(edge) + (in_cost[end] + off)
            yield better(first[begin], last[end]) + legs, (begin, end)


def _at(legs: _Leg, via: int) -> _Leg:
    return _Leg(*(field[via] for field in legs))


def _cost(leg: _Leg) -> Array:
    """The leg's duration (s), infinite if it isn't free.

    So is one too short to have a direction: a way over a via point that coincides with p or q is left out, since the
    same way without that via is among the others.
    """
    return jnp.where(leg.free & ~leg.short, leg.duration, jnp.inf)


def _leg(
    robot: Robot,
    start: Sequence[Array | np.ndarray],
    end: Sequence[Array | np.ndarray],
    room: Room,
    config: NavigationConfig,
) -> _Leg:
    along = (end[0] - start[0], end[1] - start[1])
    square = along[0] * along[0] + along[1] * along[1]
    length = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)  # keeps gradients finite at 0
    return _Leg(
        direction=atan2(along[1], along[0]),
        duration=straight_duration(robot, length),
        free=_stays_out(start, end, room.table_half_size + (jnp.min(robot.footprint_half_size) - config.path_slack_m)),
        short=length <= config.same_pose,
    )


def _stays_out(start: _Point, end: _Point, half: Array) -> Array:
    """Whether a segment stays out of an open rectangle about the origin: one of three axes separates them."""
    middle = [0.5 * (a + b) for a, b in zip(start, end, strict=True)]
    extent = [0.5 * (b - a) for a, b in zip(start, end, strict=True)]
    x, y = jnp.abs(extent[0]), jnp.abs(extent[1])
    beside = jnp.abs(middle[0] * extent[1] - middle[1] * extent[0]) >= half[..., 0] * y + half[..., 1] * x
    return (jnp.abs(middle[0]) >= half[..., 0] + x) | (jnp.abs(middle[1]) >= half[..., 1] + y) | beside
