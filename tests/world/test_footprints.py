"""Rectangles on the floor, beside polygons."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from basenet_jax.geometry import rectangle_gap, relative
from basenet_jax.world.footprints import extent, rectangle_gaps, within
from tests.oracles.clearance import polygon_distance
from tests.oracles.occupancy_map import inside_box

place = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-7, 7)).map(np.array)
half_size = st.tuples(st.floats(0.01, 1.5), st.floats(0.01, 1.5)).map(np.array)


def corners(pose, half):
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    return (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half) @ turn.T + pose[:2]


@given(place, half_size, place, half_size)
def test_a_gap_is_there_just_if_polygons_are_apart(pose, half, other, other_half):
    gap = rectangle_gaps(pose[None], half[None], other[None], other_half[None])[0, 0]
    distance = polygon_distance(corners(pose, half), corners(other, other_half))
    assert gap <= distance + 1e-9
    assert (gap > 1e-9) <= (distance > 0)
    assert (gap < -1e-9) <= (distance == 0)


def test_gaps_are_those_of_the_compiled_kernel():
    rng = np.random.default_rng(0)
    pose, other = rng.uniform(-2, 2, (2, 30, 3))
    half, other_half = rng.uniform(0.1, 1, (2, 30, 2))
    gaps = rectangle_gaps(pose, half, other, other_half)
    expected = rectangle_gap(relative(other, pose[:, None]), half[:, None], other_half)
    np.testing.assert_allclose(gaps, expected, atol=2e-6)  # float32 at some metres


@given(place, half_size, st.tuples(st.floats(-3, 3), st.floats(-3, 3)), st.floats(0, 0.5))
def test_points_are_within_just_if_they_are_inside_the_grown_rectangle(pose, half, point, margin):
    inner, outer = (within(np.array([point]), pose[None], half[None], margin + d)[0, 0] for d in (-1e-9, 1e-9))
    assert inner <= inside_box(point, pose, half + margin) <= outer


@given(place, half_size)
def test_extents_are_those_of_the_corners(pose, half):
    found = corners(pose, half)
    expected = np.concatenate([found.min(axis=0), found.max(axis=0)])
    np.testing.assert_allclose(extent(pose, half), expected, atol=1e-12)
    np.testing.assert_allclose(extent(np.stack([pose] * 2), half)[1], expected, atol=1e-12)
