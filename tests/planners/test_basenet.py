"""The learned planner, with an untrained policy: it begins as a sound rule, and every promise holds for any weights."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import AlignedConfig
from basenet_jax.planners import basenet
from basenet_jax.planners.basenet import BaSeNet
from basenet_jax.planners.exact_sequence import best_sequence
from basenet_jax.planners.options import SampleOptions, StopsOptions
from basenet_jax.planners.stop_problem import stop_problem
from basenet_jax.policies.trained import untrained_stops
from basenet_jax.task.picking import Reason
from tests import compiled

SPARSE = compiled.ALIGNED
FAR = AlignedConfig(step_m=0.58, gap_m=0.4)  # as many, so far away that some objects can not be picked from any
KEY = jax.random.key(0)

judge, check_candidates = compiled.execute, compiled.check_candidates


@pytest.fixture(scope="module")
def params():
    return untrained_stops()


@pytest.fixture(scope="module")
def greedy(setup, params):
    return BaSeNet(setup, StopsOptions(aligned=SPARSE), params=params)


@pytest.fixture(scope="module")
def sampled(setup, params):
    return BaSeNet(setup, SampleOptions(aligned=SPARSE, samples=128), params=params)


@pytest.fixture(scope="module")
def scenes(random_scene):
    return [random_scene(seed) for seed in range(4)]


def visits(plan):
    """The stops in order, each once."""
    poses = np.asarray(plan.base_pose)[np.asarray(plan.served)]
    return 1 + int(np.sum(np.any(poses[1:] != poses[:-1], axis=1)))


def test_every_object_is_grasped_and_stops_are_shared(greedy, setup, scenes):
    for scene in scenes:
        plan = greedy(scene, KEY)
        assert sorted(np.asarray(plan.object_index)) == list(range(len(scene.mask)))
        assert bool(np.all(plan.served))
        assert int(judge(setup.robot, scene, plan).grasped) == len(scene.mask)
        assert visits(plan) < len(scene.mask)


def test_the_key_does_not_matter_to_a_greedy_rollout(greedy, scenes):
    first, second = (greedy(scenes[0], jax.random.key(seed)) for seed in (1, 2))
    jax.tree.map(np.testing.assert_array_equal, first, second)


def test_samples_are_never_worse_and_sometimes_better(greedy, sampled, setup, scenes):
    gain = []
    for scene in scenes:
        alone, best = (judge(setup.robot, scene, planner(scene, KEY)).execution for planner in (greedy, sampled))
        gain.append(float(alone - best))
    assert min(gain) > -1e-3
    assert max(gain) > 0.01


def test_no_plan_is_better_than_the_exact_one_over_the_same_stops(greedy, sampled, setup, scenes):
    for scene in scenes:
        candidates = check_candidates(setup.robot, scene, greedy.stops, world=setup.world)
        problem = stop_problem(setup.robot, setup.drives, scene, candidates)
        exact = problem.plan(scene, *jax.device_get(jax.jit(best_sequence)(*problem.costs)))
        least = float(judge(setup.robot, scene, exact).execution)
        for planner in (greedy, sampled):
            cost = float(judge(setup.robot, scene, planner(scene, KEY)).execution)
            assert least - 1e-3 <= cost <= 1.3 * least


@pytest.mark.parametrize("planner", ["greedy", pytest.param("sampled", marks=pytest.mark.slow)])
def test_a_batch_is_planned_as_each_scene_alone(planner, scenes, request):
    planner = request.getfixturevalue(planner)
    batch = jax.tree.map(lambda *x: jnp.stack(x), *scenes)
    together = planner.plan_batch(batch, KEY)
    alone = [planner(scene, key) for scene, key in zip(scenes, jax.random.split(KEY, len(scenes)), strict=True)]
    jax.tree.map(np.testing.assert_array_equal, together, jax.tree.map(lambda *x: jnp.stack(x), *alone))


def test_a_large_batch_goes_in_several_calls(greedy, scenes, monkeypatch):
    """Six scenes in calls of four: the second is filled up."""
    monkeypatch.setattr(basenet, "_BATCH", 4)
    which = np.array([0, 1, 2, 3, 2, 0])
    batch = jax.tree.map(lambda *x: jnp.stack(x), *scenes)
    expected = jax.tree.map(lambda x: x[which], greedy.plan_batch(batch, KEY))
    many = jax.tree.map(lambda x: x[which], batch)
    jax.tree.map(np.testing.assert_array_equal, greedy.plan_batch(many, KEY), expected)


def test_what_is_in_empty_slots_changes_nothing(greedy, random_scene, spoilt):
    scene = random_scene(9, 4)
    plain, other = greedy(scene, KEY), greedy(spoilt(scene), KEY)
    jax.tree.map(np.testing.assert_array_equal, plain, other)
    assert sorted(plain.object_index[:4].tolist()) == [0, 1, 2, 3]
    np.testing.assert_array_equal(plain.object_index[4:], -1)
    np.testing.assert_array_equal(plain.served, [True] * 4 + [False] * 2)


def test_what_the_stops_can_not_serve_the_grid_may(setup, params, scenes):
    planner = BaSeNet(setup, StopsOptions(aligned=FAR), params=params)
    plans = planner.plan_batch(jax.tree.map(lambda *x: jnp.stack(x), *scenes), KEY)
    missed = 0
    for index, scene in enumerate(scenes):
        aligned = check_candidates(setup.robot, scene, planner.stops, world=setup.world)
        missed += int(np.sum(~np.any(np.asarray(aligned.serves), axis=0)))
        plan = jax.tree.map(lambda x, index=index: x[index], plans)
        assert int(judge(setup.robot, scene, plan).grasped) == len(scene.mask)
    assert missed, "the stops serve everything, so this shows nothing"


def test_what_nothing_can_serve_comes_last_with_its_reason(greedy, setup, scenes, hopeless):
    scene = hopeless(scenes[0], [1, 4])
    plan = greedy(scene, KEY)
    assert set(np.asarray(plan.object_index[-2:])) == {1, 4}
    np.testing.assert_array_equal(plan.served, [True] * 4 + [False] * 2)
    np.testing.assert_array_equal(plan.reason[-2:], int(Reason.OUT_OF_REACH))
    assert int(judge(setup.robot, scene, plan).grasped) == 4


def test_drives_from_the_grid_are_costed_only_where_it_helps(greedy, scenes, hopeless, monkeypatch):
    def unwanted(*_):
        raise AssertionError("costed")

    monkeypatch.setattr(greedy, "_prepare", unwanted)
    assert int(np.sum(greedy(hopeless(scenes[0], [1, 4]), KEY).served)) == 4


def test_nothing_at_all_can_be_served(greedy, setup, scenes, hopeless):
    scene = hopeless(scenes[0], range(6))
    plan = greedy(scene, KEY)
    assert not np.any(plan.served)
    assert float(judge(setup.robot, scene, plan).execution) == 0.0
