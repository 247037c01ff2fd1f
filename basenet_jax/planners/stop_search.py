"""Iterated local search over sequences of stops, for more objects than exact planning can take (Lourenço et al., 2003).

A route is the robot's start, the stops in order, then the place "nowhere" as padding: driving there is free, driving
from there to a stop is never allowed, and neither it nor the start serves anything. So one formula costs routes of any
length. Each object is picked from the stop that picks it fastest; but a plan stops only to pick, so a stop left idle is
given the object that loses least by it. (Drives break the triangle inequality: a way over a third pose can be shorter.)

Every iteration costs all neighbours of a route at once. Taking one stop out, or none, and putting any in anywhere
replaces, inserts, relocates and, where "nowhere" is put in, removes; besides, any section is reversed. The cheapest
neighbour is the next route until none is cheaper. Then the route is accepted if it is hardly worse than the best, some
of its stops are changed at random, and the descent begins anew. The first one, from the empty route, inserts greedily.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

MAX_STOPS = 20  # 50 random objects on the default table need 16 at most
_NEVER = 1e4  # s: dearer than any plan
_LEAST_GAIN = 1e-3  # s, of a move; less may be rounding
# Between two descents, tuned on scenes apart: replacing matters, the rest does little.
_ACCEPTED = 1.02  # times the best cost: a route from which the search goes on
_OUT, _REPLACED = 0.2, 0.7  # how often stops are taken out, or replaced; else a section is shuffled
_MOST_CHANGED = 4  # stops taken out or replaced
_SECTION = 4  # stops shuffled


@struct.dataclass
class StopSequence:
    """Where to stop, in order, what to pick there, and what that costs."""

    stops: Int[Array, " L"]  # indices of the P candidates; then -1 as padding
    picked_at: Int[Array, " N"]  # which of the stops picks each object, 0 to L - 1; -1: none
    cost: Float[Array, ""]  # s, of all drives and picks; infinite where an object that could be served is not


def search_stops(
    pick_time: Float[Array | np.ndarray, "P N"],
    first_drive: Float[Array | np.ndarray, " P"],
    drive: Float[Array | np.ndarray, "P P"],
    key: PRNGKeyArray,
    *,
    iterations: Int[Array, ""] | int,
    start: Int[Array | np.ndarray, " S"] | None = None,
    max_stops: int | None = None,
) -> StopSequence:
    """The cheapest sequence found of stops that pick all N objects; compiled once for all numbers of iterations.

    Args:
        pick_time: s; infinite where the stop doesn't serve the object. Objects that no stop serves are left out.
        first_drive: from the robot's start to each stop (s).
        drive: from stop to stop (s), 0 for staying.
        key: consumed.
        iterations: how often all neighbours of a route are costed. The first descent takes about one for each stop.
        start: stops in order, then -1 as padding; S at most `max_stops`. The result costs no more. None: no stops.
        max_stops: L; None: N, or 20 if that is less. Fewer are faster.

    Raises:
        ValueError: the start has room for more stops than are allowed.
    """
    room = min(pick_time.shape[1], MAX_STOPS) if max_stops is None else max_stops
    if start is not None and len(start) > room:
        raise ValueError(f"start: found room for {len(start)} stops, allowed are max_stops = {room}")
    return _search(pick_time, first_drive, drive, key, iterations, start, room)


def plan_steps(sequence: StopSequence) -> tuple[Int[np.ndarray, " S"], Int[np.ndarray, " S"]]:
    """The picked objects in order, and the candidate that each is picked from: what `assemble_plan` takes."""
    stops, picked_at = np.asarray(sequence.stops), np.asarray(sequence.picked_at)
    order = np.argsort(picked_at, kind="stable")[np.sum(picked_at < 0) :]
    return order, stops[picked_at[order]]


class Costs(NamedTuple):
    """A problem with two places more, the start and nowhere, as numbers P and P + 1; no number is infinite."""

    pick: Float[Array, "N P+2"]  # s; 0 everywhere for objects that are left out
    wanted: Bool[Array, " N"]  # the others
    drive: Float[Array, "P+2 P+2"]  # s, from place to place
    drive_to: Float[Array, "P+2 P+2"]  # s, to place from place: rows are read faster than columns
    useful: Int[Array, " P"]  # the stops that serve something, and then others
    useful_count: Int[Array, ""]

    @property
    def start(self) -> int:
        """The robot's start: stops have lower numbers."""
        return len(self.drive) - 2

    @property
    def nowhere(self) -> int:
        """Where a route ends."""
        return len(self.drive) - 1


