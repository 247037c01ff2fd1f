"""Reliability against a plain loop over the draws, each judged by the public `pick`."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import PickConfig, UncertaintyConfig
from basenet_jax.task.reliability import (
    Chance,
    Tried,
    actual_picks,
    draw_errors,
    reliability,
    reliable_pairs,
    try_pairs,
)
from basenet_jax.world.scene import OBJECT_CLASSES
from tests import compiled

OBJECTS, STOPS, DRAWS = 6, 10, 12
# The clearance of planning, so that `pick` is the program that other tests compiled.
UNCERTAINTY = UncertaintyConfig(
    sd_xy_m=0.06, sd_heading_rad=0.08, sd_object_m=0.02, sd_object_rad=0.3, draws=DRAWS, base_clearance_m=0.1
)
CONFIG = actual_picks(PickConfig(), UNCERTAINTY)

_reliability = jax.jit(reliability, static_argnames=("config", "fine"))
_try_pairs = jax.jit(try_pairs, static_argnames=("config", "fine", "pairs_at_once"))


@pytest.fixture(scope="module")
def scene(room):
    return compiled.draw_scene(3, OBJECTS, room)


@pytest.fixture(scope="module")
def errors():
    return draw_errors(jax.random.key(5), UNCERTAINTY)


@pytest.fixture(scope="module")
def stops():
    """Some beside the table's long sides, 0 to 12 cm farther off than the base must be."""
    rng = np.random.default_rng(0)
    side = np.where(np.arange(STOPS) % 2, 1.0, -1.0)
    y = side * (0.4 + 0.1 + 0.25 + rng.uniform(0.001, 0.12, STOPS))
    heading = np.where(np.arange(STOPS) % 3, 0.0, np.pi - 0.02)
    return np.column_stack([rng.uniform(-0.9, 0.9, STOPS), y, heading]).astype(np.float32)


def composed(pose, error):
    """A pose of SE(2), and one in its frame, in float64."""
    (x, y, heading), (dx, dy, turn) = np.asarray(pose, float), np.asarray(error, float)
    sine, cosine = math.sin(heading), math.cos(heading)
    return np.array([x + cosine * dx - sine * dy, y + sine * dx + cosine * dy, heading + turn])


def seen_grasp(scene, slot, error):
    """tool0's x, y, z, yaw at the top-down grasp of an object that is seen with an error."""
    kind = OBJECT_CLASSES[int(scene.object_class[slot])]
    x, y, yaw = composed(scene.object_pose[slot], error)
    z = 0.75 + kind.size[2] / 2 + kind.grasp_z
    return np.array([x + math.cos(yaw) * kind.grasp_x, y + math.sin(yaw) * kind.grasp_x, z, yaw + kind.grasp_yaw])


@pytest.fixture(scope="module")
def failures(robot, room, scene, stops, errors):
    """By stop, object and draw, whether the pick is infeasible, from a loop over all of them."""
    rows = [
        (composed(stop, base), seen_grasp(scene, slot, seen))
        for stop in stops
        for slot in range(OBJECTS)
        for base, seen in zip(np.asarray(errors.base), np.asarray(errors.seen), strict=True)
    ]
    poses, grasps = (np.array(each, np.float32) for each in zip(*rows, strict=True))
    return ~compiled.pick(robot, poses, grasps, room).feasible.reshape(STOPS, OBJECTS, DRAWS)


def rate(robot, scene, stops, errors, *, fine):
    pose, slot = np.repeat(stops, OBJECTS, axis=0), np.tile(np.arange(OBJECTS), STOPS)
    return np.asarray(_reliability(robot, scene, pose, slot, errors, config=CONFIG, fine=fine)).reshape(STOPS, OBJECTS)


def test_is_the_share_of_draws_in_which_pick_says_yes(robot, scene, stops, errors, failures):
    found = rate(robot, scene, stops, errors, fine=True)
    # A pick at the very edge of a rule may be decided otherwise by float32's rounding of poses.
    apart = np.abs(found - (1.0 - failures.mean(axis=-1)))
    assert np.max(apart) <= 1.0 / DRAWS + 1e-6
    assert np.mean(apart > 1e-6) <= 0.02
    assert 0.1 < np.mean(found) < 0.9
    assert np.sum((found > 0) & (found < 1)) >= 10  # or the sample would say little


