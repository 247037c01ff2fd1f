"""A drive as its legs, turns on the spot and straight pieces: what motions, exports and films of any drive read."""

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from basenet_jax.robot.model import Robot
from basenet_jax.robot.time_law import TimeLaw, fastest_law

_STILL = 1e-12  # rad or m: less is rounding
_SIDEWAYS = 1e-6  # rad: a piece that is less askew goes along the heading


class Gear(enum.StrEnum):
    """Which way a straight piece goes, as seen from the base."""

    FORWARD = "forward"
    REVERSE = "reverse"
    SIDEWAYS = "sideways"  # or askew, by an omnidirectional base


@dataclass(frozen=True)
class Leg:
    """A turn on the spot or a straight piece, from rest to rest; poses are (x, y, heading) in W, m and rad."""

    before: Float[np.ndarray, "3"]
    after: Float[np.ndarray, "3"]  # its heading without a jump
    turn: float  # rad, counter-clockwise; 0: a straight piece
    straight: float  # m, negative in reverse; 0: a turn
    direction: float  # rad, of a straight piece in the base frame: 0 along the heading, else an omnidirectional base's
    law: TimeLaw

    @property
    def time_s(self) -> float:
        """What the leg takes."""
        return self.law.duration_s

    @property
    def gear(self) -> Gear | None:
        """Of a straight piece; None of a turn."""
        if self.turn:
            return None
        return Gear.SIDEWAYS if self.direction else Gear.REVERSE if self.straight < 0.0 else Gear.FORWARD


@dataclass(frozen=True)
class Manoeuvre:
    """A drive; without legs, the base stays where it is."""

    legs: tuple[Leg, ...]

    @property
    def time_s(self) -> float:
        """What the drive takes."""
        return sum(leg.time_s for leg in self.legs)

    @property
    def staging_pose(self) -> Float[np.ndarray, "3"] | None:
        """From where the base goes straight to the goal; the goal itself where it turns last; None without legs."""
        if not self.legs:
            return None
        return self.legs[-1].after if self.legs[-1].turn else self.legs[-1].before


def through(robot: Robot, poses: Iterable[ArrayLike]) -> Manoeuvre:
    """The drive through poses, each turned or shifted from the one before; steps that go nowhere are left out.

    Args:
        robot: its base's speeds and accelerations count.
        poses: (x, y, heading) in W, headings without jumps.
    """
    legs = (_leg(robot, before, after) for before, after in pairwise(np.asarray(pose, float) for pose in poses))
    return Manoeuvre(tuple(leg for leg in legs if leg))


def along_path(
    robot: Robot,
    path: Float[ArrayLike, "points 2"],
    start: Float[ArrayLike, "3"],
    goal: Float[ArrayLike, "3"],
    *,
    same_pose: float,
    keep_heading: bool = False,
    reverse: bool = True,
) -> Manoeuvre:
    """Turn, drive, turn along a polyline, all forward or all in reverse, whichever takes less time.

    Args:
        robot: its base's speeds and accelerations count.
        path: the polyline (m, in W) from start to goal.
        start: pose (x, y, heading) in W.
        goal: likewise.
        same_pose: what is shorter (m) has no direction and isn't driven.
        keep_heading: one turn at the end, whatever the direction driven in.
        reverse: whether it may be.
    """
    start, goal = np.asarray(start, float), np.asarray(goal, float)
    legs = np.diff(path, axis=0)
    legs = legs[np.hypot(*legs.T) > same_pose]
    directions = np.arctan2(legs[:, 1], legs[:, 0])
    if keep_heading:
        headings = [np.unwrap([*[start[2]] * (1 + len(legs)), goal[2]])]
    else:
        headings = [np.unwrap([start[2], *(directions + gear), goal[2]]) for gear in (0.0, np.pi)[: 1 + reverse]]
    fastest = min(headings, key=lambda each: sum(turn_time(robot, turn) for turn in np.diff(each)))
    poses, place = [start], start[:2]
    for leg, heading in zip(legs, fastest[1:], strict=False):
        poses.append(np.array([*place, heading]))
        place = place + leg
        poses.append(np.array([*place, heading]))
    return through(robot, [*poses, np.array([*place, fastest[-1]])])


def turn_time(robot: Robot, angle: float) -> float:
    """Duration (s) of a turn on the spot by an angle (rad)."""
    return _law(robot, 1, abs(angle)).duration_s if abs(angle) > _STILL else 0.0


def _leg(robot: Robot, before: np.ndarray, after: np.ndarray) -> Leg | None:
    (x, y), turn = (after - before)[:2], float(after[2] - before[2])
    if abs(turn) > _STILL:
        return Leg(before, after, turn, 0.0, 0.0, _law(robot, 1, abs(turn)))
    length = math.hypot(x, y)
    if length <= _STILL:
        return None
    direction = math.remainder(math.atan2(y, x) - before[2], 2.0 * math.pi)
    sign = -1.0 if math.cos(direction) < 0.0 else 1.0
    if abs(math.sin(direction)) < _SIDEWAYS:
        return Leg(before, after, 0.0, sign * length, 0.0, _law(robot, 0, length))
    return Leg(before, after, 0.0, length, direction, _law(robot, 0, length))


def _law(robot: Robot, axis: int, distance: float) -> TimeLaw:
    """Of a straight piece (axis 0, m) or a turn (axis 1, rad)."""
    return fastest_law(float(robot.base_speed[axis]) / distance, float(robot.base_acceleration[axis]) / distance)
