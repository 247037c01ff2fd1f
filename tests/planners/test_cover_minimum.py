"""Minimum covers against brute force over all choices of sets."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import OptimizeResult

from basenet_jax.planners import cover_minimum
from basenet_jax.planners.cover_minimum import maximal_sets, minimum_cover

matrices = st.integers(1, 6).flatmap(
    lambda objects: st.lists(st.lists(st.booleans(), min_size=objects, max_size=objects), min_size=1, max_size=9)
)


def fewest(serves):
    """The number of rows of a smallest cover of all columns that can be covered, by trying all."""
    wanted = serves.any(axis=0)
    for size in range(len(serves) + 1):
        if any((serves[list(rows)].any(axis=0) >= wanted).all() for rows in combinations(range(len(serves)), size)):
            return size
    raise AssertionError("all rows together cover what can be covered")


@given(matrices)
def test_as_few_sets_as_brute_force(rows):
    serves = np.array(rows, bool)
    stop = minimum_cover(serves)
    numbers = sorted(set(stop.tolist()) - {-1})
    assert numbers == list(range(fewest(serves)))
    chosen = [serves[stop == number] for number in numbers]
    for poses in chosen:
        assert (poses == poses[0]).all(), "all poses of a stop serve the same"
        assert not any((row > poses[0]).any() and (row >= poses[0]).all() for row in serves), "a larger set exists"
        assert (serves == poses[0]).all(axis=1).sum() == len(poses), "a pose with this coverage is missing"
    covered = np.any([poses[0] for poses in chosen], axis=0) if chosen else np.zeros(serves.shape[1], bool)
    np.testing.assert_array_equal(covered, serves.any(axis=0))


@given(st.lists(st.integers(0, 63), min_size=1, unique=True))
def test_maximal_sets_are_in_no_other(values):
    keys = np.array(values, np.uint64)
    expected = [a for a in values if a and not any(a != b and a & b == a for b in values)]
    assert keys[maximal_sets(keys)].tolist() == expected


def test_greedy_would_take_three():
    """The largest set first is the classical trap: two sets of three cover what a set of four only delays."""
    rows = ["111000", "000111", "011110", "100000"]
    serves = np.array([[bit == "1" for bit in row] for row in rows])
    assert minimum_cover(serves).tolist() == [0, 1, -1, -1]


def test_fifty_objects():
    """All bits of the largest scene count, and the result is proven: 50 disjoint pairs need 25 sets."""
    serves = np.zeros((26, 50), bool)
    for row in range(25):
        serves[row, [row, 49 - row]] = True
    stop = minimum_cover(serves)
    assert sorted(stop[:25].tolist()) == list(range(25))
    assert stop[25] == -1


def test_a_cover_that_is_not_proven_is_refused(monkeypatch):
    monkeypatch.setattr(
        cover_minimum, "milp", lambda *_, **__: OptimizeResult(status=1, message="Time limit reached.", x=None)
    )
    with pytest.raises(RuntimeError, match=r"minimum cover of 2 objects by 2 sets: Time limit reached\."):
        minimum_cover(np.eye(2, dtype=bool))
