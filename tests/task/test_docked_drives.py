"""Docked drives against brute force, their symmetries, and where the answer is known."""

import math

import jax
import numpy as np
import pytest

from basenet_jax.task import docked_drives
from basenet_jax.task.gates import gates
from basenet_jax.task.roadmap import make_roadmap
from tests.oracles import docked_drives as oracle
from tests.oracles.timing import trapezoid
from tests.task import docked_rooms
from tests.task.docked_rooms import base_of, draw_poses, draw_room, drives, room_of

# As for drives of a point (`navigation_pairs`): a direction is known to about 5e-7 rad, and T's slope at 0 is infinite.
FLOAT32_BOUND = 6e-3
ROOMS = 10


@pytest.fixture(scope="module", params=["differential", "omnidirectional"])
def base(request, robot):
    return docked_rooms.sideways(robot) if request.param == "omnidirectional" else robot


@pytest.fixture(scope="module")
def rooms(base):
    rng = np.random.default_rng(3)
    rooms = [draw_room(rng, count) for count in rng.integers(2, 7, ROOMS)]
    return [(room, draw_poses(rng, base_of(base), room)) for room in rooms]


@pytest.fixture(scope="module")
def times(base, rooms):
    return [drives(base, room, poses, poses) for room, poses in rooms]


def test_agrees_with_brute_force(base, rooms, times):
    known, reachable, wrong = base_of(base), 0, []
    for (room, poses), ours in zip(rooms, times, strict=True):
        for i, j in np.ndindex(ours.shape):
            if i > j:
                continue  # see the way back
            expected = oracle.drive_time(known, room, poses[i], poses[j])
            reachable += 0 < expected < math.inf
            if not (ours[i, j] == expected or abs(ours[i, j] - expected) <= FLOAT32_BOUND):
                wrong.append((room, poses[i], poses[j], ours[i, j], expected))
    assert all(oracle.doubtful(known, *pair[:3]) for pair in wrong), wrong
    assert len(wrong) <= 0.01 * reachable
    assert 0.5 < reachable / (ROOMS * docked_rooms.POSES * (docked_rooms.POSES - 1) / 2) < 0.95, "says little"


def test_the_way_back_takes_as_long(times):
    for each in times:
        np.testing.assert_allclose(each, each.T, atol=FLOAT32_BOUND)


def test_without_reverse_it_agrees_with_brute_force_too(robot):
    rng, known, wrong, differs = np.random.default_rng(4), base_of(robot)._replace(reverse=False), [], 0
    for count in (2, 4, 5):
        room = draw_room(rng, count)
        poses = draw_poses(rng, known, room)
        roadmap = make_roadmap(robot, room_of(room), reverse=False)
        ours = docked_drives.drive_matrix(robot, roadmap, poses, poses)
        differs += np.sum(ours != ours.T)
        for i, j in np.ndindex(ours.shape):
            expected = oracle.drive_time(known, room, poses[i], poses[j])
            if not (ours[i, j] == expected or abs(ours[i, j] - expected) <= FLOAT32_BOUND):
                wrong.append((room, poses[i], poses[j], ours[i, j], expected))
    assert all(oracle.doubtful(known, *pair[:3]) for pair in wrong), wrong
    assert len(wrong) <= 3
    assert differs > 100, "says little"


def test_only_the_room_and_the_poses_together_count(base, rooms):
    """Turned and shifted together, without a floor's bounds, they are the same room."""
    room, poses = rooms[0]
    x, y, turn = 1.5, -0.7, 0.9
    sine, cosine = math.sin(turn), math.cos(turn)

    def moved(pose):
        place = (x + cosine * pose[0] - sine * pose[1], y + sine * pose[0] + cosine * pose[1])
        return (*place, pose[2] + turn, *pose[3:])

    elsewhere = oracle.Room(tuple(moved(box) for box in room.boxes))
    times = drives(base, room._replace(floor=()), poses, poses)
    others = np.array([moved(pose) for pose in poses])
    np.testing.assert_allclose(drives(base, elsewhere, others, others), times, atol=FLOAT32_BOUND)
    assert np.mean(np.isfinite(times)) > 0.5


