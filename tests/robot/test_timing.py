import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from basenet_jax.robot.kinematics import components
from basenet_jax.robot.timing import joint_move_duration, synchronised_duration, trapezoid_duration
from tests.oracles import timing as oracle

# float32: a quotient or a root and a sum.
RELATIVE = 1e-6

distance = st.floats(-20.0, 20.0, width=32)
speed = st.floats(0.125, 4.0, width=32)
acceleration = st.floats(0.125, 8.0, width=32)


def duration(d, v, a):
    return float(trapezoid_duration(jnp.float32(d), v, a))


@pytest.mark.parametrize(("v", "a"), [(0.5, 0.5), (0.5, 1.0), (1.0, 1.4), (2.0, 1.4)])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.99, 1.0, 1.01, 3.0])
def test_the_profile_of_this_duration_covers_the_distance(v, a, share):
    """Speed min(v, a t, a (T - t)) integrated: trapezia of 1e5 steps err by a T / steps at the two bends."""
    d = share * v * v / a
    total = duration(d, v, a)
    t = np.linspace(0.0, total, 100_001)
    covered = np.trapezoid(np.minimum(v, a * np.minimum(t, total - t)), t)
    assert covered == pytest.approx(d, rel=1e-5)


@given(d=distance, v=speed, a=acceleration)
def test_agrees_with_the_oracle(d, v, a):
    assert duration(d, v, a) == pytest.approx(oracle.trapezoid(d, v, a), rel=RELATIVE, abs=1e-12)


@given(d=distance, e=distance, v=speed, a=acceleration)
def test_farther_never_takes_less(d, e, v, a):
    near, far = sorted((abs(d), abs(e)))
    assert duration(near, v, a) <= duration(far, v, a) * (1 + RELATIVE)


@given(d=distance, v=speed, a=acceleration)
def test_back_takes_as_long_as_forth(d, v, a):
    assert duration(d, v, a) == duration(-d, v, a)


@given(v=speed, a=acceleration)
def test_continuous_where_the_triangle_becomes_a_trapezoid(v, a):
    """Both give 2 v / a there, and slope 1 / v."""
    switch = v * v / a
    for share in (1 - 1e-6, 1.0, 1 + 1e-6):
        assert duration(share * switch, v, a) == pytest.approx(2 * v / a, rel=3e-6)
    slope = jax.grad(trapezoid_duration)
    for share in (0.999, 1.001):  # the triangle's slope falls with the root of the distance: by 0.05 % here
        assert float(slope(jnp.float32(share * switch), v, a)) == pytest.approx(1 / v, rel=2e-3)


def test_nothing_takes_no_time_and_has_no_slope():
    assert duration(0.0, 1.0, 1.4) == 0.0
    value, slope = jax.value_and_grad(trapezoid_duration)(jnp.array(0.0), 1.0, 1.4)
    assert value == 0.0
    assert slope == 0.0


@pytest.mark.parametrize("d", [1e-30, 1e-12, 1e-3])
def test_short_moves_have_finite_slopes(d):
    slope = float(jax.grad(trapezoid_duration)(jnp.float32(d), 1.0, 1.4))
    assert slope == pytest.approx(1.0 / np.sqrt(1.4 * d), rel=1e-5)


def test_one_degree_of_the_base():
    """The number the world's definition warns of."""
    assert duration(np.radians(1.0), 0.5, 1.0) == pytest.approx(0.264, abs=1e-3)


def test_joint_moves_last_as_long_as_the_slowest_joint(robot):
    rng = np.random.default_rng(0)
    start, goal = rng.uniform(-6.0, 6.0, size=(2, 200, 6)).astype(np.float32)
    expected = [oracle.joint_move(a, b) for a, b in zip(start.astype(float), goal.astype(float), strict=True)]
    np.testing.assert_allclose(joint_move_duration(robot, start, goal), expected, rtol=RELATIVE)
    np.testing.assert_allclose(
        synchronised_duration(robot, components(start), components(goal)), expected, rtol=RELATIVE
    )


def test_joint_moves_dont_wrap(robot):
    """A whole turn of the pan joint takes its time: 2 pi / 1 + 1 / 1.4."""
    turn = joint_move_duration(robot, jnp.zeros(6), jnp.zeros(6).at[0].set(2 * jnp.pi))
    assert float(turn) == pytest.approx(2 * np.pi + 1 / 1.4, rel=RELATIVE)


def test_gradients_of_joint_moves_are_finite(robot):
    slope = jax.grad(lambda q: joint_move_duration(robot, q, q * 1.0).sum())(jnp.ones(6))
    assert np.all(np.isfinite(slope))
