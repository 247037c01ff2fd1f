"""Which objects may stand beside one another: by the sampling rule, and by real rectangles for objects of own sizes."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from basenet_jax.world.scene import OBJECT_CLASSES
from basenet_jax.world.spacing import Footprints, gaps
from tests.oracles.clearance import polygon_distance

MOST_RADIUS, TOLERANCE = 0.09, 1e-3  # m
ROUNDING = 1e-5  # m: float32 of places on a table of 3 m

place = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-4.0, 4.0))
side = st.floats(0.001, 2.0)
size = st.tuples(side, side, st.just(0.1))


def overlapping(first, second) -> bool:
    """Of two objects (pose, size, whether of own size)."""
    (one, other) = (Footprints(*map(np.array, ([leaf] for leaf in each)), crowded=False) for each in (first, second))
    return bool(gaps(one, other)[0, 0] < 0)


def corners(pose, size, shrunk):
    local = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (np.array(size[:2]) / 2 - shrunk)
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    return local @ turn.T + pose[:2]


@settings(max_examples=200)
@given(first=place, second=place, sizes=st.tuples(size, size))
def test_rectangles_of_own_sizes_stand_apart(first, second, sizes):
    """Polygons that overlap by more than the tolerance are never let stand; neither are centres that are too near."""
    poses = (np.array(first), np.array(second))
    assume(min(min(each[:2]) for each in sizes) > 0.01)
    inside = (
        polygon_distance(*(corners(p, s, TOLERANCE / 2 + ROUNDING) for p, s in zip(poses, sizes, strict=True))) == 0
    )
    needed = sum(min(np.hypot(*each[:2]) / 2, MOST_RADIUS) for each in sizes) - TOLERANCE
    distance = np.hypot(*(poses[1] - poses[0])[:2])
    assume(abs(distance - needed) > ROUNDING)
    found = overlapping((poses[0], sizes[0], True), (poses[1], sizes[1], False))
    if inside or distance < needed:
        assert found
    elif polygon_distance(*(corners(p, s, 0.0) for p, s in zip(poses, sizes, strict=True))) > 0:
        assert not found


@settings(max_examples=200)
@given(first=place, second=place, sizes=st.tuples(size, size), own=st.tuples(st.booleans(), st.booleans()))
def test_in_rooms_objects_stand_as_close_as_their_rectangles(first, second, sizes, own):
    poses = (np.array(first), np.array(second))
    assume(min(min(each[:2]) for each in sizes) > 0.01)
    one, other = (
        Footprints(pose[None], np.array([each]), np.array([of_own]), crowded=True)
        for pose, each, of_own in zip(poses, sizes, own, strict=True)
    )
    found = bool(gaps(one, other)[0, 0] < 0)
    needed = sum(min(np.hypot(*each[:2]) / 2, MOST_RADIUS) for each in sizes) - TOLERANCE
    distance = np.hypot(*(poses[1] - poses[0])[:2])
    assume(abs(distance - needed) > ROUNDING)
    if polygon_distance(*(corners(p, s, 0.0) for p, s in zip(poses, sizes, strict=True))) > 0:
        assert not found
    deep = polygon_distance(*(corners(p, s, TOLERANCE / 2 + ROUNDING) for p, s in zip(poses, sizes, strict=True)))
    if deep == 0:
        assert found == (any(own) or distance < needed)


@settings(max_examples=100)
@given(first=place, second=place, kinds=st.tuples(*[st.sampled_from(OBJECT_CLASSES)] * 2))
def test_packaged_classes_keep_the_sampling_rule_and_nothing_more(first, second, kinds):
    """Bowls are round: squares about them may overlap."""
    needed = sum(min(np.hypot(*kind.size[:2]) / 2, MOST_RADIUS) for kind in kinds) - TOLERANCE
    distance = np.hypot(*(np.array(second) - np.array(first))[:2])
    assume(abs(distance - needed) > ROUNDING)
    objects = ((np.array(pose), kind.size, False) for pose, kind in zip((first, second), kinds, strict=True))
    assert overlapping(*objects) == (distance < needed)


@pytest.mark.parametrize(("yaw", "apart", "expected"), [(0.0, 0.18, True), (0.0, 0.41, False), (np.pi / 4, 0.48, True)])
def test_wide_objects(yaw, apart, expected):
    """Two of 0.4 m; turned, the corner of one reaches 0.28 m."""
    wide = (0.4, 0.4, 0.1)
    assert overlapping((np.array([0.0, 0.0, yaw]), wide, True), (np.array([apart, 0.0, 0.0]), wide, True)) == expected
