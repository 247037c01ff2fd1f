import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from basenet_jax.config import RefinementConfig, WorldConfig
from basenet_jax.planners import refined
from basenet_jax.planners.options import RefinedOptions
from basenet_jax.planners.protocol import assemble_plan
from basenet_jax.planners.refined import Refined
from basenet_jax.planners.refinement import alternatives, cheapest_path, reassign, refine
from basenet_jax.planners.route import as_plan, as_route, reason_by_slot
from basenet_jax.task.prepared_world import prepare_world
from tests import compiled

SMALL = RefinementConfig(rounds=4, slides=3, free=2, rigid=2)
judge = compiled.execute
move, assign = jax.jit(refine, static_argnames=("config", "world")), jax.jit(reassign, static_argnames="world")
shortest = jax.jit(cheapest_path)
propose = jax.jit(alternatives, static_argnames="config")


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31))
def test_no_combination_of_alternatives_is_cheaper(seed):
    generator = np.random.default_rng(seed)
    stops, options = 4, 3
    first, between, at = (
        generator.uniform(0, 5, shape).astype(np.float32)
        for shape in ((options,), (stops - 1, options, options), (stops, options))
    )
    at[generator.uniform(size=at.shape) < 0.2] = np.inf

    def cost_of(path):
        drives = sum(between[k, a, b] for k, (a, b) in enumerate(itertools.pairwise(path)))
        return first[path[0]] + drives + sum(at[k, a] for k, a in enumerate(path))

    choice, cost = shortest(first, between, at)
    best = min(cost_of(path) for path in itertools.product(range(options), repeat=stops))
    assert float(cost) == pytest.approx(best, rel=1e-6)
    if np.isfinite(best):
        assert cost_of(np.asarray(choice)) == pytest.approx(best, rel=1e-6)


def test_the_stop_itself_is_among_its_alternatives_to_the_bit():
    stops = jnp.array([[0.3, -0.9, 3.1], [1.0, -0.8, -3.1415927]])
    poses = propose(stops, jax.random.key(0), jnp.array(0.1), SMALL)
    np.testing.assert_array_equal(poses[:, 0], stops)


def test_slides_keep_heading_and_line():
    stops = jnp.array([[0.3, -0.9, 0.7]])
    poses = propose(stops, jax.random.key(0), jnp.array(0.1), SMALL)[0, 1 : 1 + SMALL.slides]
    np.testing.assert_array_equal(poses[:, 2], stops[0, 2])
    offset = poses[:, :2] - stops[0, :2]
    np.testing.assert_allclose(offset @ np.array([-np.sin(0.7), np.cos(0.7)]), 0.0, atol=1e-6)


def test_rigid_motions_keep_what_stops_are_to_each_other():
    stops = jnp.array([[0.3, -0.9, 0.7], [1.0, -0.8, 0.1], [-0.5, 1.0, 2.0]])
    poses = np.asarray(propose(stops, jax.random.key(0), jnp.array(0.1), SMALL))[:, -SMALL.rigid :]
    for index in range(SMALL.rigid):
        for a, b in itertools.combinations(range(3), 2):
            was, now = (rows[b, :2] - rows[a, :2] for rows in (np.asarray(stops), poses[:, index]))
            assert np.linalg.norm(now) == pytest.approx(np.linalg.norm(was), abs=1e-5)
        turns = poses[:, index, 2] - np.asarray(stops)[:, 2]
        np.testing.assert_allclose(turns, turns[0], atol=1e-5)


@pytest.fixture(scope="module", autouse=True)
def few_programs():
    """The planner's two steps of improvement are compiled apart, as the tests of each call them."""

    def refine_and_reassign(robot, scene, route, key, drives, chance, config, world):
        assert chance is None
        route, _ = move(robot, scene, route, key, drives, config.rounds, config=config, world=world)
        return route, assign(robot, scene, route, world=world)

    def execute(robot, scene, plan, drives, *, config):
        assert drives is None
        return compiled.execute(robot, scene, plan, config)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(refined, "compiled_execute", execute)
        patch.setattr(refined, "_refine", refine_and_reassign)
        yield


@pytest.fixture(scope="module")
def planner(setup):
    return Refined(setup, RefinedOptions(refinement=SMALL))


