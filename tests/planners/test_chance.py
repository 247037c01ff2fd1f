"""Robust planning: planners choose among reliable picks alone, and without errors nothing changes."""

import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.config import UncertaintyConfig, WorldConfig
from basenet_jax.planners.basenet import BaSeNet
from basenet_jax.planners.chance import reliable
from basenet_jax.planners.greedy_stops import GreedyStops
from basenet_jax.planners.options import RefinedOptions, StopsOptions
from basenet_jax.planners.refined import Refined
from basenet_jax.policies.trained import untrained_stops
from basenet_jax.task.reliability import Chance, actual_picks, compiled_plan_reliability, reliability
from tests import compiled

UNCERTAINTY = UncertaintyConfig(sd_xy_m=0.07, sd_heading_rad=0.1, draws=16)
KEY = jax.random.key(0)
_reliability = jax.jit(reliability, static_argnames=("config", "fine"))


@pytest.fixture(scope="module")
def chance():
    return Chance.of(UNCERTAINTY, 0.9)


@pytest.fixture(scope="module")
def sure_setup(setup, chance):
    return dataclasses.replace(setup, chance=chance)


@pytest.fixture(scope="module")
def scenes(random_scene):
    return [random_scene(seed) for seed in range(3)]


def shares(setup, scene, plan, chance):
    """By slot: how sure each served step's pick is."""
    actual = actual_picks(setup.world.pick, UNCERTAINTY)
    return np.asarray(compiled_plan_reliability(setup.robot, scene, plan, chance.errors, config=actual))


@pytest.fixture(scope="module")
def candidates(setup, scenes):
    found = compiled.check_candidates(setup.robot, scenes[0], setup.grid_poses)
    useful = np.flatnonzero(found.serves.any(axis=1))[:64]
    first = {name: getattr(found, name)[useful] for name in ("base_pose", "serves", "pick_time")}
    return dataclasses.replace(found, **first)


@pytest.mark.parametrize("level", [0.9, 1.0])
def test_the_pairs_left_are_the_reliable_ones_or_the_most_reliable(setup, scenes, candidates, level):
    chance = Chance.of(UNCERTAINTY, level)
    left = jax.device_get(reliable(setup.robot, scenes[0], candidates, chance, world=WorldConfig()))
    stops, slots = candidates.serves.shape
    pose, slot = np.repeat(candidates.base_pose, slots, axis=0), np.tile(np.arange(slots), stops)
    actual = actual_picks(setup.world.pick, UNCERTAINTY)
    share = np.asarray(_reliability(setup.robot, scenes[0], pose, slot, chance.errors, config=actual))
    share = np.where(candidates.serves, share.reshape(stops, slots), -1.0)
    wanted = candidates.serves & (share >= np.minimum(float(chance.level), share.max(axis=0)) - 1e-6)
    np.testing.assert_array_equal(left.serves, wanted)
    np.testing.assert_array_equal(left.pick_time, np.where(wanted, candidates.pick_time, np.inf))
    np.testing.assert_array_equal(left.reason, candidates.reason)
    assert 0 < np.sum(wanted) < np.sum(candidates.serves)
    if level == 1.0:
        assert np.any(share.max(axis=0)[candidates.serves.any(axis=0)] < 1.0), "no object lacks a sure pick"


def test_a_greedy_planner_is_reliable_where_it_can_be(setup, sure_setup, scenes, chance):
    sure, usual = GreedyStops(sure_setup), GreedyStops(setup)
    better = 0
    for scene in scenes:
        found, before = ([shares(setup, scene, plan(scene, KEY), chance)] for plan in (sure, usual))
        assert np.sum(found) >= np.sum(before) - 1e-6
        better += np.sum(found) > np.sum(before)
    assert better


@pytest.fixture(scope="module")
def learned(sure_setup):
    return BaSeNet(sure_setup, StopsOptions(aligned=compiled.ALIGNED), params=untrained_stops())


def test_the_learned_planner_is_reliable_and_grasps_everything(setup, learned, scenes, chance):
    for scene in scenes:
        plan = learned(scene, KEY)
        assert int(compiled.execute(setup.robot, scene, plan).grasped) == len(scene.mask)
        assert np.all(chance.holds(shares(setup, scene, plan, chance)))


@pytest.mark.slow
def test_a_batch_is_planned_as_reliably(setup, learned, scenes, chance):
    batch = jax.tree.map(lambda *x: np.stack(x), *scenes)
    plans = learned.plan_batch(batch, KEY)
    for row, scene in enumerate(scenes):
        plan = jax.tree.map(lambda x, row=row: x[row], plans)
        np.testing.assert_allclose(plan.base_pose, learned(scene, KEY).base_pose, atol=1e-5)
        assert np.all(chance.holds(shares(setup, scene, plan, chance)))


@pytest.mark.slow
def test_refined_stops_stay_reliable(sure_setup, setup, scenes, chance):
    planner = Refined(sure_setup, RefinedOptions(aligned=compiled.ALIGNED))
    for scene in scenes:
        plan = planner(scene, KEY)
        assert int(compiled.execute(setup.robot, scene, plan).grasped) == len(scene.mask)
        assert np.all(chance.holds(shares(setup, scene, plan, chance)))
