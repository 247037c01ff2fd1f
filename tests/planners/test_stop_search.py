import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from basenet_jax.planners import stop_search
from basenet_jax.planners.exact_sequence import best_sequence
from basenet_jax.planners.stop_moves import best_neighbour, exchange_costs, make_costs, reversal_gains, route_cost
from basenet_jax.planners.stop_problem import stop_problem
from basenet_jax.planners.stop_search import plan_steps, search_stops
from tests import compiled

STOPS, OBJECTS, ROOM = 7, 5, 4  # one shape for all tests of single moves, so that each compiles once
SEEDS = st.integers(0, 2**31)

exact = jax.jit(best_sequence)
costed, exchanged, reversals, neighbour = map(jax.jit, (route_cost, exchange_costs, reversal_gains, best_neighbour))


def random_problem(seed, stops=STOPS, objects=OBJECTS, share=0.5):
    """Costs without any structure; every object is served somewhere."""
    generator = np.random.default_rng(seed)
    picks = generator.uniform(8, 14, (stops, objects))
    picks[generator.uniform(size=picks.shape) > share] = np.inf
    for served in range(objects):
        picks[generator.integers(stops), served] = 9.0
    drive = generator.uniform(0, 10, (stops, stops))
    np.fill_diagonal(drive, 0.0)
    first = generator.uniform(5, 15, stops)
    return picks.astype(np.float32), first.astype(np.float32), drive.astype(np.float32)


def random_stops(seed, most=ROOM):
    """None to `most` different stops."""
    generator = np.random.default_rng([seed, 1])
    return generator.permutation(STOPS)[: generator.integers(most + 1)].tolist()


def as_route(stops, count=STOPS):
    return np.array([count, *stops, *[count + 1] * (ROOM + 1 - len(stops))])


def drives_cost(stops, first, drive):
    return first[stops[0]] + sum(drive[p, q] for p, q in itertools.pairwise(stops))


def steps_cost(order, stops, picks, first, drive):
    return drives_cost(stops, first, drive) + sum(picks[p, o] for o, p in zip(order, stops, strict=True))


def drives_of(costs, route):
    return sum(float(costs.drive[p, q]) for p, q in itertools.pairwise(route))


def estimate(costs, stops, new):
    """Drives, the fastest pick of every object, and what the new stop loses if it picks none fastest."""
    picks = np.asarray(costs.pick, float)
    rest = [int(costs.start), *(stop for stop in stops if stop != new)]
    total = 0.0
    losses = []
    for item in range(len(picks)):
        other = min(picks[item, stop] for stop in rest)
        total += min(other, picks[item, new])
        losses.append(picks[item, new] - other)
    idle_loss = 0.0 if new == costs.nowhere else max(0.0, min([*losses, 1e4]))
    return total + idle_loss + drives_of(costs, [costs.start, *(stop for stop in stops if stop < costs.start)])


@settings(max_examples=60)
@given(SEEDS)
def test_a_route_costs_its_drives_and_the_picks_of_its_own_assignment(seed):
    problem = picks, first, drive = random_problem(seed)
    stops = random_stops(seed)
    picked_at, cost = (np.asarray(x) for x in costed(make_costs(*problem), as_route(stops)))
    fastest = np.min(picks[stops], axis=0, initial=np.inf)
    assert (np.isinf(fastest) == (picked_at == 0)).all()
    if np.isinf(fastest).any() or not {*range(1, len(stops) + 1)} <= {*picked_at.tolist()}:
        assert cost > 9e3
        return
    order = np.argsort(picked_at, kind="stable")
    own = steps_cost(order, [stops[place - 1] for place in picked_at[order]], *problem)
    np.testing.assert_allclose(cost, own, rtol=1e-5)
    if {*np.argmin(picks[stops], axis=0).tolist()} == {*range(len(stops))}:  # no stop is idle
        np.testing.assert_allclose(cost, fastest.sum() + drives_cost(stops, first, drive), rtol=1e-5)


