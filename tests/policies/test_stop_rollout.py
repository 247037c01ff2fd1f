"""Episodes: their cost is the judge's, everything is served, and the gradient is the exact one."""

import dataclasses
import itertools
from typing import Any

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.planners.protocol import assemble_plan
from basenet_jax.policies.stop_policy import StopPolicy, make_scene
from basenet_jax.policies.stop_rollout import (
    END,
    cheapest,
    choices_gradient,
    choose_best,
    choose_randomly,
    plan_of,
    plans_of,
    play,
    repeated,
    sample,
    start,
    visit,
)
from basenet_jax.task.drives import make_drives
from basenet_jax.task.stop_problem import make_problem
from tests import compiled
from tests.policies.test_stop_policy import changed, made_up

POLICY = StopPolicy(features=8, considered=12)


@jax.jit
def sampled(params, scenes, key):
    return play(POLICY, params, scenes, choose_randomly(key))


@jax.jit
def greedy(params, scene):
    return play(POLICY, params, scene, choose_best)


def shaken(scene, scale=0.3, policy=POLICY):
    """Parameters that follow no rule."""
    params = jax.jit(policy.init)(jax.random.key(0), scene, start(scene))
    rng = np.random.default_rng(2)
    return jax.tree.map(lambda leaf: np.asarray(leaf + scale * rng.normal(size=leaf.shape), np.float32), params)


@pytest.fixture(scope="module")
def case():
    scene = made_up(7)
    return scene, shaken(scene)


def test_cost_is_the_judges(robot, room):
    """On a real scene with an empty slot: the plan's cost is N + G of its execution, and everything is grasped."""
    scene = compiled.draw_scene(4, 3, room, slots=4)
    poses = jnp.asarray(aligned_poses(robot, room, compiled.ALIGNED))
    drive = jnp.asarray(make_drives(robot, room).matrix(robot, poses, poses))
    picks = compiled.check_candidates(robot, scene, poses).pick_time
    first_drive = jnp.asarray(compiled.navigation_time(robot, scene.robot_start, poses, room))
    problem = make_problem(poses, drive, picks, first_drive, scene.mask)
    many = repeated(make_scene(problem, scene.robot_start, scene.first_grasp), 3)
    visited = sampled(shaken(many), many, jax.random.key(0))
    plans = plans_of(many.problem, visited)
    for stops, picked_at, cost in zip(*map(np.asarray, (plans.stops, plans.picked_at, plans.cost)), strict=True):
        order = np.argsort(picked_at, kind="stable")[np.sum(picked_at < 0) :]
        plan = assemble_plan(scene, order, np.asarray(poses)[stops[picked_at[order]]], np.zeros(4, int))
        outcome = compiled.execute(robot, scene, plan)
        assert int(outcome.grasped) == 3
        assert float(outcome.execution) == pytest.approx(float(cost), abs=2e-2)


def test_everything_is_served_within_as_many_stops_as_objects(case):
    scene, params = case
    many = repeated(scene, 64)
    visited = np.asarray(sampled(params, many, jax.random.key(2)))
    plans = plans_of(many.problem, jnp.asarray(visited))
    assert np.all(np.isfinite(plans.cost))
    assert np.all(plans.picked_at >= 0)
    assert np.all((visited[:, 1:] == END) | (visited[:, :-1] != END)), "a stop after the end"
    assert len(np.unique(visited, axis=0)) > 8, "hardly random"


def test_plan_of_drops_idle_stops_and_adds_up(case):
    problem = case[0].problem
    pick, drive, first = (np.asarray(x) for x in (problem.pick_time, problem.drive, problem.first_drive))
    for seed in range(20):
        visited = np.append(0, np.random.default_rng(seed).permutation(np.arange(1, 20))[:3])
        plan = plan_of(problem, jnp.asarray(visited))
        best = pick[visited].argmin(axis=0)
        used = [int(stop) for place, stop in enumerate(visited) if place in best]
        expected = pick[visited].min(axis=0).sum() + first[used[0]]
        expected += sum(drive[a, b] for a, b in itertools.pairwise(used))
        assert float(plan.cost) == pytest.approx(expected, abs=1e-4)
        np.testing.assert_array_equal(plan.stops[plan.stops != END], used)
        np.testing.assert_array_equal(plan.picked_at, best)


