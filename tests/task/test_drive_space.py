"""Points, roads and swept footprints among boxes, against polygons."""

import math

import jax
import numpy as np
import pytest

from basenet_jax.task.drive_space import drive_space, first_turning_place, footprint_fits, is_free, is_turning_place
from tests.oracles import docked_drives as oracle
from tests.task.docked_rooms import base_of, draw_room, room_of

CASES = 400


@pytest.fixture(scope="module")
def known():
    return draw_room(np.random.default_rng(4), 4)


@pytest.fixture(scope="module")
def space(robot, known):
    return drive_space(robot, room_of(known, more=1))


@pytest.fixture(scope="module")
def points(known):
    rng = np.random.default_rng(5)
    return np.float32(rng.uniform(known.floor[:2], known.floor[2:], (2, CASES, 2))).astype(float)


def split(points):
    return points[..., 0], points[..., 1]


def agree(ours, expected):
    """Random geometry is hardly ever decided by rounding; and the sample has enough of either."""
    assert 0.05 < np.mean(expected) < 0.95
    np.testing.assert_array_equal(np.asarray(ours), expected)


def test_turning_places(robot, known, space, points):
    base = base_of(robot)
    expected = [oracle.turning_place(base, known, tuple(point)) for point in points[0].tolist()]
    agree(jax.jit(is_turning_place)(space, split(points[0])), expected)


def test_roads(robot, known, space, points):
    ends = zip(*(map(tuple, each.tolist()) for each in points), strict=True)
    expected = [oracle.piece_free(base_of(robot), known, a, b) for a, b in ends]
    agree(jax.jit(is_free)(space, *map(split, points)), expected)


@pytest.mark.parametrize("askew", [False, True])
def test_swept_footprints(robot, known, space, points, askew):
    base = base_of(robot)
    rng = np.random.default_rng(6)
    start, end = points[0], points[0] + 0.3 * (points[1] - points[0])
    direction = np.arctan2(*(end - start).T[::-1])
    heading = rng.uniform(-math.pi, math.pi, CASES) if askew else direction
    sweeps = zip(*(map(tuple, each.tolist()) for each in (start, end)), heading.tolist(), strict=True)
    expected = [oracle.sweep_free(base, known, a, b, angle) for a, b, angle in sweeps]
    fits = jax.jit(footprint_fits, static_argnames="askew")
    middle, half_way = split(0.5 * (start + end)), split(0.5 * (end - start))
    agree(fits(space, middle, (np.cos(heading), np.sin(heading)), half_way, askew=askew), expected)


def test_footprints_at_rest(robot, known, space, points):
    heading = np.random.default_rng(7).uniform(-math.pi, math.pi, CASES)
    for askew in (False, True):
        fits = jax.jit(footprint_fits, static_argnames="askew")
        ours = fits(space, split(points[0]), (np.cos(heading), np.sin(heading)), askew=askew)
        places = zip(map(tuple, points[0].tolist()), heading.tolist(), strict=True)
        agree(ours, [oracle.sweep_free(base_of(robot), known, a, a, angle) for a, angle in places])


def test_the_first_turning_place_on_a_ray(robot, known, space, points):
    """Every millimetre is looked at; along the axes too, where a ray runs along the sides of boxes."""
    base = base_of(robot)
    angles = np.random.default_rng(8).uniform(-math.pi, math.pi, 60)
    angles[::3] = np.arange(20) * math.pi / 2
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    ours = np.asarray(jax.jit(first_turning_place)(space, split(points[0, :60]), split(rays)))
    for start, ray, distance in zip(points[0, :60], rays, ours, strict=True):
        steps = np.arange(0.0, oracle.UNDOCK, 1e-3)
        there = (t for t in steps if oracle.turning_place(base, known, tuple((start + t * ray).tolist())))
        # Points are tested 1 mm nearer to boxes: along a ray that leaves one at a slant that is more.
        assert distance - 1e-2 <= next(there, math.inf) <= distance + 1e-3
    assert np.sum((ours > 0) & (ours < math.inf)) > 5
    assert np.any(np.isinf(ours))