def test_a_stop_that_picks_nothing_fastest_takes_the_object_that_loses_least():
    picks = np.array([[9.0, 10.0, 9.0], [9.5, 10.2, np.inf]], np.float32)
    drive = np.array([[0.0, 5.0], [4.0, 0.0]], np.float32)
    costs = make_costs(picks, np.array([2.0, 3.0], np.float32), drive)
    picked_at, cost = route_cost(costs, jnp.array([2, 1, 0, 3]))
    assert picked_at.tolist() == [2, 1, 2]
    np.testing.assert_allclose(cost, 3 + 4 + 9 + 10.2 + 9, rtol=1e-6)


@settings(max_examples=40)
@given(SEEDS)
def test_every_exchange_is_costed_as_by_plain_loops(seed):
    costs, stops = make_costs(*random_problem(seed)), random_stops(seed)
    found = np.asarray(exchanged(costs, as_route(stops)))
    for place, new in itertools.product(range(len(stops) + 1), [*range(STOPS), STOPS + 1]):
        rest = [stop for at, stop in enumerate(stops, 1) if at != place]
        if new in rest or len(rest) == ROOM:
            assert np.isinf(found[place, new]) or (new == costs.nowhere and len(rest) == ROOM)
            continue
        gaps = range(len(rest) + 1) if new < costs.start else [len(rest)]
        best = min(estimate(costs, [*rest[:gap], new, *rest[gap:]], new) for gap in gaps)
        np.testing.assert_allclose(found[place, new], best, rtol=1e-5, atol=1e-2 if best > 9e3 else 1e-3)


@settings(max_examples=40)
@given(SEEDS)
def test_every_reversal_changes_the_cost_by_what_driving_it_shows(seed):
    costs, stops = make_costs(*random_problem(seed)), random_stops(seed)
    found = np.asarray(reversals(costs, as_route(stops)))
    before = drives_of(costs, as_route(stops))
    for i, j in itertools.product(range(len(found)), repeat=2):
        if i < j < len(stops):
            after = drives_of(costs, as_route([*stops[:i], *stops[i : j + 1][::-1], *stops[j + 1 :]]))
            np.testing.assert_allclose(found[i, j], after - before, atol=1e-3)
        elif i >= j or i < len(stops):
            assert found[i, j] > 9e3
        else:  # within the padding
            assert found[i, j] >= 0


@settings(max_examples=60)
@given(SEEDS)
def test_the_best_neighbour_is_the_route_that_its_cost_is_of(seed):
    costs, stops = make_costs(*random_problem(seed)), random_stops(seed)
    route, cost = (np.asarray(x) for x in neighbour(costs, as_route(stops)))
    assert route[0] == costs.start
    assert len(route) == ROOM + 2
    visited = route[(route != costs.start) & (route != costs.nowhere)]
    np.testing.assert_array_equal(route, as_route(visited.tolist()))
    assert len(set(visited)) == len(visited)
    assert cost <= np.min(exchanged(costs, as_route(stops))) + 1e-3
    fastest = np.min(np.asarray(costs.pick)[:, route], axis=1).sum()
    _, true = costed(costs, route)
    assert cost <= true + 1e-2
    if set(np.argmin(np.asarray(costs.pick)[:, route], axis=1)) >= set(range(1, len(visited) + 1)):
        np.testing.assert_allclose(cost, true, rtol=1e-5, atol=1e-2)
        np.testing.assert_allclose(cost, fastest + drives_of(costs, route), rtol=1e-5, atol=1e-2)


@settings(max_examples=30)
@given(SEEDS, st.sampled_from([0, 1, 7]))
def test_the_result_costs_what_its_steps_cost_and_no_more_than_the_start(seed, iterations):
    problem, stops = random_problem(seed), random_stops(seed)
    start = np.full(ROOM, -1)
    start[: len(stops)] = stops
    _, before = costed(make_costs(*problem), as_route(stops))
    found = search_stops(*problem, jax.random.key(seed), iterations=iterations, start=start, max_stops=ROOM)
    if before < 9e3:
        assert found.cost <= before + 1e-3
    if np.isfinite(found.cost):
        order, places = plan_steps(found)
        assert sorted(order) == list(range(OBJECTS))
        np.testing.assert_allclose(found.cost, steps_cost(order, places, *problem), rtol=1e-5)
        visited = np.asarray(found.stops)
        # A random change may have put a stop beside itself, which costs nothing.
        assert [stop for stop, _ in itertools.groupby(places)] == [
            s for s, _ in itertools.groupby(visited[visited >= 0])
        ]


