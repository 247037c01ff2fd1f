"""Over the vias of the fastest drive one drives as fast as by searching; near to it, no faster."""

import jax
import numpy as np
import pytest

from basenet_jax.task.docked_drives import drive_times
from basenet_jax.task.gates import gates
from basenet_jax.task.near_drives import fastest_roads, times_over
from basenet_jax.task.roadmap import make_roadmap
from tests.task.docked_rooms import base_of, draw_poses, draw_room, room_of, sideways

FLOAT32_BOUND = 6e-3  # s, as in the tests of docked drives
POSES = 10


@jax.jit
def searched(robot, roadmap, start, goal):
    ends = [gates(robot, roadmap.space, poses) for poses in (start, goal)]
    return drive_times(robot, roadmap, *ends)


@jax.jit
def over_roads(robot, roadmap, route, moved):
    """Times over the roads of the drives along a route: of these, and between the same poses moved; and the roads."""
    ends, near = (gates(robot, roadmap.space, poses) for poses in (route, moved))
    roads = fastest_roads(robot, roadmap, ends)

    def leg(poses, index):
        before, after, road = jax.tree.map(lambda x: x[index], (poses, jax.tree.map(lambda x: x[1:], poses), roads))
        one = jax.tree.map(lambda x: x[None], (before, after))
        return times_over(robot, roadmap, one[0], one[1], road)[0, 0]

    legs = np.arange(len(route) - 1)
    return jax.lax.map(lambda i: leg(ends, i), legs), jax.lax.map(lambda i: leg(near, i), legs), roads


@pytest.mark.parametrize("omnidirectional", [False, True])
def test_drives_over_known_vias(robot, omnidirectional):
    robot, rng = sideways(robot) if omnidirectional else robot, np.random.default_rng(5)
    counts, worse = [], []
    for _ in range(6):
        known = draw_room(rng, 5)
        poses = draw_poses(rng, base_of(robot), known)[:-1].astype(np.float32)
        poses = np.concatenate([poses, poses[:1]])
        moved = (poses + rng.normal(size=poses.shape) * (0.03, 0.03, 0.02)).astype(np.float32)
        roadmap = make_roadmap(robot, room_of(known))
        own, near, roads = jax.device_get(over_roads(robot, roadmap, poses, moved))
        exact, near_exact = (np.diag(searched(robot, roadmap, each[:-1], each[1:])) for each in (poses, moved))
        np.testing.assert_array_equal(np.isfinite(own), np.isfinite(exact))
        there = np.isfinite(exact)
        np.testing.assert_allclose(own[there], exact[there], atol=FLOAT32_BOUND)
        assert np.all(near >= near_exact - FLOAT32_BOUND)
        counts += roads.count[there].tolist()
        worse += (near[there] > near_exact[there] + 0.1).tolist()
    assert max(counts) >= 2, "no drive over vias: the test would show little"
    assert np.mean(worse) < 0.5, "what is near can seldom be driven over the same vias"
