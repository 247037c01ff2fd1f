"""Symmetries and bounds of navigation times, batches, tracing and derivatives."""

import itertools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from basenet_jax.config import NavigationConfig
from basenet_jax.robot.timing import trapezoid_duration
from basenet_jax.task.navigation import navigation_path, navigation_time
from basenet_jax.world.boxes import Room
from tests.task.navigation_pairs import FLOAT32_BOUND, navigate, on_the_edge, sample_pairs


@pytest.fixture(scope="module")
def pairs():
    return sample_pairs()


@pytest.fixture(scope="module")
def times(robot, room, pairs):
    return navigate(robot, room, *pairs)


@pytest.mark.parametrize(
    "image",
    [
        pytest.param(lambda p: p * [-1, 1, -1] + [0, 0, np.pi], id="mirrored in x"),
        pytest.param(lambda p: p * [1, -1, -1], id="mirrored in y"),
        pytest.param(lambda p: p * [-1, -1, 1] + [0, 0, np.pi], id="half a turn"),
        pytest.param(lambda p: p + np.array([0, 0, np.pi]), id="headings reversed"),
        pytest.param(lambda p: p + np.array([0, 0, 2 * np.pi]), id="headings a turn more"),
    ],
)
def test_symmetries(robot, pairs, image):
    # The table's symmetries; and a base that faces the other way drives the same way in the other gear.
    with jax.enable_x64(True):
        room = Room.from_config()
        times, images = (navigate(robot, room, *ends) for ends in (pairs, [image(p) for p in pairs]))
    # Headings are of 10 rad here, and rounded by 2e-15: 2 sqrt(4e-15) = 1.3e-7 s at each of four turns.
    doubtful = sum(on_the_edge(p, q) for p, q, bad in zip(*pairs, np.abs(times - images) > 6e-7, strict=True) if bad)
    assert np.sum(np.abs(times - images) > 6e-7) == doubtful <= 2


def test_way_back_takes_as_long(robot, room, pairs, times):
    # Backwards along the same polyline in the other gear, the base has the same headings and turns as much.
    back = navigate(robot, room, *pairs[::-1])
    np.testing.assert_allclose(back, times, atol=FLOAT32_BOUND)


def test_never_faster_than_straight(robot, room, pairs, times):
    # T is concave with T(0) = 0, so parts never take less than their sum; the turns add up to the heading difference.
    straight = navigate(robot, room, *pairs, config=NavigationConfig(straight=True))
    assert np.all(times >= straight - FLOAT32_BOUND)


def test_batches_broadcast(robot, room, pairs, times):
    starts, goals = (jnp.asarray(ends[:3], jnp.float32) for ends in pairs)
    grown = Room.of_table(
        half_size=jnp.tile(room.table_half_size, (3, 1, 1)), height=jnp.full((3, 1), room.table_height)
    )
    every = jax.jit(navigation_time)(robot, starts[:, None], goals[None], grown)
    assert every.shape == (3, 3)
    # The compiler contracts multiplications and additions differently for different shapes: equal but for rounding.
    np.testing.assert_allclose(np.diag(every), times[:3], atol=FLOAT32_BOUND)
    crossed = navigate(robot, room, np.repeat(starts, 3, axis=0), np.tile(goals, (3, 1)))
    np.testing.assert_allclose(every, crossed.reshape(3, 3), atol=FLOAT32_BOUND)


def test_traced_once(robot, room, pairs):
    chex.clear_trace_counter()
    traced = jax.jit(chex.assert_max_traces(navigation_time, n=1), static_argnums=4)
    for first in (0, 16, 32):
        starts, goals = (jnp.asarray(ends[first : first + 16], jnp.float32) for ends in pairs)
        traced(robot, starts, goals, room, NavigationConfig())


def test_derivatives_are_finite(robot, room, pairs):
    # No NaN even for poses at one place or at a via point, where lengths and T have no derivative.
    starts, goals = (jnp.asarray(ends[[*range(1425, 1500), *range(1900, 2000)]], jnp.float32) for ends in pairs)

    @jax.jit
    def directional(change):
        return jax.jvp(lambda goals: navigation_time(robot, starts, goals, room), (goals,), (change,))[1]

    assert np.all(np.isfinite(directional(jnp.ones_like(goals))))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.data())
def test_any_free_pair_is_reachable(robot, room, data):
    coordinate, heading = st.floats(-3.0, 3.0, width=32), st.floats(-4.0, 4.0, width=32)
    free = st.tuples(coordinate, coordinate, heading).filter(lambda p: abs(p[0]) > 1.25 or abs(p[1]) > 0.65)
    start, goal = (np.array(data.draw(free), np.float32) for _ in range(2))
    time = navigate(robot, room, start, goal)[0]
    # At most: two vias, three drives of 6.1 m and four turns of pi.
    assert 0.0 <= time < 3 * (6.1 / 0.5 + 1.0) + 4 * (np.pi / 0.5 + 0.5)


@pytest.mark.parametrize("seed", range(6))
def test_the_path_is_the_one_that_takes_the_navigation_time(robot, room, seed):
    """Driven leg by leg as straight drives with turns in between, it takes what `navigation_time` says."""
    rng = np.random.default_rng(seed)
    sides = np.array([[1, -1], [-1, 1]]) * np.array([1.0, 1.1])
    p, q = (np.array([*(side * rng.uniform(0.9, 1.5, 2)), rng.uniform(-3, 3)]) for side in sides)
    path = navigation_path(robot, p, q, room)
    np.testing.assert_allclose(path[[0, -1]], [p[:2], q[:2]], atol=1e-6)
    expected = float(navigation_time(robot, jnp.asarray(p), jnp.asarray(q), room))
    legs = np.diff(path, axis=0)
    directions = np.arctan2(legs[:, 1], legs[:, 0])
    times = []
    for gear in (0.0, np.pi):
        headings = [p[2], *(directions + gear), q[2]]
        turns = [(b - a + np.pi) % (2 * np.pi) - np.pi for a, b in itertools.pairwise(headings)]
        drives = sum(float(trapezoid_duration(jnp.hypot(*leg), 0.5, 0.5)) for leg in legs)
        times.append(drives + sum(float(trapezoid_duration(jnp.asarray(turn), 0.5, 1.0)) for turn in turns))
    assert min(times) == pytest.approx(expected, abs=5e-3)


def test_a_path_to_nowhere_is_refused(robot, room):
    with pytest.raises(ValueError, match="can't be reached"):
        navigation_path(robot, np.array([2.0, 1.0, 0.0]), np.array([0.0, 0.0, 0.0]), room)