def make_costs(
    pick_time: Float[Array | np.ndarray, "P N"],
    first_drive: Float[Array | np.ndarray, " P"],
    drive: Float[Array | np.ndarray, "P P"],
) -> Costs:
    """The problem of `search_stops` as the search wants it."""
    stops = len(first_drive)
    serves = jnp.isfinite(pick_time)
    wanted = jnp.any(serves, axis=0)
    pick = jnp.pad(jnp.minimum(pick_time, _NEVER), ((0, 2), (0, 0)), constant_values=_NEVER)
    drives = jnp.pad(jnp.minimum(drive, _NEVER), (0, 2), constant_values=_NEVER)
    drives = drives.at[stops, :stops].set(jnp.minimum(first_drive, _NEVER)).at[:, stops + 1].set(0.0)
    useful = jnp.any(serves, axis=1)
    (first_useful,) = jnp.nonzero(useful, size=stops, fill_value=0)
    return Costs(jnp.where(wanted, pick, 0.0).T, wanted, drives, drives.T, first_useful, jnp.sum(useful))


def route_cost(costs: Costs, route: Int[Array, " T"]) -> tuple[Int[Array, " N"], Float[Array, ""]]:
    """From which place of a route each object is picked (0: from none), and what the route costs (s)."""
    place = jnp.arange(len(route))
    picks = costs.pick[:, route]
    here = jnp.argmin(picks, axis=1)
    drives = jnp.sum(costs.drive[route[:-1], route[1:]])

    def load(here: Array) -> Array:
        return jnp.sum((here == place[:, None]) & costs.wanted, axis=1)

    def idle(state: tuple[Array, Array, Array]) -> Array:
        here, _, seen = state
        return (route < costs.start) & (load(here) == 0) & ~seen

    def occupy(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        """Gives the first idle stop the object that loses least, of those that don't leave another stop idle."""
        here, extra, seen = state
        stop = jnp.argmax(idle(state))
        loss = picks[:, stop] - jnp.take_along_axis(picks, here[:, None], axis=1)[:, 0]
        free = costs.wanted & (load(here)[here] > 1) & (picks[:, stop] < _NEVER)
        loss = jnp.where(free, loss, _NEVER)
        lost = jnp.argmin(loss)
        return (
            here.at[lost].set(jnp.where(loss[lost] < _NEVER, stop, here[lost])),
            extra + loss[lost],
            seen.at[stop].set(True),
        )

    nothing = (here, jnp.zeros_like(drives), jnp.zeros(len(route), bool))
    here, extra, _ = jax.lax.while_loop(lambda state: jnp.any(idle(state)), occupy, nothing)
    return here, jnp.sum(jnp.min(picks, axis=1)) + extra + drives


def exchange_costs(costs: Costs, route: Int[Array, " T"]) -> Float[Array, "T P+2"]:
    """Costs (s) with one place's stop taken out and any place put in at the best gap; row 0 (the start): nothing out.

    Estimates from below: a stop that the one put in leaves idle still counts as picking nothing.
    """
    size = len(route)
    place, every = jnp.arange(size), jnp.arange(len(costs.drive))
    picking = _exchanged_picks(costs, route)
    before, after = costs.drive[route[:-1]], costs.drive_to[route[1:]]  # at each gap: drive to p, drive from p
    leg = before[place[:-1], route[1:]]
    detour = before + after - leg[:, None]
    inner = (place > 0) & (place < size - 1)
    left, right = jnp.maximum(place - 1, 0), jnp.minimum(place, size - 2)  # the gaps beside each place
    saved = jnp.where(inner, leg[left] + leg[right], 0.0)
    closed = jnp.where(inner, before[left, route[right + 1]], 0.0) - saved
    same_gap = jnp.where(inner[:, None], before[left] + after[right] - saved[:, None], jnp.inf)
    gap = place[:-1, None]
    beside = inner & ((gap == left) | (gap == right))
    full = ~inner & (route[-2] != costs.nowhere)
    allowed = jnp.where(beside | full, jnp.inf, closed)  # [gap, place]

    def over_gaps(gap: Array, best: Array) -> Array:
        return jnp.minimum(best, allowed[gap][:, None] + detour[gap])

    driving = jnp.sum(leg) + jax.lax.fori_loop(0, size - 1, over_gaps, same_gap)
    visited = jnp.zeros(len(every), bool).at[route].set(True).at[costs.nowhere].set(False)
    return jnp.where(visited & (route[:, None] != every), jnp.inf, picking + driving)


def _exchanged_picks(costs: Costs, route: Int[Array, " T"]) -> Float[Array, "T P+2"]:
    """Pick times (s) with one stop out and any in; one that picks nothing fastest takes the object that loses least."""
    picks = costs.pick[:, route]
    is_best = jnp.arange(len(route)) == jnp.argmin(picks, axis=1)[:, None]
    second = jnp.min(jnp.where(is_best, jnp.inf, picks), axis=1, keepdims=True)
    without = jnp.where(is_best, second, jnp.min(picks, axis=1, keepdims=True))  # [N, T]: the best but for one place
    unwanted = jnp.where(costs.wanted, 0.0, jnp.inf)

    # A loop over objects keeps the sums in a CPU core's nearest cache, several times faster than one 3-D reduction.
    def over_objects(item: Array, sums: tuple[Array, Array]) -> tuple[Array, Array]:
        time, loss = sums
        other, own = without[item][:, None], costs.pick[item]
        return time + jnp.minimum(other, own), jnp.minimum(loss, own - other + unwanted[item])

    zero = jnp.zeros((len(route), costs.pick.shape[1]), picks.dtype)
    loss = zero + jnp.where(jnp.arange(zero.shape[1]) == costs.nowhere, 0.0, _NEVER).astype(zero.dtype)
    time, loss = jax.lax.fori_loop(0, len(picks), over_objects, (zero, loss))
    return time + jnp.maximum(loss, 0.0)


def reversal_gains(costs: Costs, route: Int[Array, " T"]) -> Float[Array, "T-2 T-2"]:
    """By how much a route's cost changes (s) where the stops from place i + 1 to j + 1 are reversed; i < j."""
    between = costs.drive[route][:, route]
    place = jnp.arange(len(route))
    ahead = jnp.concatenate([jnp.zeros(1), jnp.cumsum(between[place[:-1], place[1:]])])  # up to each place
    back = jnp.concatenate([jnp.zeros(2), jnp.cumsum(between[place[2:], place[1:-1]])])  # from each to the first stop
    i, j = place[1:-1, None], place[1:-1]
    change = between[i - 1, j] + back[j] - back[i] + between[i, j + 1] - (ahead[j + 1] - ahead[i - 1])
    return jnp.where(i < j, change, jnp.inf)


def best_neighbour(costs: Costs, route: Int[Array, " T"]) -> tuple[Int[Array, " T"], Float[Array, ""]]:
    """The neighbour of least cost, and that cost (s, an estimate from below)."""
    place = jnp.arange(len(route))
    exchange = exchange_costs(costs, route)
    by_stop = jnp.min(exchange, axis=0)
    stop = jnp.argmin(by_stop)
    exchanged = _exchange(costs, route, jnp.argmin(exchange[:, stop]), stop)
    gains = reversal_gains(costs, route).ravel()
    first, last = jnp.divmod(jnp.argmin(gains), len(route) - 2)
    inside = (place > first) & (place <= last + 1)
    turned = route[jnp.where(inside, first + last + 2 - place, place)]
    picking = jnp.sum(jnp.min(costs.pick[:, route], axis=1))
    turned_cost = picking + jnp.sum(costs.drive[route[:-1], route[1:]]) + jnp.min(gains)
    better = turned_cost < by_stop[stop]
    return jnp.where(better, turned, exchanged), jnp.minimum(turned_cost, by_stop[stop])


def _exchange(costs: Costs, route: Int[Array, " T"], out: Array, stop: Array) -> Int[Array, " T"]:
    """The route with one place's stop out (the start: none), and another in at the best gap."""
    place = jnp.arange(len(route))
    shortened = jnp.where(place < out, route, jnp.append(route[1:], costs.nowhere))
    rest = jnp.where(out > 0, shortened, route)
    here, there = rest[:-1], rest[1:]
    gap = jnp.argmin(costs.drive_to[stop, here] + costs.drive[stop, there] - costs.drive[here, there])
    return jnp.where(place <= gap, rest, jnp.where(place == gap + 1, stop, jnp.roll(rest, 1)))


def _change(costs: Costs, route: Int[Array, " T"], key: PRNGKeyArray) -> Int[Array, " T"]:
    """Some stops out, some replaced by random ones, or a section shuffled, at random."""
    place, is_stop = jnp.arange(len(route)), route < costs.start
    draws = jax.random.uniform(key, (len(route), 3))
    kind, share, where = draws[0]  # the start stays: its row is for the route as a whole
    by_place = draws.T
    random_order = jnp.where(is_stop, by_place[0], jnp.inf)
    rank = jnp.sum(random_order < random_order[:, None], axis=1)
    chosen = is_stop & (rank <= jnp.floor(share * _MOST_CHANGED))
    out, replaced = chosen & (kind < _OUT), chosen & (kind >= _OUT) & (kind < _OUT + _REPLACED)
    random_stop = costs.useful[jnp.floor(by_place[1] * costs.useful_count).astype(jnp.int32)]
    changed = jnp.where(out, costs.nowhere, jnp.where(replaced, random_stop, route))
    begin = 1 + jnp.floor(where * jnp.sum(is_stop))
    shuffled = is_stop & (kind >= _OUT + _REPLACED) & (place >= begin) & (place < begin + _SECTION)
    position = jnp.where(shuffled, begin + _SECTION * by_place[2] * 0.999, place + 0.0)
    return changed[jnp.argsort(jnp.where(changed == costs.nowhere, jnp.inf, position))]


class _Found(NamedTuple):
    route: Int[Array, " T"]
    cost: Float[Array, ""]  # s

    def cheaper(self, other: "_Found", by: float = 0.0) -> "_Found":
        """The cheaper of two: this one, unless the other is cheaper by more than so much."""
        return jax.tree.map(lambda own, new: jnp.where(other.cost < self.cost - by, new, own), self, other)


class _State(NamedTuple):
    route: Int[Array, " T"]  # to be looked at next
    lowest: _Found  # of this descent
    accepted: _Found  # what the next descent starts from, changed
    best: _Found


@partial(jax.jit, static_argnames="max_stops")
def _search(
    pick_time: Float[Array | np.ndarray, "P N"],
    first_drive: Float[Array | np.ndarray, " P"],
    drive: Float[Array | np.ndarray, "P P"],
    key: PRNGKeyArray,
    iterations: Int[Array, ""],
    start: Int[Array | np.ndarray, " S"] | None,
    max_stops: int,
) -> StopSequence:
    costs = make_costs(pick_time, first_drive, drive)
    route = jnp.full(max_stops + 2, costs.nowhere).at[0].set(costs.start)
    if start is not None:
        route = route.at[1 : len(start) + 1].set(jnp.where(start < 0, costs.nowhere, start))

    def step(iteration: Array, state: _State) -> _State:
        return _step(costs, state, jax.random.fold_in(key, iteration))

    nothing = _Found(route, jnp.full((), jnp.inf, costs.pick.dtype))
    best = jax.lax.fori_loop(0, iterations, step, _State(route, nothing, nothing, nothing)).best.route
    here, cost = route_cost(costs, best)
    stops = jnp.where(best < costs.start, best, -1)[1:-1]
    return StopSequence(stops, here - 1, jnp.where(cost < _NEVER, cost, jnp.inf))


def _step(costs: Costs, state: _State, key: PRNGKeyArray) -> _State:
    """One route looked at: on to its cheapest neighbour, or from an accepted route to a new descent."""
    here = _Found(state.route, route_cost(costs, state.route)[1])
    # The estimate of a neighbour is a lower bound, so a move can turn out to be none: the descent ends there too.
    improved = here.cost < state.lowest.cost - _LEAST_GAIN
    lowest = state.lowest.cheaper(here, _LEAST_GAIN)
    best = state.best.cheaper(lowest)
    neighbour, estimate = best_neighbour(costs, state.route)
    goes_on = improved & (estimate < here.cost - _LEAST_GAIN)
    accepts = ~goes_on & (lowest.cost <= _ACCEPTED * best.cost)
    accepted = jax.tree.map(lambda old, new: jnp.where(accepts, new, old), state.accepted, lowest)
    route = jax.lax.cond(
        goes_on, lambda: neighbour, lambda: _change(costs, accepted.route, key).astype(neighbour.dtype)
    )
    return _State(route, lowest._replace(cost=jnp.where(goes_on, lowest.cost, jnp.inf)), accepted, best)
