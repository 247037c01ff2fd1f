"""The kernel of exact planning: Held and Karp's dynamic programming (1962) with a choice of poses for every object.

`cost[S, p]`, the least cost of having picked the set S with the last pick at pose p, and `arrival[S, q]`, that of
having picked S and then driven to q, obey

    cost[S, p]    = min_{o in S} arrival[S - o, p] + pick[p, o]
    arrival[S, q] = min_p cost[S, p] + drive[p, q],    arrival[{}, q] = first drive to q.

The second line is the work: 2^N P^2 sums. Only arrivals are stored; the way back recomputes the costs that it needs.
A set is the bits of an integer, which is its row in the table. Where objects are in each other's way, `pick[p, o]` is
the least over the ways that are open once S - o is gone.
"""

import functools
import math
from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from basenet_jax.task.clutter import Clutter

_SETS_AT_ONCE = 32  # with a thousand poses their costs stay in a CPU core's cache
_POSES_AT_ONCE = 16  # relaxed in one pass over those: each element is loaded and stored once for many sums


class Sets(NamedTuple):
    """The sets of the first objects of a problem, in the order in which they are extended."""

    chunks: Int[Array | np.ndarray, "chunks sets"]
    used: Int[Array | np.ndarray, ""] | int  # of the chunks; the others only fill up
    everything: Int[Array | np.ndarray, ""] | int  # the set of them all


@functools.cache
def sets_of(objects: int, columns: int) -> Sets:
    """The sets of the first so many objects, in arrays that are as large for fewer objects as for all columns."""
    chunks = _sets_by_size(objects)
    missing = max(len(_sets_by_size(columns)), 1) - len(chunks)
    everything = np.array(2**objects - 1, np.int32)
    return Sets(np.pad(chunks.astype(np.int32), ((0, missing), (0, 0))), np.array(len(chunks), np.int32), everything)


def best_sequence(
    pick_time: Float[Array, "P N"],
    first_drive: Float[Array, " P"],
    drive: Float[Array, "P P"],
    sets: Sets | None = None,
    clutter: Clutter | None = None,
) -> tuple[Int[Array, " N"], Int[Array, " N"]]:
    """The cheapest way to pick all N objects, each from one of P poses.

    Args:
        pick_time: s; infinite where the pose doesn't serve the object.
        first_drive: from the robot's start to each pose (s).
        drive: from pose to pose (s), 0 for staying.
        sets: of the first objects, where only these are to be picked; then columns that are left out take no time.
        clutter: the ways to pick, where objects are in each other's way; every object can be had in some order.

    Returns:
        Objects in order, and the pose of each; of fewer than N objects these are the last ones.
    """
    picks = _Picks(pick_time.T[:, None], None)
    if clutter is not None:  # so few objects are in one word
        picks = _Picks(*(jnp.moveaxis(x, 0, -1) for x in (clutter.time, clutter.blockers[..., 0].astype(jnp.int32))))
    count = pick_time.shape[1]
    sets = sets_of(count, count) if sets is None else sets
    chunks = jnp.asarray(sets.chunks)
    arrival = jnp.full((2**count, len(first_drive)), jnp.inf, pick_time.dtype).at[0].set(first_drive)

    def extend(index: Array, arrival: Array) -> Array:
        cost = reduce(jnp.minimum, (_cost_if_last(arrival, picks, chunks[index], o) for o in range(count)))
        return arrival.at[chunks[index]].set(_min_plus(cost, drive))

    arrival = jax.lax.fori_loop(0, sets.used, extend, arrival)

    def step_back(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """From a set and the pose of its last pick to those before it."""
        current, pose = carry
        last = jnp.argmin(_costs_by_last(arrival[:, pose, None], picks.at(pose), current)[:, 0])
        before = current & ~(1 << last)
        cost = jnp.min(_costs_by_last(arrival, picks, before), axis=0)
        return (before, jnp.argmin(cost + drive[:, pose])), (last, pose)

    everything = jnp.asarray(sets.everything)
    final = jnp.argmin(jnp.min(_costs_by_last(arrival, picks, everything), axis=0))
    _, (order, stops) = jax.lax.scan(step_back, (everything, final), length=count)
    return order[::-1], stops[::-1]


def _sets_by_size(count: int) -> Int[np.ndarray, "chunks sets"]:
    """All sets but the empty and the full one, the small ones first; chunks of one size, filled up with repetitions."""
    sets = np.arange(1, 2**count - 1)
    sizes = np.bitwise_count(sets)
    chunks = []
    for size in range(1, count):
        layer = sets[sizes == size]
        rows = -(-len(layer) // _SETS_AT_ONCE) * _SETS_AT_ONCE
        chunks.append(np.resize(layer, rows).reshape(-1, _SETS_AT_ONCE))
    return np.concatenate(chunks) if chunks else np.zeros((0, _SETS_AT_ONCE), int)


class _Picks(NamedTuple):
    """N objects, A ways each, P poses."""

    time: Float[Array, "N A P"]
    blockers: Int[Array, "N A P"] | None

    def at(self, pose: Int[Array, ""]) -> "_Picks":
        """Those from one pose."""
        return jax.tree.map(lambda x: x[..., pose, None], self)

    def of(self, item: Int[Array, " N"] | int, gone: Int[Array, "*rows"]) -> Float[Array, "*rows P"]:
        """Times of the fastest open ways to pick an object once a set is gone, for several sets."""
        time, blockers = self.time[item], None if self.blockers is None else self.blockers[item]

        def one_way(way: int) -> Array:
            if blockers is None:
                return time[..., way, :]
            return jnp.where(blockers[..., way, :] & ~gone[..., None] == 0, time[..., way, :], jnp.inf)

        return reduce(jnp.minimum, map(one_way, range(time.shape[-2])))


def _cost_if_last(arrival: Array, picks: _Picks, sets: Int[Array, " sets"], last: int) -> Float[Array, "sets P"]:
    """Costs of sets whose last pick is the given object; infinite for sets without it."""
    before = sets & ~(1 << last)
    cost = arrival[before] + picks.of(last, before)
    return jnp.where(((sets >> last) & 1)[:, None] == 1, cost, jnp.inf)


def _costs_by_last(arrival: Array, picks: _Picks, current: Int[Array, ""]) -> Float[Array, "N P"]:
    """Costs of one set for every last pick."""
    objects = jnp.arange(len(picks.time))
    before = current & ~(1 << objects)
    cost = arrival[before] + picks.of(objects, before)
    return jnp.where(((current >> objects) & 1)[:, None] == 1, cost, jnp.inf)


def _min_plus(cost: Float[Array, "sets P"], drive: Float[Array, "P P"]) -> Float[Array, "sets P"]:
    """`min_p cost[:, p] + drive[p, :]`: a matrix product with minimum for sum and sum for product."""
    poses = len(drive)
    at_once = math.gcd(poses, _POSES_AT_ONCE)
    blocks = (cost.T.reshape(-1, at_once, len(cost)), drive.reshape(-1, at_once, poses))

    def relax(best: Array, block: tuple[Array, Array]) -> tuple[Array, None]:
        return reduce(
            jnp.minimum, (departure[:, None] + leg for departure, leg in zip(*block, strict=True)), best
        ), None

    return jax.lax.scan(relax, jnp.full_like(cost, jnp.inf), blocks)[0]
