import itertools
from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import optimize, sparse

from basenet_jax.planners.exact_sequence import best_sequence, sets_of
from tests.clutter_cases import as_clutter, most_of_any_order, random_clutter, time_of

solve = jax.jit(best_sequence)


def random_costs(seed, objects, poses, share=0.5):
    """Costs with no structure at all (not even the triangle inequality); every object is served somewhere."""
    generator = np.random.default_rng(seed)
    picks = generator.uniform(8, 14, (poses, objects))
    picks[generator.uniform(size=picks.shape) > share] = np.inf
    for served in range(objects):
        picks[generator.integers(poses), served] = 9.0
    drive = generator.uniform(0, 10, (poses, poses))
    np.fill_diagonal(drive, 0.0)
    return tuple(x.astype(np.float32) for x in (picks, generator.uniform(5, 15, poses), drive))


def cost_of(order, stops, costs):
    picks, first, drive = costs
    drives = first[stops[0]] + sum(drive[p, q] for p, q in itertools.pairwise(stops))
    return drives + sum(picks[p, o] for o, p in zip(order, stops, strict=True))


def brute_force(picks, first, drive):
    poses, objects = picks.shape
    return min(
        cost_of(order, stops, (picks, first, drive))
        for order in itertools.permutations(range(objects))
        for stops in itertools.product(range(poses), repeat=objects)
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 4))
def test_nothing_is_cheaper_by_brute_force(seed, objects):
    costs = random_costs(seed, objects, 5)
    order, stops = (np.asarray(x) for x in solve(*costs))
    assert sorted(order) == list(range(objects))
    np.testing.assert_allclose(cost_of(order, stops, costs), brute_force(*costs), rtol=1e-6)


def cost_in_clutter(order, stops, time, blockers, first, drive):
    drives = first[stops[0]] + sum(drive[p, q] for p, q in itertools.pairwise(stops))
    gone = [set(order[:index]) for index in range(len(order))]
    return drives + sum(time_of(time, blockers, p, o, before) for o, p, before in zip(order, stops, gone, strict=True))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_nothing_is_cheaper_where_objects_are_in_the_way(seed):
    """All orders and all stops; beside three columns, of which one may be left out."""
    stops, columns = 4, 4
    objects = 3 + seed % 2
    time, blockers = random_clutter(seed, stops, objects, served=0.8)
    assume(len(most_of_any_order(time, blockers, np.ones(stops, bool))) == objects)
    _, first, drive = random_costs(seed, objects, stops)
    fill = ((0, 0), (0, columns - objects), (0, 0))
    padded = np.pad(time, fill, constant_values=np.inf), np.pad(blockers, (*fill, fill[1]))
    clutter = as_clutter(*padded)
    least = np.min(clutter.time, axis=-1)
    order, at = (np.asarray(x)[-objects:] for x in solve(least, first, drive, sets_of(objects, columns), clutter))
    expected = min(
        cost_in_clutter(each, poses, time, blockers, first, drive)
        for each in itertools.permutations(range(objects))
        for poses in itertools.product(range(stops), repeat=objects)
    )
    np.testing.assert_allclose(
        cost_in_clutter(order.tolist(), at.tolist(), time, blockers, first, drive), expected, rtol=1e-6
    )


@pytest.mark.parametrize("objects", [1, 2, 3, 4])
def test_columns_that_fill_up_change_nothing(objects):
    picks, first, drive = random_costs(6, objects, 5)
    padded = np.pad(picks, ((0, 0), (0, 5 - objects)), constant_values=np.inf)
    found = solve(padded, first, drive, sets_of(objects, 5))
    order, stops = (np.asarray(x)[-objects:] for x in found)
    assert sorted(order) == list(range(objects))
    np.testing.assert_allclose(
        cost_of(order, stops, (picks, first, drive)), brute_force(picks, first, drive), rtol=1e-6
    )


def mixed_integer_optimum(picks, first, drive):
    """The least cost by HiGHS: binary flows through N layers of (object, pose) nodes, each object once."""
    nodes = np.argwhere(np.isfinite(picks.T))  # object, pose
    count, objects = len(nodes), picks.shape[1]
    pick = picks.T[nodes[:, 0], nodes[:, 1]].astype(float)
    arcs = np.argwhere(nodes[:, 0][:, None] != nodes[:, 0][None])
    enter = first[nodes[:, 1]] + pick
    travel = drive[nodes[arcs[:, 0], 1], nodes[arcs[:, 1], 1]] + pick[arcs[:, 1]]
    cost = np.concatenate([enter, *[travel] * (objects - 1)])
    width = len(arcs)

    def start(layer):
        return count + layer * width

    into = sparse.csr_array((np.ones(width), (arcs[:, 1], np.arange(width))), (count, width))
    out = sparse.csr_array((np.ones(width), (arcs[:, 0], np.arange(width))), (count, width))
    rows, bounds = [], []

    def block(parts):
        """A row block with the given matrices at their columns."""
        row = sparse.lil_array((next(iter(parts.values())).shape[0], len(cost)))
        for column, part in parts.items():
            row[:, column : column + part.shape[1]] = part
        return row.tocsr()

    identity = sparse.eye_array(count).tocsr()
    for layer in range(objects - 1):
        inward = {0: identity} if layer == 0 else {start(layer - 1): into}
        rows.append(block({**inward, start(layer): -out}))
        bounds.append(np.zeros(count))
    member = sparse.csr_array((np.ones(count), (nodes[:, 0], np.arange(count))), (objects, count))
    rows.append(block({0: member} | {start(layer): member @ into for layer in range(objects - 1)}))
    bounds.append(np.ones(objects))
    limits = np.concatenate(bounds)
    constraint: Any = optimize.LinearConstraint(sparse.vstack(rows), limits, limits)  # pyright: ignore[reportArgumentType]
    result = optimize.milp(cost, integrality=np.ones_like(cost), bounds=(0, 1), constraints=constraint)
    assert result.success, result.message
    return result.fun


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_agrees_with_a_mixed_integer_solver_on_six_objects(seed):
    costs = random_costs(seed, 6, 12, share=0.3)
    order, stops = (np.asarray(x) for x in solve(*costs))
    np.testing.assert_allclose(cost_of(order, stops, costs), mixed_integer_optimum(*costs), rtol=1e-5)


def test_more_poses_never_cost_more():
    picks, first, drive = random_costs(3, 5, 32)
    costs = []
    for count in (8, 16, 32):
        part = (np.where(np.isinf(picks[:8]).all(0), 9.0, picks)[:count], first[:count], drive[:count, :count])
        order, stops = (np.asarray(x) for x in solve(*part))
        costs.append(cost_of(order, stops, part))
    assert costs[0] >= costs[1] >= costs[2]


def test_poses_that_serve_nothing_change_nothing():
    picks, first, drive = random_costs(4, 4, 8)
    padded = (
        np.pad(picks, ((0, 8), (0, 0)), constant_values=np.inf),
        np.pad(first, (0, 8), constant_values=np.inf),
        np.pad(drive, (0, 8)),
    )
    for one, other in zip(solve(picks, first, drive), solve(*padded), strict=True):
        np.testing.assert_array_equal(one, other)
