"""Drives behind one face: which kind a room has, and that all ways to ask for them give the same."""

import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.config import NavigationConfig
from basenet_jax.task.drives import DockedDrives, PointDrives, make_drives
from basenet_jax.task.navigation import navigation_time
from basenet_jax.task.prepared_world import prepare_world
from basenet_jax.world.boxes import pad
from tests.task.docked_rooms import base_of, draw_poses, draw_room, room_of

BOUND = 1e-3  # s, float32


@pytest.fixture(scope="module")
def docked(robot):
    """Drives in a room of boxes, and poses there."""
    rng = np.random.default_rng(8)
    known = draw_room(rng, 3)
    return make_drives(robot, room_of(known)), draw_poses(rng, base_of(robot), known)[:4].astype(np.float32)


def test_one_table_has_drives_of_a_point_and_other_rooms_docked_ones(robot, room):
    more = dataclasses.replace(room, boxes=pad(room.boxes, 16))
    kinds = {"by-room": (PointDrives, DockedDrives), "docked": (DockedDrives, DockedDrives)}
    for rule, (alone, among) in kinds.items():
        config = NavigationConfig(drives=rule)  # pyright: ignore[reportArgumentType]
        assert isinstance(make_drives(robot, room, config), alone)
        assert isinstance(make_drives(robot, more, config), among)
    assert isinstance(make_drives(robot, room, NavigationConfig(drives="point")), PointDrives)
    with pytest.raises(ValueError, match="drives: found point in a room, allowed is docked"):
        make_drives(robot, more, NavigationConfig(drives="point"))


def test_a_roadmap_is_made_once_for_a_room(robot, room):
    first, second = (make_drives(robot, room, NavigationConfig(drives="docked")) for _ in range(2))
    assert isinstance(first, DockedDrives)
    assert isinstance(second, DockedDrives)
    assert first.roadmap is second.roadmap


def test_single_drives_of_a_point_are_those_round_the_table(robot, room):
    poses = np.array([[0.3, -0.9, 0.0], [0.2, 1.0, 1.5], [1.6, 0.3, 3.0]], np.float32)
    drives = PointDrives(room, NavigationConfig())
    times = jax.jit(drives.each)(robot, poses[:, None], poses)
    np.testing.assert_array_equal(times, jax.jit(navigation_time)(robot, poses[:, None], poses, room))
    np.testing.assert_allclose(drives.matrix(robot, poses, poses), times, atol=BOUND)
    assert drives.manoeuvre(robot, poses[0], poses[1]).time_s == pytest.approx(float(times[0, 1]), abs=BOUND)


def test_docked_drives_are_the_same_one_by_one_and_all_together(robot, docked):
    drives, poses = docked
    matrix = np.asarray(drives.matrix(robot, poses, poses))
    each = jax.jit(lambda start, goal: drives.each(robot, start, goal))(poses[:, None], poses)
    np.testing.assert_allclose(each, matrix, atol=BOUND)
    assert np.any(np.isfinite(matrix[~np.eye(len(poses), dtype=bool)])), "says little"
    start, goal = np.argwhere(np.isfinite(matrix) & (matrix > 0))[0]
    taken = drives.manoeuvre(robot, poses[start], poses[goal]).time_s
    assert taken == pytest.approx(float(matrix[start, goal]), abs=BOUND)


def test_a_prepared_world_knows_the_drives_from_anywhere(robot, docked):
    drives, poses = docked
    prepared = prepare_world(robot, drives, poses)
    np.testing.assert_allclose(prepared.first_drives(robot, poses), prepared.drive, atol=BOUND)
