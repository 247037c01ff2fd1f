"""Long batches worked on a fixed number of rows at a time.

`until_settled` goes on as long as rows of a state are open, `over_chosen` goes once over rows that are known
beforehand, `in_chunks` over all rows. A row's index that is the number of rows stands for none: a round has room left.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Int

State = TypeVar("State")


def take(arrays: State, index: Int[Array, " at_once"], axis: int = -1) -> State:
    """These rows of a tree of arrays; the last row where the index stands for none."""
    return jax.tree.map(lambda x: x.at[_rows(index, axis)].get(mode="clip"), arrays)


def until_settled(
    is_open: Callable[[State], Bool[Array, " B"]],
    work: Callable[[Int[Array, " at_once"], State], State],
    state: State,
    at_once: int,
    *,
    axis: int = -1,
    leave: int = 0,
) -> State:
    """Replaces rows of a state until at most `leave` of them are open.

    Args:
        is_open: which rows of a state still need work.
        work: (indices of the first `at_once` open rows, these rows of the state) -> what replaces them. Every row
            must be closed after finitely many rounds.
        state: a tree of arrays, each with B rows along the axis.
        at_once: rows in a round, 1 to B.
        axis: of the rows: 0 or -1.
        leave: so many open rows end the loop.
    """

    def work_round(state: State) -> State:
        open_rows = is_open(state)
        (index,) = jnp.nonzero(open_rows, size=at_once, fill_value=len(open_rows))
        new = work(index, take(state, index, axis))
        return jax.tree.map(lambda x, rows: x.at[_rows(index, axis)].set(rows, mode="drop"), state, new)

    return jax.lax.while_loop(lambda state: jnp.sum(is_open(state)) > leave, work_round, state)


def over_chosen(
    chosen: Bool[Array, " B"], work: Callable[[Int[Array, " at_once"], State], State], state: State, at_once: int
) -> State:
    """Folds the chosen rows, in their order, into a state: `state = work(indices, state)`, so many of them in a round.

    Args:
        chosen: which rows.
        work: is given B for indices beyond the last chosen row.
        state: a tree of arrays.
        at_once: rows in a round, 1 or more.
    """
    count = len(chosen)
    (index,) = jnp.nonzero(chosen, size=count, fill_value=count)
    index = jnp.pad(index, (0, -count % at_once), constant_values=count)

    def work_round(carry: tuple[Array, State]) -> tuple[Array, State]:
        start, state = carry
        return start + at_once, work(jax.lax.dynamic_slice(index, (start,), (at_once,)), state)

    return jax.lax.while_loop(lambda carry: carry[0] < jnp.sum(chosen), work_round, (jnp.array(0), state))[1]


def in_chunks(compute: Callable[[Any], State], arrays: Any, at_once: int, *, out_axis: int = 0) -> State:
    """`compute(arrays)`, by so many rows at a time; the last chunk is filled up with copies of the last row.

    One program for all chunks, where `jax.lax.map` with a `batch_size` compiles a second one for what remains.

    Args:
        compute: each row of its result depends on the same row of the arrays alone.
        arrays: a tree of arrays, each with B rows along its first axis.
        at_once: rows in a chunk, 1 or more.
        out_axis: of the result's rows: 0 or -1.
    """
    count = len(jax.tree.leaves(arrays)[0])
    if count <= at_once:
        return compute(arrays)
    chunks = -(-count // at_once)
    index = jnp.minimum(jnp.arange(chunks * at_once), count - 1)
    parts = jax.tree.map(lambda x: x[index].reshape(chunks, at_once, *x.shape[1:]), arrays)

    def joined(x: Array) -> Array:
        if out_axis == 0:
            return x.reshape(-1, *x.shape[2:])[:count]
        return jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], -1)[..., :count]

    return jax.tree.map(joined, jax.lax.map(compute, parts))


def _rows(index: Array, axis: int) -> Any:
    return index if axis == 0 else (..., index)