def test_boxes_that_do_not_block_are_not_there(base, rooms, times):
    room, poses = rooms[0]
    np.testing.assert_array_equal(drives(base, room, poses, poses, more=3), times[0])


def test_never_faster_than_without_boxes(base, rooms, times):
    known = base_of(base)
    for (_, poses), each in zip(rooms, times, strict=True):
        least = [[oracle.drive_time(known, oracle.Room(()), p, q) for q in poses] for p in poses]
        assert np.all(each >= np.array(least) - FLOAT32_BOUND)


def test_poses_may_share_turning_places_or_not(base, rooms, times):
    room, poses = rooms[1]
    roadmap = make_roadmap(base, room_of(room))
    ends = jax.jit(gates)(base, roadmap.space, poses)
    every = jax.jit(docked_drives.drive_times)(base, roadmap, ends, ends)
    np.testing.assert_allclose(every, times[1], atol=FLOAT32_BOUND)


def test_nose_to_the_table_it_backs_off_turns_and_comes_back(robot):
    """0.505 m from the table it can't turn; half its diagonal and 0.05 away it can."""
    room = oracle.Room(((0.0, 0.0, 0.0, 1.0, 0.4),))
    start, goal = np.array([[0.2, -0.905, math.pi / 2]]), np.array([[0.2, -0.905, 0.0]])
    back, quarter = math.hypot(0.4, 0.25) + 0.05 - 0.505, math.pi / 2
    expected = trapezoid(back, 0.5, 0.5) + trapezoid(quarter, 0.5, 1.0)
    there = np.array([[0.2, -0.4 - 0.505 - back, 0.0]])
    np.testing.assert_allclose(drives(robot, room, start, there), [[expected]], atol=FLOAT32_BOUND)
    # A quarter turn on the spot is not free: it has to come back lengthwise from the table's end.
    assert 2 * expected < drives(robot, room, start, goal)[0, 0] < math.inf


def test_driven_backwards_along_the_table_no_turn_is_needed(robot):
    room = oracle.Room(((0.0, 0.0, 0.0, 1.0, 0.4),))
    poses = np.array([[-0.5, 0.755, 0.0], [0.5, 0.755, 0.0]])
    straight = trapezoid(1.0, 0.5, 0.5)
    times = drives(robot, room, poses, poses)
    np.testing.assert_allclose(times, [[0.0, straight], [straight, 0.0]], atol=FLOAT32_BOUND)


def test_a_base_that_drives_sideways_need_not_turn(robot):
    room = oracle.Room(((0.0, 0.0, 0.0, 1.0, 0.4),))
    poses = np.array([[0.0, 0.755, 0.0], [0.0, 1.755, 0.0]])
    straight, quarter = trapezoid(1.0, 0.5, 0.5), trapezoid(math.pi / 2, 0.5, 1.0)
    times = [drives(each, room, poses, poses)[0, 1] for each in (docked_rooms.sideways(robot), robot)]
    assert times[0] == pytest.approx(straight, abs=1e-5)
    assert times[1] > straight + quarter


def test_behind_walls_is_unreachable(robot):
    walls = [(0.0, 1.5, 0.0, 1.6, 0.05), (0.0, -1.5, 0.0, 1.6, 0.05)]
    walls += [(1.5, 0.0, 0.0, 0.05, 1.6), (-1.5, 0.0, 0.0, 0.05, 1.6)]
    poses = np.array([[0.0, 0.0, 0.0], [0.3, 0.2, 1.0], [4.0, 0.0, 0.0]])
    times = drives(robot, oracle.Room(tuple(walls)), poses, poses)
    assert np.isfinite(times).tolist() == [[True, True, False], [True, True, False], [False, False, True]]