def test_the_coarse_way_bounds_the_fine_one_and_is_near(robot, scene, stops, errors, failures):
    coarse, fine = (rate(robot, scene, stops, errors, fine=which) for which in (False, True))
    assert np.all(coarse >= fine - 1e-6)
    assert np.mean(np.abs(coarse - fine)) < 0.02


@pytest.mark.parametrize("allowed", [0, 3, DRAWS])
def test_the_search_finds_the_reliable_pairs_and_the_best_of_those_objects_that_have_none(
    robot, scene, stops, errors, allowed
):
    chosen = np.random.default_rng(1).random((STOPS, OBJECTS)) < 0.8
    chosen[:, 2] = False  # an object that no stop serves
    failed = np.round(DRAWS * (1.0 - rate(robot, scene, stops, errors, fine=True))).astype(int)
    tried = _try_pairs(robot, scene, stops, chosen, errors, config=CONFIG, allowed=allowed, pairs_at_once=16)
    found = np.asarray(reliable_pairs(tried, jnp.asarray(chosen), allowed, DRAWS))
    best = np.min(np.where(chosen, failed, DRAWS), axis=0)
    np.testing.assert_array_equal(found, chosen & (failed <= np.maximum(best, allowed)))
    done = np.asarray(tried.drawn) == DRAWS
    np.testing.assert_array_equal(np.asarray(tried.failed)[done & chosen], failed[done & chosen])
    np.testing.assert_array_equal(np.asarray(tried.drawn)[~chosen], 0)
    if allowed == 0:
        assert np.any(best[best < DRAWS] > 0), "no object lacks a sure pick"
        assert np.sum(np.asarray(tried.drawn)) < DRAWS * np.sum(chosen), "nothing was spared"


def test_pairs_that_were_given_up_are_not_reliable():
    tried = Tried(jnp.array([[0, 3], [1, 0]]), jnp.array([[8, 8], [8, 4]]))
    chosen = jnp.ones((2, 2), bool)
    np.testing.assert_array_equal(reliable_pairs(tried, chosen, 0, 8), [[True, True], [False, False]])
    np.testing.assert_array_equal(reliable_pairs(tried, chosen, 1, 8), [[True, True], [True, False]])


def test_draws_are_normal_in_their_spreads_and_the_largest_come_first():
    config = UncertaintyConfig(sd_xy_m=0.03, sd_heading_rad=0.05, sd_object_m=0.01, sd_object_rad=0.1, draws=4096)
    errors = jax.device_get(draw_errors(jax.random.key(1), config))
    spreads = np.array([[0.03, 0.03, 0.05], [0.01, 0.01, 0.1]])
    for own, spread in zip((errors.base, errors.seen), spreads, strict=True):
        # Of 4,096 draws: five standard errors, of the mean and of the standard deviation.
        np.testing.assert_allclose(np.mean(own, axis=0) / spread, 0.0, atol=5 / 64)
        np.testing.assert_allclose(np.std(own, axis=0) / spread, 1.0, atol=5 / 64 / math.sqrt(2))
    sizes = np.sum((errors.base / spreads[0]) ** 2, axis=-1)
    assert np.all(np.diff(sizes) <= 1e-5)
    assert abs(np.corrcoef(np.column_stack([errors.base, errors.seen]).T)[0, 3]) < 5 / 64


@pytest.mark.parametrize(("level", "allowed"), [(1.0, 0), (0.95, 3), (0.9375, 4), (0.0, 64)])
def test_a_level_allows_whole_draws(level, allowed):
    chance = Chance.of(UncertaintyConfig(), level)
    assert int(chance.allowed) == allowed
    assert float(chance.level) == pytest.approx(1 - allowed / 64)


def test_the_draws_are_the_same_for_the_same_seed():
    errors = [Chance.of(dataclasses.replace(UNCERTAINTY, seed=seed), 0.9).errors.base for seed in (0, 0, 1)]
    np.testing.assert_array_equal(errors[0], errors[1])
    assert np.any(errors[0] != errors[2])
