"""Moves keep the limits of every joint, at the samples and for whatever interpolates between them."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from basenet_jax.robot.reading import load_robot
from basenet_jax.robot.time_law import TimeLaw, fastest_law, joint_move_law
from tests.oracles import timing as oracle

SMOOTHING = 0.01  # s
RATE = 50.0  # Hz
ROUNDING = 1e-9  # float64: sums of third powers of a few seconds, divided by the smoothing

limit = st.floats(0.02, 50.0)
smoothing = st.sampled_from([0.0, 0.001, SMOOTHING, 0.5])


@st.composite
def moves(draw):
    """A robot's name and two joint states; some joints keep still, some move by very little."""
    robot = load_robot(draw(st.sampled_from(["ur5e_mobile", "panda_mobile"])))
    states = [
        [
            draw(st.floats(float(low), float(high)))
            for low, high in zip(robot.joint_lower, robot.joint_upper, strict=True)
        ]
        for _ in range(2)
    ]
    start, goal = np.array(states)
    share = np.array([draw(st.sampled_from([0.0, 1e-6, 1.0, 1.0, 1.0])) for _ in start])
    return robot.name, start.tolist(), (start + share * (goal - start)).tolist()


def read(move):
    """The move with its robot; by name, examples that fail are short."""
    name, start, goal = move
    return load_robot(name), np.array(start), np.array(goal)


def quintics(times, states):
    """Values and two derivatives, at nine points each, of quintics through (value, speed, acceleration) at times."""
    duration, powers = np.diff(times), np.arange(6)
    shares = np.linspace(0.0, 1.0, 9)

    def row(time, order):
        factor = [math.perm(power, order) for power in powers]
        return factor * np.where(powers >= order, time[..., None] ** np.maximum(powers - order, 0), 0.0)

    # In units of each interval's duration, so that the system is well conditioned.
    units = duration[:, None] ** np.arange(3)
    system = np.array([row(time, order) for time in (np.zeros(()), np.ones(())) for order in range(3)])
    ends = np.concatenate([states[:-1] * units, states[1:] * units], axis=1)
    coefficients = np.linalg.solve(system, ends.T).T
    return [coefficients @ np.transpose(row(shares, order)) / units[:, order, None] for order in range(3)]


@given(speed=limit, acceleration=limit, smoothing_s=smoothing)
def test_a_law_is_the_integral_of_its_acceleration(speed, acceleration, smoothing_s):
    law = fastest_law(speed, acceleration, smoothing_s)
    knots = law.switches
    time = np.unique(np.concatenate([np.linspace(*pair, 401) for pair in itertools.pairwise(knots)]))
    share, rate, accel = law.at(time)
    middle = law.at((time[1:] + time[:-1]) / 2)  # exact for the linear acceleration, and the parabola by Simpson's rule
    np.testing.assert_allclose(np.diff(rate), middle.acceleration * np.diff(time), atol=1e-6 * max(speed, 1.0))
    simpson = (rate[1:] + 4 * middle.speed + rate[:-1]) / 6 * np.diff(time)
    np.testing.assert_allclose(np.diff(share), simpson, atol=1e-7)
    assert (share[0], rate[0], share[-1], rate[-1]) == (0.0, 0.0, 1.0, 0.0)
    assert np.all(np.diff(share) >= -ROUNDING)
    assert np.abs(accel).max() <= acceleration * (1 + 1e-6)
    assert rate.max() <= speed * (1 + 1e-6)


@given(speed=limit, acceleration=limit, smoothing_s=smoothing)
def test_no_law_within_the_limits_is_faster_but_for_its_smoothing(speed, acceleration, smoothing_s):
    law = fastest_law(speed, acceleration, smoothing_s)
    assert law.duration_s == pytest.approx(oracle.trapezoid(1.0, speed, acceleration) + smoothing_s, rel=1e-12)
    assert law.switches[[0, -1]].tolist() == pytest.approx([0.0, law.duration_s])


