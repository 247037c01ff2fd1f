"""Drives true to the footprint by brute force, one pair of poses at a time: polygons, and Dijkstra's search of roads.

A room here is a tuple of boxes (x, y, yaw, half length, half width), all in the way, and a floor.
"""

import functools
import heapq
import itertools
import math
from typing import NamedTuple

from tests.oracles.timing import trapezoid, wrap

CLEARANCE, SLACK, UNDOCK = 0.05, 0.001, 4.0  # m
TURN_STEP = math.radians(3.0)
TOUCHING, TINY = 1e-5, 1e-6


class Base(NamedTuple):
    """What counts of a robot."""

    half: tuple[float, float]  # m, of the footprint
    speed: tuple[float, float]  # m/s, rad/s
    acceleration: tuple[float, float]
    omnidirectional: bool = False
    reverse: bool = True

    @property
    def gears(self):
        return (0.0, math.pi) if self.reverse else (0.0,)

    @property
    def radius(self):
        return math.hypot(*self.half)

    def straight(self, length):
        return trapezoid(length, self.speed[0], self.acceleration[0])

    def turn(self, angle):
        return trapezoid(wrap(angle), self.speed[1], self.acceleration[1])


class Room(NamedTuple):
    """Boxes and floor, and what tests are made with: of the footprint, of turns, of points and roads."""

    boxes: tuple
    floor: tuple = ()  # x_min, y_min, x_max, y_max (m); none: without bounds
    clearance: float = CLEARANCE
    step: float = TURN_STEP
    slack: float = SLACK


def drive_time(base, room, p, q):
    """Least time (s) from pose p to pose q; infinite if there is no way."""
    p, q = (tuple(map(float, pose)) for pose in (p, q))
    if math.dist(p[:2], q[:2]) <= TINY and abs(wrap(q[2] - p[2])) <= TINY:
        return 0.0
    return min([*_straight_ways(base, room, p, q), *_docked_ways(base, room, p, q)], default=math.inf)


def doubtful(base, room, p, q):
    """Whether rounding, or how finely turns are sampled, may decide which ways are free."""
    others = [room._replace(clearance=CLEARANCE + shift) for shift in (-5e-5, 5e-5)]
    others += [room._replace(slack=SLACK * factor) for factor in (0.5, 2.0)]
    others += [room._replace(step=TURN_STEP / 10)]
    times = [drive_time(base, each, p, q) for each in (room, *others)]
    return not max(times) - min(times) < 1e-9


def _straight_ways(base, room, p, q):
    length = math.dist(p[:2], q[:2])
    if length < TINY:
        if turn_free(base, room, p, q[2] - p[2]):
            yield base.turn(q[2] - p[2])
    elif base.omnidirectional:
        for at, heading in ((p, q[2]), (q, p[2])):
            there = (at[0], at[1], p[2])
            if turn_free(base, room, there, q[2] - p[2]) and sweep_free(base, room, p, q, heading):
                yield base.turn(q[2] - p[2]) + base.straight(length)
    else:
        for gear in base.gears:
            heading = math.atan2(q[1] - p[1], q[0] - p[0]) + gear
            first, last = heading - p[2], q[2] - heading
            free = turn_free(base, room, p, first) and turn_free(base, room, (q[0], q[1], heading), last)
            if free and sweep_free(base, room, p, q, heading):
                yield base.turn(first) + base.straight(length) + base.turn(last)


def _docked_ways(base, room, p, q):
    for (out, place), (into, end) in itertools.product(_gates(base, room, p), _gates(base, room, q)):
        if base.reverse or (_ahead(p, place) > -TINY and _ahead(q, end) < TINY):
            yield out + into + _road(base, room, (*place, p[2]), (*end, q[2]))


def _ahead(pose, place):
    """How far (m) a place is along a pose's heading."""
    return (place[0] - pose[0]) * math.cos(pose[2]) + (place[1] - pose[1]) * math.sin(pose[2])


def _gates(base, room, pose):
    """Time to and place of the first turning place along each axis."""
    quarters = range(4) if base.omnidirectional else (0, 2)
    for angle in (pose[2] + quarter * math.pi / 2 for quarter in quarters):
        ray = (math.cos(angle), math.sin(angle))
        for t in sorted({0.0, *_crossings(base, room, pose, ray)}):
            place = (pose[0] + t * ray[0], pose[1] + t * ray[1])
            if 0.0 <= t <= UNDOCK and turning_place(base, room, place):
                if sweep_free(base, room, pose, place, pose[2]):
                    yield base.straight(t), place
                break


def _crossings(base, room, start, ray):
    """Where a ray crosses lines along the sides of grown boxes, and the floor's rim."""
    lines = []
    for x, y, yaw, *half in room.boxes:
        u, v = _into((x, y, yaw), start), _turned(ray, -yaw)
        lines += [(u[i], v[i], side * (half[i] + base.radius + CLEARANCE)) for i in range(2) for side in (-1, 1)]
    if room.floor:
        lines += [(start[i], ray[i], room.floor[i] + base.radius) for i in range(2)]
        lines += [(start[i], ray[i], room.floor[i + 2] - base.radius) for i in range(2)]
    return [(line - at) / along for at, along, line in lines if abs(along) > 1e-12]


