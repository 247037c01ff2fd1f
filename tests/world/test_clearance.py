import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import base_collides, segment_box_distance
from tests import compiled
from tests.oracles import arm as arm_oracle
from tests.oracles import clearance as oracle
from tests.world.states import random_states

# float32 coordinates of at most 3 m and the roots of sums of their squares.
FLOAT32 = 2e-6

HALF = (1.0, 0.4, 0.375)
# Multiples of 5 cm put many ends exactly on the planes of the box's faces, and many segments parallel to them.
coordinate = st.one_of(st.floats(-3.0, 3.0, width=32), st.integers(-30, 30).map(lambda k: np.float32(k * 0.05)))
point = st.tuples(coordinate, coordinate, coordinate)
half_size = st.tuples(*[st.floats(0.0625, 2.0, width=32)] * 3)

measure = jax.jit(segment_box_distance)


def distance(start, end, half=HALF):
    """The kernel's."""
    return np.asarray(measure(*(tuple(jnp.float32(c) for c in vector) for vector in (start, end, half))))


def by_interval_search(start, end, half):
    """float64 oracle: the distance to a convex body is convex along a segment, so thirds of an interval can be cut."""
    start, end, half = (np.asarray(vector, float) for vector in (start, end, half))

    def at(t):
        point = start + t * (end - start)
        return np.linalg.norm(point - np.clip(point, -half, half))

    low, high = 0.0, 1.0
    for _ in range(90):
        left, right = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, right) if at(left) <= at(right) else (left, high)
    return min(at(0.0), at((low + high) / 2), at(1.0))


@given(start=point, end=point, half=half_size)
def test_distance_is_the_least_over_the_segment(start, end, half):
    assert distance(start, end, half) == pytest.approx(by_interval_search(start, end, half), abs=FLOAT32)


def test_distance_over_many_segments():
    """Dense, against the other oracle of the tests: a grid refined by golden sections."""
    rng = np.random.default_rng(0)
    start, end = rng.uniform(-2.0, 2.0, size=(2, 20_000, 3)).astype(np.float32)
    expected = oracle._least_distance(start.astype(float), end.astype(float), np.array(HALF), 16)
    vectors = (tuple(vector.T) for vector in (start, end))
    np.testing.assert_allclose(measure(*vectors, HALF), expected, atol=FLOAT32)
    assert 0.1 < np.mean(expected == 0.0) < 0.9


@given(start=point, end=point)
def test_distance_doesnt_depend_on_the_segments_direction(start, end):
    assert distance(start, end) == pytest.approx(distance(end, start), abs=FLOAT32)


@given(start=point, end=point, axis=st.integers(0, 2))
def test_distance_is_symmetric_about_the_boxs_planes(start, end, axis):
    def mirror(vector):
        return [-c if index == axis else c for index, c in enumerate(vector)]

    assert distance(mirror(start), mirror(end)) == distance(start, end)


@given(start=point, end=point, order=st.permutations(range(3)))
def test_distance_treats_all_axes_alike(start, end, order):
    permuted = ([vector[k] for k in order] for vector in (start, end, HALF))
    assert distance(*permuted) == pytest.approx(distance(start, end), abs=FLOAT32)


@given(start=point, end=point, t=st.floats(0.0, 1.0))
def test_a_part_of_a_segment_is_no_nearer(start, end, t):
    middle = [a + t * (b - a) for a, b in zip(start, end, strict=True)]
    assert distance(start, middle) >= distance(start, end) - FLOAT32


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0), 0.0),  # begins on a face
        ((-2.0, 0.0, 0.0), (2.0, 0.0, 0.0), 0.0),  # both ends outside, through the box
        ((0.1, 0.1, 0.1), (0.2, 0.1, 0.1), 0.0),  # inside
        ((0.5, 0.0, 0.875), (0.5, 0.0, 0.875), 0.5),  # a point
        ((1.3, 0.8, -5.0), (1.3, 0.8, 5.0), 0.5),  # beside an edge, along it
        ((1.5, -2.0, 0.0), (1.5, 2.0, 0.0), 0.5),  # along a face
        ((1.0 + 0.2, 0.4 + 0.1, 0.375 + 0.2), (3.0, 3.0, 3.0), 0.3),  # from a corner
    ],
)
def test_known_distances(start, end, expected):
    assert distance(start, end) == pytest.approx(expected, abs=1e-6)


def test_kernels_agree_with_the_oracle(robot, room):
    """The oracle knows the arm by its DH parameters and the base by its corners, not by the MJCF."""
    states = random_states(np.random.default_rng(8), 250).astype(np.float32)
    base, joints = states[:, :3], states[:, 3:]
    touches_base = compiled.base_collides(robot, base, room)
    touches_arm = compiled.arm_collides(robot, base, joints, room)
    for index in range(len(states)):
        clearance = oracle.base_clearance(base[index].astype(float))
        if abs(clearance - 1e-5) > FLOAT32:
            assert touches_base[index] == (clearance <= 1e-5)
        segments = arm_oracle.capsules(joints[index].astype(float), base[index].astype(float))
        gap = np.min(oracle.capsule_clearance(segments, base[index], (2.0, 0.8), 0.75) - arm_oracle.RADII)
        if abs(gap) > 5e-6:  # nine joints in float32
            assert touches_arm[index] == (gap <= 0.0)
    assert 0.2 < touches_arm.mean() < 0.5


@pytest.mark.parametrize(("gap", "touches"), [(0.0, True), (0.8e-5, True), (1.2e-5, False)])
def test_base_that_just_touches_counts(robot, room, gap, touches):
    for side_x, side_y in itertools.product((1.0, -1.0), repeat=2):
        along = [side_x * (1.0 + 0.10 + 0.40 + gap), side_y * 0.3, 0.0]
        across = [side_x * 0.7, side_y * (0.4 + 0.10 + 0.40 + gap), np.pi / 2]
        for pose in (along, across):
            with jax.enable_x64(True):  # float32 knows 1.5 m to 1e-7 only
                assert base_collides(robot, jnp.array(pose), Room.from_config()) == touches
