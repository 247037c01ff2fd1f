import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from basenet_jax.geometry import compose, rectangles_overlap, relative
from tests.oracles.clearance import polygon_distance

# float32 sums of a few lengths of at most 4 m.
FLOAT32 = 3e-6

position = st.floats(-3.0, 3.0, width=32)
angle = st.one_of(st.floats(-4.0, 4.0, width=32), st.sampled_from([0.0, np.pi / 4, np.pi / 2, np.pi]))
pose = st.tuples(position, position, angle)
half_size = st.tuples(st.floats(0.125, 1.5, width=32), st.floats(0.125, 1.5, width=32))

overlap = jax.jit(rectangles_overlap)


def corners(pose, half):
    """Counter-clockwise, float64."""
    x, y, heading = (float(value) for value in pose)
    local = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.asarray(half, float)
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    return local @ turn.T + (x, y)


@given(pose=pose, half=half_size, other=half_size)
def test_overlap_is_that_of_the_polygons(pose, half, other):
    """By the polygons' corners and edges; a gap between two corners isn't the axes' gap, so touching is 0 here."""
    gap = polygon_distance(corners(pose, half), corners((0.0, 0.0, 0.0), other))
    found = bool(overlap(jnp.array(pose), jnp.array(half), jnp.array(other), 0.0))
    shrunk, grown = ([h + d for h in other] for d in (-FLOAT32, FLOAT32))
    origin = (0.0, 0.0, 0.0)
    if gap > 0.0:
        assume(polygon_distance(corners(pose, half), corners(origin, grown)) > 0.0)
    else:
        assume(polygon_distance(corners(pose, half), corners(origin, shrunk)) == 0.0)
    assert found == (gap == 0.0)


@given(pose=pose, half=half_size, other=half_size)
def test_overlap_is_mutual(pose, half, other):
    """The second rectangle seen from the first."""
    inverse = relative(jnp.array(pose), jnp.zeros(3))
    both = [
        bool(overlap(p, jnp.array(a), jnp.array(b), touching))
        for p, a, b in ((jnp.array(pose), half, other), (inverse, other, half))
        for touching in (-FLOAT32, FLOAT32)
    ]
    assume(both[0] == both[1])  # rounding decides
    assert both[0] == both[2] or both[2] != both[3]


@pytest.mark.parametrize(("gap", "touching", "expected"), [(0.0, 0.0, True), (0.5, 0.5, True), (0.5, 0.25, False)])
def test_touching_counts(gap, touching, expected):
    for bearing in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        pose = jnp.array([*(component * (1.5 + 0.5 + gap) for component in bearing), 0.0])  # exact in float32
        assert overlap(pose, jnp.array([0.5, 0.5]), jnp.array([1.5, 1.5]), touching) == expected


def test_a_corner_between_the_others_corners_is_seen():
    """Neither rectangle's axes alone tell that a turned square misses another one's corner."""
    square = jnp.array([1.0, 1.0])
    assert not overlap(jnp.array([1.75, 1.75, np.pi / 4]), square, square, 0.0)
    assert overlap(jnp.array([1.70, 1.70, np.pi / 4]), square, square, 0.0)


@given(first=pose, second=pose)
def test_relative_undoes_compose(first, second):
    first, second = jnp.array(first), jnp.array(second)
    result = relative(first, compose(first, second))
    np.testing.assert_allclose(result[:2], second[:2], atol=FLOAT32)
    turn = result[2] - second[2]
    np.testing.assert_allclose([np.cos(turn), np.sin(turn)], [1.0, 0.0], atol=FLOAT32)
    assert abs(result[2]) <= np.pi + FLOAT32


def test_compose_by_matrices():
    rng = np.random.default_rng(1)
    a, b = rng.uniform(-3.0, 3.0, size=(2, 3))

    def matrix(pose):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])

    np.testing.assert_allclose(matrix(compose(jnp.array(a), jnp.array(b))), matrix(a) @ matrix(b), atol=FLOAT32)