def test_nothing_is_done_before_and_all_is_after():
    law = TimeLaw(0.5, 1.0, SMOOTHING)
    assert law.at(-1.0).share == 0.0
    assert law.at(99.0).share == 1.0
    assert law.at(np.zeros((2, 3))).share.shape == (2, 3)
    assert float(law.at(1.0 + SMOOTHING / 2).share) == pytest.approx(0.5)


@given(move=moves(), smoothing_s=smoothing)
def test_joints_move_together_within_their_limits(move, smoothing_s):
    robot, start, goal = read(move)
    law = joint_move_law(robot, start, goal, smoothing_s)
    if law is None:
        np.testing.assert_allclose(start, goal, rtol=0, atol=1e-12)
        return
    _, speed, acceleration = (np.outer(each, goal - start) for each in law.at(law.sample_times(RATE)))
    assert np.all(np.abs(speed) <= robot.joint_speed * (1 + 1e-6) + ROUNDING)
    assert np.all(np.abs(acceleration) <= robot.joint_acceleration * (1 + 1e-6) + ROUNDING)
    times = law.sample_times(RATE)
    assert (times[0], times[-1]) == (0.0, pytest.approx(law.duration_s))
    assert np.all(np.diff(times) > 0)
    assert np.diff(times).max() <= 1.2 / RATE + ROUNDING


@given(move=moves())
def test_the_slowest_joint_sets_the_duration(move):
    """More than the slowest needs only if one joint is held up by its speed, another by its acceleration."""
    robot, start, goal = read(move)
    law = joint_move_law(robot, start, goal)
    assume(law is not None)
    assert law is not None  # for the type checker
    own = [
        oracle.trapezoid(*each) for each in zip(goal - start, robot.joint_speed, robot.joint_acceleration, strict=True)
    ]
    assert law.duration_s >= max(own) * (1 - 1e-9)
    distance = np.maximum(np.abs(goal - start), 1e-300)
    tightest = [int(np.argmin(each / distance)) for each in (robot.joint_speed, robot.joint_acceleration)]
    if len(set(tightest)) == 1:
        assert law.duration_s == pytest.approx(max(own), rel=1e-9)
    assert law.duration_s <= 2 * max(own)  # its ramps and its cruise are each no longer than some joint's own move


@given(move=moves())
def test_splines_between_the_samples_keep_the_limits(move):
    """What controllers do: lines through positions, cubics through speeds too, quintics through accelerations too."""
    robot, start, goal = read(move)
    law = joint_move_law(robot, start, goal, SMOOTHING)
    assume(law is not None)
    assert law is not None  # for the type checker
    times = law.sample_times(RATE)
    # All joints are multiples of one law: the tightest one is enough.
    distance = np.abs(goal - start)
    speed, acceleration = (
        np.min(each[distance > 1e-12] / distance[distance > 1e-12])
        for each in (robot.joint_speed, robot.joint_acceleration)
    )
    states = np.stack(law.at(times), axis=1)
    assert np.all(np.diff(states[:, 0]) <= speed * np.diff(times) * (1 + 1e-6) + 1e-12)
    long = np.diff(times) > 1e-5  # a spline over next to nothing is all rounding
    values, rates, accelerations = (each[long] for each in quintics(times, states))
    assert np.abs(rates).max() <= speed * (1 + 1e-6)
    assert np.abs(accelerations).max() <= acceleration * (1 + 1e-4)
    between = times[:-1, None] + np.diff(times)[:, None] * np.linspace(0.0, 1.0, 9)
    np.testing.assert_allclose(values, law.at(between[long]).share, atol=1e-9)


def test_without_smoothing_a_quintic_passes_the_acceleration_limit():
    """Why there is smoothing: where the acceleration jumps, such a spline overshoots by more than a third."""
    law = fastest_law(0.5, 1.0)
    times = law.sample_times(RATE)
    accelerations = quintics(times, np.stack(law.at(times), axis=1))[2]
    assert 1.3 < np.abs(accelerations).max() < 1.4
