"""What poses offer to whoever drives from them, against brute force."""

import math

import jax
import numpy as np
import pytest

from basenet_jax.task.drive_space import drive_space
from basenet_jax.task.gates import gates
from tests.oracles import docked_drives as oracle
from tests.task import docked_rooms
from tests.task.docked_rooms import base_of, draw_poses, draw_room, room_of

FINE = math.radians(0.02)


@pytest.fixture(scope="module", params=["differential", "omnidirectional"])
def base(request, robot):
    return docked_rooms.sideways(robot) if request.param == "omnidirectional" else robot


@pytest.fixture(scope="module")
def rows(base):
    """(room, pose, its gates)"""
    rng, rows = np.random.default_rng(9), []
    for count in (2, 3, 4, 5):
        room = draw_room(rng, count)
        poses = draw_poses(rng, base_of(base), room)
        ends = jax.device_get(jax.jit(gates)(base, drive_space(base, room_of(room, more=6 - count)), poses))
        rows += [(room, pose, jax.tree.map(lambda x, i=i: x[i], ends)) for i, pose in enumerate(poses)]
    return rows


def test_turning_places(base, rows):
    for room, pose, ends in rows:
        expected = dict.fromkeys((np.round(place, 4).tolist()[0], time) for time, place in _gates(base, room, pose))
        ours = [(place, time) for place, time in zip(ends.place, ends.time, strict=True) if np.isfinite(time)]
        assert len(ours) == len(expected)
        times = sorted(time for _, time in expected)
        np.testing.assert_allclose(sorted(time for _, time in ours), times, atol=5e-3)
        for place, _ in ours:
            assert oracle.turning_place(base_of(base), room, tuple(place.tolist()))
            ahead = np.hypot(*(place - pose[:2])) * np.array([math.cos(pose[2]), math.sin(pose[2])])
            across = abs(ahead[0] * (place - pose[:2])[1] - ahead[1] * (place - pose[:2])[0])
            assert base.omnidirectional or across < 1e-4


def _gates(base, room, pose):
    return oracle._gates(base_of(base), room, tuple(pose.tolist()))


def test_free_turns(base, rows):
    """Turned a little less than is free it fits, a little more and it doesn't."""
    stopped = 0
    for room, pose, ends in rows:
        for sign, free in ((1.0, float(ends.left)), (-1.0, float(ends.right))):

            def fits(angle, room=room, pose=pose, sign=sign):
                there = (*pose[:2], pose[2] + sign * angle)
                return oracle.sweep_free(base_of(base), room, pose[:2], pose[:2], there[2])

            if free < 0.0:
                assert not fits(0.0)
            elif free == math.inf:
                assert all(map(fits, np.arange(0.0, math.pi, math.radians(3.0))))
            else:
                stopped += 1
                assert fits(max(free - FINE, 0.0))
                assert not fits(free + FINE)
    assert stopped > 10
