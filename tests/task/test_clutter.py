"""What can be picked while what still stands, beside sets and all orders."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from basenet_jax.task.clutter import as_bits, as_members, obtainable
from tests.clutter_cases import as_clutter, most_of_any_order, random_clutter, time_of

OBJECTS, STOPS = 5, 3
_times_among = jax.jit(lambda clutter, standing: clutter.times_among(standing))
_obtainable = jax.jit(obtainable)


@pytest.mark.parametrize("count", [1, 31, 32, 33, 50])
def test_bits_are_sets(count):
    members = np.random.default_rng(count).random((7, count)) < 0.5
    np.testing.assert_array_equal(as_members(as_bits(members, np), count), members)
    np.testing.assert_array_equal(as_bits(jnp.asarray(members)), as_bits(members, np))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.sets(st.integers(0, OBJECTS - 1)))
def test_times_among_what_stands(seed, standing):
    time, blockers = random_clutter(seed, STOPS, OBJECTS)
    stands = np.isin(np.arange(OBJECTS), list(standing))
    gone = set(range(OBJECTS)) - standing
    found = _times_among(as_clutter(time, blockers), stands)
    for stop in range(STOPS):
        for item in range(OBJECTS):
            assert found[stop, item] == time_of(time, blockers, stop, item, gone)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_no_order_of_picks_has_more(seed):
    time, blockers = random_clutter(seed, STOPS, OBJECTS, served=0.25)
    reachable = np.random.default_rng(seed).random(STOPS) < 0.8
    most = most_of_any_order(time, blockers, reachable)
    clutter = as_clutter(time, blockers)
    assert set(np.flatnonzero(_obtainable(clutter, reachable)).tolist()) == most
    assert set(np.flatnonzero(obtainable(clutter, reachable, np)).tolist()) == most


def test_a_batch_is_each_problem_alone():
    clutters = [as_clutter(*random_clutter(seed, STOPS, OBJECTS, served=0.25)) for seed in range(4)]
    batch = jax.tree.map(lambda *x: np.stack(x), *clutters)
    found = obtainable(batch, np.ones((4, STOPS), bool))
    for row, clutter in enumerate(clutters):
        np.testing.assert_array_equal(found[row], obtainable(clutter, np.ones(STOPS, bool), np))
