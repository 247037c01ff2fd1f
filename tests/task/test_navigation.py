"""Navigation times against brute force, and where the answer is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import NavigationConfig
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import base_collides
from tests.oracles import navigation as oracle
from tests.task.navigation_pairs import (
    FLOAT32_BOUND,
    FLOAT64_BOUND,
    HALF,
    free_poses,
    navigate,
    on_the_edge,
    rounded,
    sample_pairs,
)


@pytest.fixture(scope="module")
def pairs():
    return sample_pairs()


@pytest.fixture(scope="module")
def routes(pairs):
    return [oracle.navigate(p, q) for p, q in zip(*pairs, strict=True)]


@pytest.fixture(scope="module")
def times(robot, room, pairs):
    return navigate(robot, room, *pairs)


def check_against_oracle(times, pairs, routes, bound):
    """Agreement within the bound, but for the few pairs that rounding decides."""
    expected = np.array([route.time for route in routes])
    wrong = np.flatnonzero(~(np.abs(times - expected) <= bound))
    doubtful = [on_the_edge(pairs[0][i], pairs[1][i]) for i in wrong]
    assert all(doubtful), [(pairs[0][i], pairs[1][i], times[i], expected[i]) for i in wrong][:5]
    assert len(wrong) <= 0.002 * len(times)
    assert np.median(np.abs(times - expected)) < 1e-3 * bound


def test_agrees_with_brute_force(times, pairs, routes):
    check_against_oracle(times, pairs, routes, FLOAT32_BOUND)


def test_agrees_with_brute_force_in_float64(robot, pairs, routes):
    with jax.enable_x64(True):
        times = navigate(robot, Room.from_config(), *pairs)
    assert times.dtype == np.float64
    check_against_oracle(times, pairs, routes, FLOAT64_BOUND)


def test_without_reverse_it_agrees_with_brute_force_too(robot, room, pairs):
    some = (pairs[0][::8], pairs[1][::8])
    times = navigate(robot, room, some[0], some[1], NavigationConfig(reverse=False))
    routes = [oracle.navigate(p, q, gears=(0.0,)) for p, q in zip(*some, strict=True)]
    check_against_oracle(times, some, routes, FLOAT32_BOUND)
    faster = [oracle.navigate(p, q).time < route.time for p, q, route in zip(*some, routes, strict=True)]
    assert np.mean(faster) > 0.3, "says little"


def test_sample_uses_every_kind_of_way(routes):
    # Otherwise agreement would say little.
    corners = np.array([len(route.points) for route in routes])
    assert all(np.sum(corners == count) >= 50 for count in (1, 2, 3, 4))
    assert all(np.isfinite(route.time) for route in routes)


def test_never_through_the_table(routes, times):
    for route, time in zip(routes, times, strict=True):
        points = np.array(route.points)
        if len(points) < 2:
            continue
        t = np.linspace(0.0, 1.0, 101)[:, None, None]
        along = (1 - t) * points[:-1] + t * points[1:]
        assert np.all(np.any(np.abs(along) >= HALF + oracle.PATH_MARGIN - 1e-9, axis=-1))
        assert time >= np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / oracle.SPEED - FLOAT32_BOUND


def test_straight_option(robot, room, pairs):
    times = navigate(robot, room, *pairs, config=NavigationConfig(straight=True))
    expected = [oracle.navigate_straight(p, q) for p, q in zip(*pairs, strict=True)]
    np.testing.assert_allclose(times, expected, atol=FLOAT32_BOUND)
    assert np.median(np.abs(times - np.array(expected))) < 1e-6


def test_same_pose_takes_no_time(robot, room):
    pose = np.array([[2.0, 1.0, 3.1], [1.3, 0.0, -0.2], [1.45, 0.85, 0.0]])
    turn = np.array([0.0, 0.0, 2 * np.pi])
    for config in (NavigationConfig(), NavigationConfig(straight=True)):
        np.testing.assert_array_equal(navigate(robot, room, pose, pose, config=config), 0.0)
        np.testing.assert_array_equal(navigate(robot, room, pose, pose + turn, config=config), 0.0)


def test_known_times(robot, room):
    # 1 m ahead and 1 m back: 1/0.5 + 0.5/0.5; a quarter turn on the spot: (pi/2)/0.5 + 0.5/1.0; then both.
    start = jnp.array([0.0, 1.0, 0.0])
    goals = jnp.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 1.0, jnp.pi / 2], [1.0, 1.0, jnp.pi / 2]])
    quarter = jnp.pi + 0.5
    times = navigate(robot, room, start, goals)
    np.testing.assert_allclose(times, [3.0, 3.0, quarter, 3.0 + quarter], atol=FLOAT32_BOUND)


def test_to_the_other_side_over_two_vias(robot, room):
    # From the middle of one long side to the other's: the two corners of one short side are passed.
    half_way = np.array([np.hypot(1.45, 0.15), 1.7, np.hypot(1.45, 0.15)])
    turns = np.array([np.arctan2(0.15, 1.45), *2 * [np.pi / 2 + np.arctan2(0.15, 1.45)], np.arctan2(0.15, 1.45)])
    expected = np.sum(half_way / 0.5 + 1.0) + np.sum(np.where(turns < 0.25, 2 * np.sqrt(turns), turns / 0.5 + 0.5))
    start = np.array([0.0, 0.7, 0.0])
    times = navigate(robot, room, start, np.array([0.0, -0.7, 0.0]))[0]
    # The base arrives facing back, so that the other heading costs a longer turn.
    turned = navigate(robot, room, start, np.array([0.0, -0.7, np.pi]))[0]
    np.testing.assert_allclose(turned, expected, rtol=1e-5)
    assert times > turned


def test_inside_the_grown_table_is_unreachable(robot, room):
    inside, outside = jnp.array([0.5, 0.3, 0.0]), jnp.array([2.0, 1.0, 0.0])
    assert np.isinf(navigate(robot, room, outside, inside))
    assert np.isinf(navigate(robot, room, inside, outside))


def test_sizes_of_table_and_via_margins_count(robot):
    # A larger table is driven round at the larger distance; checked against brute force with that table.
    rng = np.random.default_rng(3)
    starts, goals = rounded(2 * free_poses(rng, 50)), rounded(2 * free_poses(rng, 50))
    size = np.array([2.6, 1.2])
    clear = [
        np.all(np.any(np.abs([p[:2], q[:2]]) > size / 2 + 0.25, axis=1)) for p, q in zip(starts, goals, strict=True)
    ]
    room = Room.of_table(half_size=jnp.asarray(size / 2), height=jnp.asarray(0.75))
    times = navigate(robot, room, starts, goals)
    expected = np.array([oracle.navigate(p, q, table=size).time for p, q in zip(starts, goals, strict=True)])
    np.testing.assert_allclose(times[clear], expected[clear], atol=FLOAT32_BOUND)
    assert np.sum(clear) > 30


@pytest.mark.parametrize("width", [0.12, 0.5, 0.9])
def test_a_base_of_any_width_drives_beside_the_table_wherever_it_may_park(robot, room, width):
    """Rule 1 keeps the base 0.1 m off: 1 cm farther it may park, and drive along, but not 1 cm inside of its half."""
    own = robot.replace(footprint_half_size=np.array([0.45, width / 2]))
    near, inside = 0.4 + 0.1 + width / 2 + 0.01, 0.4 + width / 2 - 0.01
    poses = np.array([[[-0.5, y, 0.0], [0.5, y, 0.0]] for y in (near, inside)], np.float32)
    times = navigate(own, room, poses[:, 0], poses[:, 1])
    assert times[0] == pytest.approx(1.0 / 0.5 + 0.5 / 0.5)
    assert not np.isfinite(times[1])
    assert not bool(base_collides(own, poses[0, 0], room))