def test_a_plan_that_misses_an_object_costs_infinitely_much(case):
    assert np.isinf(plan_of(case[0].problem, jnp.full(4, END)).cost)


def test_the_best_sample_is_never_worse_than_greedy(case):
    scene, params = case
    cost = float(plan_of(scene.problem, greedy(params, scene)).cost)

    @jax.jit(static_argnames="samples")
    def least(key, samples):
        return cheapest(scene.problem, sample(POLICY, params, scene, key, samples)).cost

    assert float(least(jax.random.key(0), samples=0)) == pytest.approx(cost)
    costs = [float(least(jax.random.key(seed), samples=16)) for seed in range(4)]
    assert max(costs) <= cost + 1e-4
    assert min(costs) < cost - 0.1, "samples never help: the test would show nothing"


def test_padding_changes_no_greedy_episode(case):
    scene, params = case
    padded = dataclasses.replace(
        scene,
        access=jnp.pad(scene.access, ((0, 0), (0, 2)), constant_values=1.0),
        grasps=jnp.pad(scene.grasps, ((0, 2), (0, 0)), constant_values=7.0),
    )
    padded = changed(
        padded,
        pick_time=jnp.pad(scene.problem.pick_time, ((0, 0), (0, 2)), constant_values=2.0),
        mask=jnp.pad(scene.problem.mask, (0, 2)),
    )
    ours, theirs = greedy(params, scene), greedy(params, padded)
    np.testing.assert_array_equal(theirs, np.append(ours, [END, END]))


def sequences(stops):
    """All of two choices of stop or END; nothing comes after END."""
    choices = [END, *range(stops)]
    return np.array([(a, b) for a, b in itertools.product(choices, choices) if a != END or b == END])


def test_gradient_is_that_of_the_expected_cost_by_enumeration():
    """Over all sequences, `choices_gradient` weighted by -P cost against autodiff of the sum of P cost."""
    policy = StopPolicy(features=4, layers=1, considered=5)
    scene = made_up(3, stops=5, objects=2)
    params = shaken(scene, policy=policy)
    visited = jnp.asarray(sequences(5))
    many = repeated(scene, len(visited))

    def chances(params):
        state, chance, going = start(many), jnp.ones(len(visited)), jnp.ones(len(visited), bool)
        for stop in visited.T:
            logits: Any = policy.apply(params, many, state)
            share = jax.nn.softmax(jnp.concatenate([logits[0], logits[1][:, None]], axis=-1))
            own = jnp.take_along_axis(share, jnp.where(stop == END, 5, stop)[:, None], axis=1)[:, 0]
            chance = chance * jnp.where(going, own, 1.0)
            state, going = visit(many.problem, state, stop), going & (stop != END)
        return chance

    chance = jax.jit(chances)(params)
    assert float(jnp.sum(chance)) == pytest.approx(1.0, abs=1e-5)
    cost = plans_of(many.problem, visited).cost
    cost = jnp.where(chance > 0, cost, 0.0)
    assert np.all(np.isfinite(cost))
    assert float(jnp.std(cost[chance > 0])) > 0.1, "all cost the same: the test would show nothing"
    exact = jax.jit(jax.grad(lambda params: jnp.sum(chances(params) * cost)))(params)
    gradient = jax.jit(choices_gradient, static_argnums=0)
    for baseline in (0.0, float(jnp.mean(cost))):  # a constant baseline doesn't bias the gradient
        weight = -len(visited) * chance * (cost - baseline)
        estimate, _, entropy = gradient(policy, params, many, visited, weight)
        chex.assert_trees_all_close(estimate, exact, atol=2e-3, rtol=2e-2)
    assert float(entropy) > 0.1
    assert float(jnp.max(jnp.abs(exact["params"]["score"]["kernel"]))) > 1e-2
