"""The stop policy on made-up problems: symmetries, padding, what is allowed, and the rule that it starts as."""

import dataclasses

import hypothesis.extra.numpy as arrays
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from basenet_jax.policies.stop_policy import StopPolicy, StopState, access_time, make_scene
from basenet_jax.task.stop_problem import make_problem

STOPS, OBJECTS = 20, 4
POLICY = StopPolicy(features=8, considered=8)
apply, init = jax.jit(POLICY.apply), jax.jit(POLICY.init)
access_times, make = jax.jit(access_time), jax.jit(make_scene)


def made_up(seed, stops=STOPS, objects=OBJECTS):
    """A scene with random times; every object is served by the first stop and some others."""
    rng = np.random.default_rng(seed)
    pick = rng.uniform(9, 14, (stops, objects))
    pick[rng.random(pick.shape) < 0.6] = np.inf
    pick[0] = 12.0
    drive = rng.uniform(2, 8, (stops, stops))
    np.fill_diagonal(drive, 0.0)
    poses = jnp.asarray(rng.normal(size=(stops, 3)), jnp.float32)
    drive, pick, first = (np.float32(x) for x in (drive, pick, rng.uniform(2, 8, stops)))
    problem = make_problem(poses, jnp.asarray(drive), jnp.asarray(pick), jnp.asarray(first), jnp.ones(objects, bool))
    return make(problem, jnp.array([2.5, 0.3, 1.0]), jnp.asarray(rng.normal(size=(objects, 4)), jnp.float32))


def changed(scene, **fields):
    """The scene with other fields of its problem."""
    return dataclasses.replace(scene, problem=dataclasses.replace(scene.problem, **fields))


def at_stop(scene, stop, best, spare=0.0):
    problem = scene.problem
    return StopState(problem.poses[stop], problem.drive[stop], jnp.asarray(best, jnp.float32), jnp.array(spare))


@pytest.fixture(scope="module")
def case():
    """A scene, the state after a visit to the first stop that served the first object only, and parameters."""
    scene = made_up(0)
    state = at_stop(scene, 3, [12.0, np.inf, np.inf, np.inf], spare=1.0)
    params = init(jax.random.key(0), scene, state)
    rng = np.random.default_rng(1)
    shaken = jax.tree.map(lambda leaf: np.asarray(leaf + 0.1 * rng.normal(size=leaf.shape), np.float32), params)
    return scene, state, shaken, params


def test_permuting_objects_changes_nothing(case):
    scene, state, params, _ = case
    order = np.array([2, 0, 3, 1])
    permuted = dataclasses.replace(scene, access=scene.access[:, order], grasps=scene.grasps[order])
    permuted = changed(permuted, pick_time=scene.problem.pick_time[:, order], mask=scene.problem.mask[order])
    stops, end = apply(params, scene, state)
    same_stops, same_end = apply(params, permuted, state._replace(best=state.best[order]))
    np.testing.assert_allclose(stops, same_stops, atol=1e-4)
    np.testing.assert_allclose(end, same_end, atol=1e-4)


def test_permuting_stops_permutes_logits(case):
    scene, state, params, _ = case
    order, problem = np.random.default_rng(1).permutation(STOPS), scene.problem
    permuted = changed(
        dataclasses.replace(scene, access=scene.access[order]),
        poses=problem.poses[order],
        pick_time=problem.pick_time[order],
        first_drive=problem.first_drive[order],
        drive=problem.drive[order][:, order],
    )
    stops, _ = apply(params, scene, state)
    same, _ = apply(params, permuted, state._replace(drive=state.drive[order]))
    assert np.sum(np.isfinite(stops)) == POLICY.considered
    np.testing.assert_allclose(stops[order], same, atol=1e-4)


def test_padding_changes_nothing(case):
    scene, state, params, _ = case
    padded = dataclasses.replace(
        scene,
        access=jnp.pad(scene.access, ((0, 0), (0, 2)), constant_values=np.nan),
        grasps=jnp.pad(scene.grasps, ((0, 2), (0, 0)), constant_values=np.nan),
    )
    padded = changed(
        padded,
        pick_time=jnp.pad(scene.problem.pick_time, ((0, 0), (0, 2)), constant_values=3.0),
        mask=jnp.pad(scene.problem.mask, (0, 2)),
    )
    more = state._replace(best=jnp.pad(state.best, (0, 2), constant_values=np.inf))
    for ours, theirs in zip(apply(params, scene, state), apply(params, padded, more), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-4)


def test_it_starts_as_the_rule(case):
    scene, state, _, params = case
    pick, best = np.asarray(scene.problem.pick_time), np.asarray(state.best)
    least = pick.min(axis=0)
    rule = params["params"]["rule"]
    cost = np.asarray(state.drive).copy()
    for stop in range(STOPS):
        for o in range(OBJECTS):
            if np.isinf(best[o]) and np.isfinite(pick[stop, o]):
                cost[stop] -= float(rule["worth"]) - (pick[stop, o] - least[o])
            elif pick[stop, o] < best[o]:
                cost[stop] -= best[o] - pick[stop, o]
        cost[stop] += float(rule["farthest"]) * max(scene.access[stop, o] for o in range(OBJECTS) if np.isinf(best[o]))
    stops, _ = map(np.asarray, apply(params, scene, state))
    looked_at = np.isfinite(stops)
    np.testing.assert_allclose(stops[looked_at], -float(rule["sharpness"]) * cost[looked_at], rtol=1e-4)
    assert np.argmax(stops) == np.argmin(cost)


def test_what_is_allowed():
    scene = made_up(5)
    pick = jnp.full((STOPS, OBJECTS), jnp.inf).at[0].set(12.0).at[1, 0].set(9.0).at[2, 1].set(11.0)
    scene = changed(dataclasses.replace(scene, access=access_time(scene.problem.drive, pick)), pick_time=pick)
    params = init(jax.random.key(0), scene, at_stop(scene, 0, [np.inf] * 4))

    def allowed(best, spare):
        stops, end = apply(params, scene, at_stop(scene, 0, best, spare))
        return np.flatnonzero(np.isfinite(stops)).tolist(), bool(np.isfinite(end))

    waiting = np.inf
    assert allowed([waiting] * 4, 0.0) == ([0, 1, 2], False)
    assert allowed([12.0, waiting, 12.0, 12.0], 0.0) == ([0, 2], False)  # stop 1 would save time, but none is to spare
    assert allowed([12.0, waiting, 12.0, 12.0], 1.0) == ([0, 1, 2], False)
    assert allowed([12.0] * 4, 3.0) == ([1, 2], True)
    assert allowed([9.0, 11.0, 12.0, 12.0], 3.0) == ([], True)


@given(
    arrays.arrays(np.float32, (5, 5), elements=st.floats(0, 20, width=32)),
    arrays.arrays(np.float32, (5, 3), elements=st.sampled_from([8.0, 9.5, 12.0, np.inf])),
)
def test_access_time_is_the_least_over_all_stops(drive, pick):
    access = np.asarray(access_times(jnp.asarray(drive), jnp.asarray(pick)))
    for stop in range(5):
        for o in range(3):
            finite = [drive[stop, s] + pick[s, o] - pick[:, o].min() for s in range(5) if np.isfinite(pick[s, o])]
            assert access[stop, o] == pytest.approx(min(finite, default=np.inf), abs=1e-4)