@pytest.mark.parametrize(("objects", "seed"), [*itertools.product([1, 3, 5], range(4))])
def test_finds_the_exact_optimum_of_few_objects(objects, seed):
    picks, first, drive = random_problem(seed, 24)
    picks[:, objects:] = np.inf
    found = search_stops(picks, first, drive, jax.random.key(seed), iterations=2000)
    problem = picks[:, :objects], first, drive
    order, stops = (np.asarray(x) for x in exact(*problem))
    best = steps_cost(order, stops, *problem)
    np.testing.assert_allclose(found.cost, best, rtol=1e-5)


def test_stops_that_serve_nothing_and_objects_that_none_serves_change_nothing():
    picks, first, drive = random_problem(3, 24)
    padded = (
        np.pad(picks, ((0, 8), (0, 3)), constant_values=np.inf),
        np.pad(first, (0, 8)),
        np.pad(drive, (0, 8)),
    )
    key = jax.random.key(0)
    few = search_stops(picks, first, drive, key, iterations=100, max_stops=5)
    many = search_stops(*padded, key, iterations=100, max_stops=5)
    np.testing.assert_array_equal(few.stops, many.stops)
    np.testing.assert_array_equal(few.cost, many.cost)
    assert many.picked_at.tolist() == [*few.picked_at.tolist(), -1, -1, -1]
    assert [x.tolist() for x in plan_steps(few)] == [x.tolist() for x in plan_steps(many)]


def test_the_same_key_gives_the_same_result_and_all_budgets_are_compiled_once(monkeypatch):
    traces = []

    def counted(costs, route):
        traces.append(route)
        return best_neighbour(costs, route)

    monkeypatch.setattr(stop_search, "best_neighbour", counted)
    picks, first, drive = random_problem(5, 25, 6)
    results = [search_stops(picks, first, drive, jax.random.key(1), iterations=n) for n in (3, 60, jnp.array(60))]
    assert len(traces) == 1
    np.testing.assert_array_equal(results[1].stops, results[2].stops)
    assert results[1].cost == results[2].cost
    assert results[1].cost <= results[0].cost


def test_a_stop_that_cannot_be_driven_to_is_not_used():
    picks, first, drive = random_problem(6, 24)
    first[:12], drive[:, :12] = np.inf, np.inf
    picks[12] = 20.0
    found = search_stops(picks, first, drive, jax.random.key(0), iterations=300)
    assert np.isfinite(found.cost)
    assert min(stop for stop in found.stops.tolist() if stop >= 0) >= 12
    nowhere = search_stops(picks, np.full_like(first, np.inf), drive, jax.random.key(0), iterations=300)
    assert np.isinf(nowhere.cost)


def test_without_any_object_there_is_nothing_to_do():
    picks, first, drive = random_problem(7, 24)
    found = search_stops(np.full_like(picks, np.inf), first, drive, jax.random.key(0), iterations=20)
    assert found.cost == 0
    assert found.stops.tolist() == [-1] * OBJECTS
    assert [x.tolist() for x in plan_steps(found)] == [[], []]


def test_a_start_with_too_much_room_is_refused():
    with pytest.raises(ValueError, match="start: found room for 6 stops, allowed are max_stops = 5"):
        search_stops(*random_problem(8), jax.random.key(0), iterations=1, start=np.full(6, -1))


def test_the_judge_agrees_with_the_cost(setup, random_scene):
    scene = random_scene(1)
    candidates = compiled.check_candidates(setup.robot, scene, setup.grid_poses)
    problem = stop_problem(setup.robot, setup.drives, scene, candidates)
    found = search_stops(*problem.costs, jax.random.key(0), iterations=500)
    plan = problem.plan(scene, *plan_steps(found))
    outcome = compiled.execute(setup.robot, scene, plan)
    assert outcome.grasped == np.sum(scene.mask)
    np.testing.assert_allclose(found.cost, outcome.execution, rtol=1e-4)
