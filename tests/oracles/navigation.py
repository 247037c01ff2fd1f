"""Navigation by brute force: every polyline over up to two adjacent via points, forward and in reverse."""

import math
from itertools import pairwise
from typing import NamedTuple

from tests.oracles.timing import trapezoid, wrap

PATH_MARGIN, VIA_MARGIN = 0.249, 0.45  # m
SPEED, ACCELERATION = 0.5, 0.5  # m/s, m/s^2
TURN_SPEED, TURN_ACCELERATION = 0.5, 1.0  # rad/s, rad/s^2
TINY = 1e-6


class Route(NamedTuple):
    """The fastest way."""

    time: float  # s
    points: list[tuple[float, float]]  # empty where there is no way


def navigate(start, goal, table=(2.0, 0.8), margin=PATH_MARGIN, gears=(0.0, math.pi)) -> Route:
    """The fastest allowed way between two poses (x, y, heading), the table being centred on the origin."""
    if math.dist(start[:2], goal[:2]) <= TINY and abs(wrap(goal[2] - start[2])) <= TINY:
        return Route(0.0, [tuple(start[:2])])
    best = Route(math.inf, [])
    for vias in _via_lists(table):
        points = _without_repeats([tuple(map(float, start[:2])), *vias, tuple(map(float, goal[:2]))])
        if any(enters(a, b, table, margin) for a, b in pairwise(points)):
            continue
        for gear in gears:
            time = _duration(points, start[2], goal[2], gear)
            if time < best.time:
                best = Route(time, points)
    return best


def navigate_straight(start, goal):
    """Duration (s) by the simplest reading of the paper: drive the distance and turn the difference of headings."""
    distance = math.dist(start[:2], goal[:2])
    return trapezoid(distance, SPEED, ACCELERATION) + _turn(goal[2] - start[2])


def via_points(table):
    """Corners of the table grown by the margin, counter-clockwise."""
    x, y = table[0] / 2 + VIA_MARGIN, table[1] / 2 + VIA_MARGIN
    return [(x, y), (-x, y), (-x, -y), (x, -y)]


def _via_lists(table):
    vias = via_points(table)
    yield []
    for i in range(4):
        yield [vias[i]]
        yield [vias[i], vias[(i + 1) % 4]]
        yield [vias[i], vias[(i - 1) % 4]]


def _without_repeats(points):
    """The points without via points at the start or the goal: such a segment has no direction and takes no time."""
    start, *vias, goal = points
    vias = [via for via in vias if math.dist(start, via) > TINY and math.dist(via, goal) > TINY]
    return [start, *vias, goal] if vias or math.dist(start, goal) > TINY else [start]


def _duration(points, start_heading, goal_heading, gear):
    if len(points) == 1:
        return _turn(goal_heading - start_heading)
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) + gear for a, b in pairwise(points)]
    drives = sum(trapezoid(math.dist(a, b), SPEED, ACCELERATION) for a, b in pairwise(points))
    turns = sum(_turn(b - a) for a, b in pairwise([start_heading, *headings, goal_heading]))
    return drives + turns


def _turn(angle):
    return trapezoid(wrap(angle), TURN_SPEED, TURN_ACCELERATION)


def enters(a, b, table, margin):
    """Whether the segment from a to b has a point in the open rectangle: clipping by Liang and Barsky.

    The parameters of the segment's line inside each slab are an open interval; the segment enters if all intervals
    have a parameter of [0, 1] in common.
    """
    low, high = -math.inf, math.inf
    for from_, to, size in zip(a, b, table, strict=True):
        half = size / 2 + margin
        if from_ == to:
            if not -half < from_ < half:
                return False
            continue
        ends = sorted(((-half - from_) / (to - from_), (half - from_) / (to - from_)))
        low, high = max(low, ends[0]), min(high, ends[1])
    return low < high and low < 1.0 and high > 0.0
