"""Small random rooms, poses in them, and the package's drives there."""

import dataclasses
import math
from typing import Any

import numpy as np

from basenet_jax.task import docked_drives
from basenet_jax.task.roadmap import make_roadmap
from basenet_jax.world.boxes import UNBOUNDED, Boxes, Room
from tests.oracles import docked_drives as oracle

POSES = 10  # in each room: one size to compile for
NEAR_M = 0.105  # a stop's clearance


def base_of(robot):
    """What the oracle knows of a robot."""
    numbers: tuple = (robot.footprint_half_size, robot.base_speed, robot.base_acceleration)
    half, speed, acceleration = ((float(x[0]), float(x[1])) for x in numbers)
    return oracle.Base(half, speed, acceleration, robot.omnidirectional)


def room_of(known, *, more=0):
    """The package's room of the oracle's, with as many more boxes that don't block."""
    rows = np.array([*known.boxes, *more * [(2.0, 2.0, 0.3, 5.0, 5.0)]], np.float32).astype(float)
    there = np.arange(len(rows)) < len(known.boxes)
    ones = np.ones(len(rows))
    arrays: tuple[Any, ...] = (rows[:, :3], rows[:, 3:], 0.0 * ones, 0.75 * ones, there, ones > 0, ones > 0)
    floor: Any = np.array(known.floor if known.floor else UNBOUNDED)
    return Room(Boxes(*arrays), floor)


def draw_room(rng, count):
    """Boxes, half of them in line with the walls, on a floor that leaves room to drive."""
    size = rng.uniform((4.5, 4.0), (7.0, 6.0))
    boxes = []
    for _ in range(count):
        yaw = rng.choice([0.0, rng.uniform(-math.pi, math.pi)])
        boxes.append((*rng.uniform((0.0, 0.0), size), yaw, *rng.uniform(0.1, 0.7, 2)))
    boxes = np.array(boxes, np.float32).astype(float)
    floor = np.array([-0.3, -0.3, *size + 0.3], np.float32).astype(float)
    return oracle.Room(tuple(map(tuple, boxes.tolist())), tuple(floor.tolist()))


def draw_poses(rng, base, room):
    """Free poses, every other one along a side of a box, turned by quarters; and one inside of a box."""
    poses = []
    while len(poses) < POSES - 1:
        pose = rng.uniform((*room.floor[:2], -math.pi), (*room.floor[2:], math.pi))
        if len(poses) % 2:
            x, y, yaw, *half = room.boxes[rng.integers(len(room.boxes))]
            side, sign, quarter = rng.integers(2), rng.choice([-1, 1]), rng.integers(-1, 3)
            offset = np.zeros(2)
            offset[side] = sign * (half[side] + NEAR_M + base.half[(side + quarter) % 2])
            offset[1 - side] = rng.integers(-4, 5) * 0.1
            sine, cosine = math.sin(yaw), math.cos(yaw)
            place = (x + cosine * offset[0] - sine * offset[1], y + sine * offset[0] + cosine * offset[1])
            pose = np.array([*place, oracle.wrap(yaw + quarter * math.pi / 2)])
        pose = np.float32(pose).astype(float)
        if oracle.sweep_free(base, room._replace(clearance=0.1), pose, pose, pose[2]):
            poses.append(pose)
    x, y = room.boxes[0][:2]
    return np.array([*poses, (x, y, 0.3)])


def drives(robot, room, start, goal, **more):
    """The package's times."""
    return docked_drives.drive_matrix(robot, make_roadmap(robot, room_of(room, **more)), start, goal)


def sideways(robot):
    """The robot on a base that drives in any direction."""
    return dataclasses.replace(robot, omnidirectional=True)
