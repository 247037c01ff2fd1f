"""Rooms for the benchmarks of docked drives, and stops in them."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from basenet_jax.robot.model import Robot
from basenet_jax.world.boxes import UNBOUNDED, Boxes, Room
from basenet_jax.world.occupancy_map import OccupancyMap, map_boxes

PARKING_M = 0.1  # what stops keep clear of


def random_room(rng: np.random.Generator) -> Room:
    """One to three surfaces, one in four of them turned, and up to six obstacles on a floor of 6 to 10 by 5 to 8 m."""
    size = rng.uniform((6.0, 5.0), (10.0, 8.0))
    rows = []
    for _ in range(rng.integers(1, 4)):
        yaw = rng.uniform(-np.pi, np.pi) if rng.random() < 0.25 else rng.integers(4) * np.pi / 2
        rows.append((*rng.uniform(0.0, size), yaw, *rng.uniform((0.8, 0.5), (2.4, 1.0)) / 2))
    obstacles = range(rng.integers(7))
    rows += [(*rng.uniform(0.0, size), rng.uniform(-np.pi, np.pi), *rng.uniform(0.1, 0.4, 2)) for _ in obstacles]
    return _room(np.array(rows), (0.0, 0.0, *size))


def twelve_boxes(rng: np.random.Generator) -> Room:
    """Twelve boxes of up to 0.8 m, one in four turned, on a floor of 10 by 8 m."""
    yaw = np.where(rng.random(12) < 0.25, rng.uniform(-np.pi, np.pi, 12), 0.0)
    rows = np.column_stack([rng.uniform((0.0, 0.0), (10.0, 8.0), (12, 2)), yaw, rng.uniform(0.1, 0.4, (12, 2))])
    return _room(rows, (0.0, 0.0, 10.0, 8.0))


def office(rng: np.random.Generator) -> Room:
    """A map of 20 x 20 m: sixteen rooms with doors of 1.6 m, and ragged furniture."""
    floor: Any = np.array(UNBOUNDED)
    return Room(map_boxes(OccupancyMap(office_cells(rng), 0.05, (0.0, 0.0, 0.0))), floor)


def office_cells(rng: np.random.Generator) -> Bool[np.ndarray, "400 400"]:
    """The closed cells of such a map."""
    closed = np.zeros((400, 400), bool)
    for wall in (100, 200, 300):
        closed[:, wall : wall + 3] = closed[wall : wall + 3] = True
    for door in (40, 140, 240, 340):
        for wall in (100, 200, 300):
            closed[door : door + 32, wall : wall + 3] = closed[wall : wall + 3, door : door + 32] = False
    for _ in range(60):
        (y, x), (height, width) = rng.integers(5, 390, 2), rng.integers(4, 14, 2)
        closed[y : y + height, x : x + width] = True
        for row in y + rng.integers(height, size=4):
            closed[min(row, 399), x + width : x + width + rng.integers(1, 3)] = True
    return closed


def stops_along(robot: Robot, boxes: Boxes, step: float = 0.1) -> Float[np.ndarray, "N 3"]:
    """Poses along the sides of all boxes, 5 mm off what is allowed, lengthwise and crosswise, both ways round."""
    half, found = np.asarray(robot.footprint_half_size), []
    for (x, y, yaw), size in zip(np.asarray(boxes.pose, float), np.asarray(boxes.half_size, float), strict=True):
        for quarter, side, sign in np.ndindex(4, 2, 2):
            off = size[side] + PARKING_M + 0.005 + half[(side + quarter) % 2]
            along = np.arange(-size[1 - side], size[1 - side], step)
            offset = np.stack([np.full_like(along, (1 - 2 * sign) * off), along], axis=-1)
            offset = offset[:, ::-1] if side else offset
            turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
            heading = np.remainder(yaw + quarter * np.pi / 2 + np.pi, 2 * np.pi) - np.pi
            found.append(np.column_stack([offset @ turn + (x, y), np.full(len(along), heading)]))
    return np.concatenate(found)


def _room(rows: Float[np.ndarray, "B 5"], floor: tuple[float, ...]) -> Room:
    """Of boxes (x, y, yaw, half length, half width), 0.75 m high."""
    zero = np.zeros(len(rows))
    solid = zero == 0
    arrays: tuple[Any, ...] = (rows[:, :3], rows[:, 3:], zero, zero + 0.75, solid, solid, solid)
    bounds: Any = np.array(floor)
    return Room(Boxes(*arrays), bounds)