def test_every_plan_is_at_least_as_good_as_the_one_before(planner, robot, four_objects):
    plans = planner.improving_plans(four_objects, jax.random.key(0))
    outcomes = [judge(robot, four_objects, next(plans)) for _ in range(3)]
    assert [int(outcome.grasped) for outcome in outcomes] == [4, 4, 4]
    times = [float(outcome.execution) for outcome in outcomes]
    assert times[0] >= times[1] >= times[2]


def test_what_it_says_it_costs_is_what_the_judge_says(planner, setup, robot, four_objects):
    plan = next(planner.improving_plans(four_objects, jax.random.key(0)))
    before = judge(robot, four_objects, plan)
    given = (robot, four_objects, as_route(plan), jax.random.key(1), setup.drives, 4)
    route, cost = move(*given, config=SMALL, world=WorldConfig())
    after = judge(robot, four_objects, as_plan(four_objects, route, reason_by_slot(plan)))
    assert float(cost) == pytest.approx(float(after.execution), abs=2e-3)
    assert float(after.execution) <= float(before.execution) + 1e-3


def test_reassigned_objects_are_picked_no_slower(planner, robot, four_objects):
    plan = next(planner.improving_plans(four_objects, jax.random.key(0)))
    route = as_route(plan)
    better = as_plan(four_objects, assign(robot, four_objects, route, world=WorldConfig()), reason_by_slot(plan))
    assert float(judge(robot, four_objects, better).picking) <= float(judge(robot, four_objects, plan).picking) + 1e-4


@pytest.mark.parametrize("detour_s", [-30.0, 30.0])
def test_an_idle_stop_is_left_out_only_if_that_is_no_worse(planner, four_objects, monkeypatch, detour_s):
    """Drives break the triangle inequality: here the way takes so much longer where the second stop is left out."""
    here, there = np.array([0.3, -0.9, 0.1], np.float32), np.array([0.6, -0.9, 0.1], np.float32)
    none = np.zeros(4, int)
    plan = assemble_plan(four_objects, np.arange(4), np.stack([here, here, there, there]), none)

    def refine_and_reassign(robot, scene, route, *_, **__):
        del robot, scene
        return route, route._replace(stop_of=jnp.zeros_like(route.stop_of))  # everything from the first stop

    def worth(scene, plan):
        del scene
        stops = len(np.unique(np.asarray(plan.base_pose), axis=0))
        return 4, -(50.0 + (detour_s if stops == 1 else 0.0))

    monkeypatch.setattr(refined, "_refine", refine_and_reassign)
    monkeypatch.setattr(planner, "_worth", worth)
    improved = planner.improve(four_objects, plan, jax.random.key(0))
    assert worth(four_objects, improved) == max(worth(four_objects, plan), (4, -50.0 - detour_s))


def test_the_same_key_gives_the_same_plan(planner, four_objects):
    first, second = (planner(four_objects, jax.random.key(3)) for _ in range(2))
    jax.tree.map(np.testing.assert_array_equal, first, second)


@pytest.mark.parametrize(("budget_s", "rounds"), [(0.0, [1, 1, 1]), (1e-9, [2, 1, 2])])
def test_what_a_budget_is_spent_on_is_compiled_by_the_first_call(setup, four_objects, monkeypatch, budget_s, rounds):
    taken = []

    def improving_plans(self, scene, key):
        del self, key
        taken.append(0)
        while True:
            taken[-1] += 1
            yield assemble_plan(scene, np.flatnonzero(scene.mask), np.zeros((scene.mask.sum(), 3)), scene.mask * 0)

    monkeypatch.setattr(Refined, "improving_plans", improving_plans)
    planner = Refined(setup, RefinedOptions(budget_s=budget_s))
    three = dataclasses.replace(four_objects, mask=np.arange(6) < 3)
    for scene in (four_objects, four_objects, three):
        planner(scene, jax.random.key(0))
    assert taken == rounds


def test_what_only_the_grid_can_serve_is_served(setup, four_objects, monkeypatch):
    planner = Refined(setup, RefinedOptions(refinement=SMALL))
    few = prepare_world(setup.robot, setup.drives, planner._stops.poses[:8])  # at one corner
    monkeypatch.setattr(planner, "_stops", few)
    plan = planner(four_objects, jax.random.key(0))
    assert int(np.sum(plan.served)) == 4
    assert int(judge(setup.robot, four_objects, plan).grasped) == 4
