"""Drives found are those that are costed, and touch nothing on their way."""

import itertools
import math

import numpy as np
import pytest

from basenet_jax.task.docked_drives import drive_matrix
from basenet_jax.task.docked_manoeuvre import find_manoeuvre
from basenet_jax.task.manoeuvre import Gear
from basenet_jax.task.roadmap import make_roadmap
from tests.oracles import docked_drives as oracle
from tests.task import docked_rooms
from tests.task.docked_rooms import base_of, draw_poses, draw_room, drives, room_of
from tests.task.test_docked_drives import FLOAT32_BOUND

ROOMS = 6
ROOM_TO_SPARE_M = 0.045  # of the 0.05 that drives keep clear of: turning places stand 1 mm nearer, turns go in steps


@pytest.fixture(scope="module", params=["differential", "omnidirectional"])
def base(request, robot):
    return docked_rooms.sideways(robot) if request.param == "omnidirectional" else robot


@pytest.fixture(scope="module")
def found(base):
    """(room, start, goal, time, drive or None) for some pairs of each room."""
    rng, rows = np.random.default_rng(11), []
    for count in rng.integers(2, 7, ROOMS):
        room = draw_room(rng, count)
        poses = draw_poses(rng, base_of(base), room)
        times, roadmap = drives(base, room, poses, poses), make_roadmap(base, room_of(room))
        for i, j in rng.integers(len(poses), size=(12, 2)):
            try:
                drive = find_manoeuvre(base, roadmap, poses[i], poses[j])
            except ValueError:
                drive = None
            rows.append((room, poses[i], poses[j], times[i, j], drive))
    return rows


def test_they_take_what_was_costed(found):
    for *_, time, drive in found:
        assert (drive.time_s if drive else math.inf) == pytest.approx(time, abs=FLOAT32_BOUND)
    assert sum(drive is not None and len(drive.legs) > 3 for *_, drive in found) > 10, "says little"


def test_without_reverse_they_take_what_was_costed_and_go_forward(robot):
    rng, driven = np.random.default_rng(11), 0
    for count in (2, 5):
        room = draw_room(rng, count)
        poses, roadmap = draw_poses(rng, base_of(robot), room), make_roadmap(robot, room_of(room), reverse=False)
        times = drive_matrix(robot, roadmap, poses, poses)
        for i, j in rng.integers(len(poses), size=(12, 2)):
            if not np.isfinite(times[i, j]):
                with pytest.raises(ValueError, match="can't be reached"):
                    find_manoeuvre(robot, roadmap, poses[i], poses[j])
                continue
            drive = find_manoeuvre(robot, roadmap, poses[i], poses[j])
            assert drive.time_s == pytest.approx(times[i, j], abs=FLOAT32_BOUND)
            assert {leg.gear for leg in drive.legs} <= {None, Gear.FORWARD}
            driven += len(drive.legs) > 3
    assert driven > 3, "says little"


def test_they_lead_from_pose_to_pose_without_gaps(found):
    for _, start, goal, _, drive in found:
        if drive is None or not drive.legs:
            continue
        np.testing.assert_allclose(drive.legs[0].before, start, atol=1e-9)
        last = drive.legs[-1].after
        np.testing.assert_allclose([*last[:2], oracle.wrap(last[2] - goal[2])], [*goal[:2], 0.0], atol=1e-9)
        for one, other in itertools.pairwise(drive.legs):
            np.testing.assert_allclose(one.after, other.before, atol=1e-9)


def test_legs_are_turns_or_straight_and_say_by_how_much(base, found):
    for leg in (leg for *_, drive in found if drive for leg in drive.legs):
        way = leg.after - leg.before
        if leg.turn:
            np.testing.assert_allclose(way, [0.0, 0.0, leg.turn], atol=1e-9)
            assert abs(leg.turn) <= math.pi + 1e-9
        else:
            angle = leg.before[2] + leg.direction
            ahead = np.array([math.cos(angle), math.sin(angle), 0.0])
            np.testing.assert_allclose(way, leg.straight * ahead, atol=1e-4)
        assert base.omnidirectional or leg.direction == 0.0


def test_they_touch_nothing(base, found):
    """Gone along at 2 cm and 2 degrees."""
    known = base_of(base)
    for room, *_, drive in found:
        grown = [oracle.rectangle((*box[:3], *(x + ROOM_TO_SPARE_M for x in box[3:]))) for box in room.boxes]
        for leg in drive.legs if drive else ():
            steps = 2 + int(max(abs(leg.turn) / math.radians(2.0), abs(leg.straight) / 0.02))
            for pose in np.linspace(leg.before, leg.after, steps).tolist():
                assert min(oracle.gap(oracle.footprint(known, pose), box) for box in grown) > 0.0


def test_who_is_there_stays(robot):
    roadmap = make_roadmap(robot, room_of(oracle.Room(((0.0, 0.0, 0.0, 1.0, 0.4),))))
    pose = np.array([0.1, 0.2, 3.0])  # wherever that is
    assert find_manoeuvre(robot, roadmap, pose, pose + np.array([0.0, 0.0, 2 * math.pi])).legs == ()


def test_what_cannot_be_reached_is_named(robot):
    roadmap = make_roadmap(robot, room_of(oracle.Room(((0.0, 0.0, 0.0, 1.0, 0.4),))))
    with pytest.raises(ValueError, match=r"goal: \[0.0, 0.5, 0.0\] can't be reached from \[0.0, 2.0, 1.0\]"):
        find_manoeuvre(robot, roadmap, np.array([0.0, 2.0, 1.0]), np.array([0.0, 0.5, 0.0]))
