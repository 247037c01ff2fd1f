"""Rounds over the rows of a batch, beside plain loops in Python."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from basenet_jax import rounds

ROWS = 7  # one shape for all examples: each number of rows in a round compiles once
AT_ONCE = (1, 3, 7)


@jax.jit(static_argnames=("at_once", "axis", "leave"))
def count_down(steps, at_once, axis, leave):
    """Takes one off each open row; the second array counts the rounds that a row was worked in."""

    def work(index, state):
        left, worked = state
        return left - 1, worked + 1

    wide = jnp.zeros((ROWS, 2) if axis == 0 else (2, ROWS), int)
    return rounds.until_settled(lambda state: state[0] > 0, work, (steps, wide), at_once, axis=axis, leave=leave)


def plain_count_down(steps, at_once, leave):
    left, worked = list(steps), [0] * ROWS
    while sum(x > 0 for x in left) > leave:
        for row in [row for row in range(ROWS) if left[row] > 0][:at_once]:
            left[row] -= 1
            worked[row] += 1
    return left, worked


@pytest.mark.parametrize("axis", [0, -1])
@pytest.mark.parametrize("at_once", AT_ONCE)
@pytest.mark.parametrize("leave", [0, 2])
@settings(max_examples=20, deadline=None)
@given(steps=st.lists(st.integers(0, 4), min_size=ROWS, max_size=ROWS))
def test_open_rows_are_worked_until_few_are_left(axis, at_once, leave, steps):
    left, worked = count_down(np.array(steps), at_once, axis, leave)
    wanted_left, wanted_worked = plain_count_down(steps, at_once, leave)
    np.testing.assert_array_equal(left, wanted_left)
    for column in worked if axis == -1 else worked.T:
        np.testing.assert_array_equal(column, wanted_worked)


def test_a_row_sees_its_own_state_and_its_index():
    def work(index, state):
        return jnp.zeros_like(state[0]), 10 * index + state[1]

    start = (jnp.array([True, False, True, True]), jnp.array([1, 2, 3, 4]))
    _, seen = rounds.until_settled(lambda state: state[0], work, start, 2)
    np.testing.assert_array_equal(seen, [1, 2, 23, 34])


@jax.jit(static_argnames="at_once")
def fold(chosen, at_once):
    """The order in which rows come, and in which round each does."""

    def work(index, state):
        order, when, number = state
        place = number * at_once + jnp.arange(at_once)
        return order.at[place].set(index, mode="drop"), when.at[index].set(number, mode="drop"), number + 1

    return rounds.over_chosen(chosen, work, (jnp.full(ROWS, -1), jnp.full(ROWS, -1), jnp.array(0)), at_once)


@pytest.mark.parametrize("at_once", [*AT_ONCE, 9])
@settings(max_examples=20, deadline=None)
@given(chosen=st.lists(st.booleans(), min_size=ROWS, max_size=ROWS))
def test_chosen_rows_come_once_and_in_order(at_once, chosen):
    order, when, number = fold(np.array(chosen), at_once)
    rows = np.flatnonzero(chosen)
    np.testing.assert_array_equal(order[: len(rows)], rows)
    np.testing.assert_array_equal(when[rows], np.arange(len(rows)) // at_once)
    np.testing.assert_array_equal(np.delete(when, rows), -1)
    assert number == -(-len(rows) // at_once)


@pytest.mark.parametrize("at_once", [1, 3, 7, 100])
@pytest.mark.parametrize("out_axis", [0, -1])
def test_chunks_give_what_the_whole_gives(at_once, out_axis):
    x, y = np.arange(14.0).reshape(ROWS, 2), np.arange(ROWS) * 100.0
    sizes = []

    def compute(arrays):
        sizes.append(len(arrays["y"]))
        total = arrays["x"] + arrays["y"][:, None]
        return (total if out_axis == 0 else total.T), 2 * arrays["y"]

    both, double = rounds.in_chunks(compute, {"x": x, "y": y}, at_once, out_axis=out_axis)
    whole = x + y[:, None]
    np.testing.assert_array_equal(both, whole if out_axis == 0 else whole.T)
    np.testing.assert_array_equal(double, 2 * y)
    assert set(sizes) == {min(at_once, ROWS)}  # one program for all chunks


def test_rows_taken_for_none_are_the_last():
    taken = rounds.take({"a": jnp.arange(6).reshape(2, 3), "b": jnp.arange(3)}, jnp.array([1, 3]))
    np.testing.assert_array_equal(taken["a"], [[1, 2], [4, 5]])
    np.testing.assert_array_equal(taken["b"], [1, 2])