def _road(base, room, p, q):
    """Dijkstra over states (place, direction of arriving, gear)."""
    if math.dist(p[:2], q[:2]) < TINY:
        return base.turn(q[2] - p[2])
    if base.omnidirectional:
        return base.turn(q[2] - p[2]) + _road_in_gear(base, room, p, q, None)
    return min(_road_in_gear(base, room, p, q, gear) for gear in base.gears)


def _road_in_gear(base, room, p, q, gear):
    """Of one gear; None: the heading doesn't count."""
    nodes = [p[:2], q[:2], *vias(base, room)]

    done, queue = set(), [(0.0, 0, p[2])]  # time, place and direction of arriving; at first the heading
    while queue:
        time, at, direction = heapq.heappop(queue)
        if at == 1:
            return time  # with the last turn
        if (at, direction) in done:
            continue
        done.add((at, direction))
        for to, point in enumerate(nodes):
            length = math.dist(nodes[at], point)
            if length < TINY or not piece_free(base, room, nodes[at], point):
                continue
            ahead = math.atan2(point[1] - nodes[at][1], point[0] - nodes[at][0])
            cost = base.straight(length)
            if gear is not None:
                cost += base.turn(ahead - direction + (gear if at == 0 else 0.0))
                cost += base.turn(q[2] - gear - ahead) if to == 1 else 0.0
            heapq.heappush(queue, (time + cost, to, 0.0 if gear is None else ahead))
    return math.inf


@functools.lru_cache(maxsize=8)
def vias(base, room):
    """Corners of grown boxes that are turning places."""
    found = []
    for x, y, yaw, *half in room.boxes:
        sides = [h + base.radius + CLEARANCE for h in half]
        for i, j in itertools.product((-1, 1), repeat=2):
            across = _turned((i * sides[0], j * sides[1]), yaw)
            found.append((x + across[0], y + across[1]))
    return [point for point in found if turning_place(base, room, point)]


def turning_place(base, room, point):
    """Whether the base may turn to any heading there."""
    if room.floor:
        rims = [min(point[i] - room.floor[i], room.floor[i + 2] - point[i]) for i in range(2)]
        if min(rims) < base.radius - TOUCHING:
            return False
    return piece_free(base, room, point, point)


@functools.lru_cache(maxsize=100_000)
def piece_free(base, room, a, b):
    """Whether a segment stays out of all boxes grown for points: clipping by Liang and Barsky."""
    for x, y, yaw, *half in room.boxes:
        start, end = (_into((x, y, yaw), point) for point in (a, b))
        low, high = 0.0, 1.0
        for i in range(2):
            size, along = half[i] + base.radius + CLEARANCE - room.slack, end[i] - start[i]
            if abs(along) < 1e-12:
                if abs(start[i]) >= size:
                    low, high = 1.0, 0.0
                continue
            ends = sorted(((-size - start[i]) / along, (size - start[i]) / along))
            low, high = max(low, ends[0]), min(high, ends[1])
        if low < high:
            return False
    return True


def turn_free(base, room, pose, angle):
    """Whether the base may turn from a pose by an angle, the shorter way round."""
    if turning_place(base, room, pose[:2]):
        return True
    angle = wrap(angle)
    steps = max(1, math.ceil(abs(angle) / room.step - 1e-9))
    return all(
        _fits(base, room, footprint(base, (pose[0], pose[1], pose[2] + angle * k / steps))) for k in range(steps + 1)
    )


def sweep_free(base, room, a, b, heading):
    """Whether the base may move straight from a point to another with a heading."""
    return _fits(base, room, _hull([*footprint(base, (*a[:2], heading)), *footprint(base, (*b[:2], heading))]))


def footprint(base, pose):
    """Corners, counter-clockwise."""
    return rectangle((*pose, *base.half))


def rectangle(box):
    """Corners of (x, y, yaw, half length, half width), counter-clockwise."""
    x, y, yaw, length, width = box
    corners = [_turned((i * length, j * width), yaw) for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return [(x + i, y + j) for i, j in corners]


def _fits(base, room, polygon):
    if room.floor:
        low, high = room.floor[:2], room.floor[2:]
        if any(not (a - TOUCHING <= c <= b + TOUCHING) for p in polygon for c, a, b in zip(p, low, high, strict=True)):
            return False
    grown = ((x, y, yaw, a + room.clearance, b + room.clearance) for x, y, yaw, a, b in room.boxes)
    return all(gap(polygon, rectangle(box)) >= -TOUCHING for box in grown)


def gap(one, other):
    """By how much (m) an edge of either convex polygon (counter-clockwise) separates the two."""
    best = -math.inf
    for polygon, rest in ((one, other), (other, one)):
        for a, b in itertools.pairwise([*polygon, polygon[0]]):
            if (length := math.dist(a, b)) < 1e-9:
                continue
            normal = ((b[1] - a[1]) / length, (a[0] - b[0]) / length)
            best = max(best, min((p[0] - a[0]) * normal[0] + (p[1] - a[1]) * normal[1] for p in rest))
    return best


def _hull(points):
    """Convex hull, counter-clockwise: Andrew's monotone chain."""
    points = sorted(set(points))

    def chain(points):
        kept = []
        for p in points:
            while len(kept) > 1 and _cross(kept[-2], kept[-1], p) <= 1e-12:
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return chain(points) + chain(points[::-1])


def _cross(o, a, b):
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def _turned(vector, angle):
    sine, cosine = math.sin(angle), math.cos(angle)
    return cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]


def _into(frame, point):
    return _turned((point[0] - frame[0], point[1] - frame[1]), -frame[2])
