"""Orders of picks at given visits: valid, complete, and not slower than picking everything at once."""

import itertools

import jax
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from basenet_jax.task.pick_order import order_picks
from tests.clutter_cases import as_clutter, random_clutter, time_of

OBJECTS, STOPS, VISITS = 5, 4, 6
_order = jax.jit(order_picks)


def draw(seed):
    """A problem and visits, the last of which may be none."""
    rng = np.random.default_rng(seed)
    visited = rng.integers(0, STOPS, VISITS)
    visited[rng.integers(2, VISITS + 1) :] = -1
    return random_clutter(seed, STOPS, OBJECTS, served=0.4), visited, rng.random(OBJECTS) < 0.9


def at_once(time, blockers, visited, mask):
    """Everything is picked at the first visit at which it can be: the objects had, and their times together."""
    gone, total = set(np.flatnonzero(~mask).tolist()), 0.0
    for stop in visited[visited >= 0]:
        while True:
            now = {
                item: time_of(time, blockers, stop, item, gone)
                for item in range(OBJECTS)
                if item not in gone and np.isfinite(time_of(time, blockers, stop, item, gone))
            }
            if not now:
                break
            total += sum(now.values())
            gone |= set(now)
    return gone - set(np.flatnonzero(~mask).tolist()), total


def replayed(time, blockers, visited, mask, order):
    """The picks in their order, each by the fastest way that is open then."""
    gone, total = set(np.flatnonzero(~mask).tolist()), 0.0
    steps = sorted((order.visit[item], order.turn[item], item) for item in range(OBJECTS) if order.visit[item] >= 0)
    for (visit, _), group in itertools.groupby(steps, key=lambda step: step[:2]):
        items = [item for *_, item in group]
        times = [time_of(time, blockers, visited[visit], item, gone) for item in items]
        total += sum(times)  # infinite where something is in the way
        gone |= set(items)
    return {step[2] for step in steps}, total


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**31))
def test_picks_in_order_have_nothing_in_their_way(seed):
    (time, blockers), visited, mask = draw(seed)
    order = jax.device_get(_order(as_clutter(time, blockers), mask, visited))
    had, total = replayed(time, blockers, visited, mask, order)
    all_at_once, least = at_once(time, blockers, visited, mask)
    assert had == all_at_once  # picking all that can be picked has the most that any order can
    assert total <= least + 1e-3
    promised = sum(order.time[item] for item in had)
    assert np.isfinite(promised)
    assert total <= promised + 1e-3
    assert all(order.visit[item] == -1 and np.isinf(order.time[item]) for item in set(range(OBJECTS)) - had)


def test_an_object_waits_for_a_faster_way():
    """From the second stop it is fast, once the other is gone, which is picked at the first."""
    time = np.full((2, 2, 1), np.inf, np.float32)
    time[0, 0], time[0, 1], time[1, 1] = 9.0, 13.0, 8.0
    blockers = np.zeros((2, 2, 1, 2), bool)
    blockers[1, 1, 0, 0] = True
    order = jax.device_get(_order(as_clutter(time, blockers), np.ones(2, bool), np.array([0, 1])))
    np.testing.assert_array_equal(order.visit, [0, 1])
    np.testing.assert_allclose(order.time, [9.0, 8.0])
