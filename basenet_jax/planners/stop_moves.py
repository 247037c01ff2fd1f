"""Routes over stops, what they cost, and all their neighbours at once.

A route is the robot's start, the stops in order, then the place "nowhere" as padding: driving there is free, driving
from there to a stop is never allowed, and neither it nor the start serves anything. So one formula costs routes of any
length. Each object is picked from the stop that picks it fastest; but a plan stops only to pick, so a stop left idle is
given the object that loses least by it. (Drives break the triangle inequality: a way over a third pose can be shorter.)

Taking one stop out, or none, and putting any in anywhere replaces, inserts, relocates and, where "nowhere" is put in,
removes; besides, any section is reversed.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.task.clutter import Clutter
from basenet_jax.task.pick_order import order_picks

NEVER = 1e4  # s: dearer than any plan


class Costs(NamedTuple):
    """A problem with two places more, the start and nowhere, as numbers P and P + 1; no number is infinite."""

    pick: Float[Array, "N P+2"]  # s; 0 everywhere for objects that are left out
    wanted: Bool[Array, " N"]  # the others
    drive: Float[Array, "P+2 P+2"]  # s, from place to place
    drive_to: Float[Array, "P+2 P+2"]  # s, to place from place: rows are read faster than columns
    useful: Int[Array, " P"]  # the stops that serve something, and then others
    useful_count: Int[Array, ""]
    clutter: Clutter | None  # of the P stops

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
    clutter: Clutter | None = None,
) -> Costs:
    """The problem of `search_stops` as the search wants it."""
    stops = len(first_drive)
    serves = jnp.isfinite(pick_time)
    wanted = jnp.any(serves, axis=0)
    pick = jnp.pad(jnp.minimum(pick_time, NEVER), ((0, 2), (0, 0)), constant_values=NEVER)
    drives = jnp.pad(jnp.minimum(drive, NEVER), (0, 2), constant_values=NEVER)
    drives = drives.at[stops, :stops].set(jnp.minimum(first_drive, NEVER)).at[:, stops + 1].set(0.0)
    useful = jnp.any(serves, axis=1)
    (first_useful,) = jnp.nonzero(useful, size=stops, fill_value=0)
    return Costs(jnp.where(wanted, pick, 0.0).T, wanted, drives, drives.T, first_useful, jnp.sum(useful), clutter)


class RoutePicks(NamedTuple):
    """What a route comes to."""

    place: Int[Array, " N"]  # from which of its places each object is picked (0: from none)
    turn: Int[Array, " N"]  # which of those that are picked from one place come first
    cost: Float[Array, ""]  # s


def route_picks(costs: Costs, route: Int[Array, " T"]) -> RoutePicks:
    """From where of a route each object is picked, and what the route costs."""
    if costs.clutter is None:
        here, cost = route_cost(costs, route)
        return RoutePicks(here, jnp.zeros_like(here), cost)
    order = order_picks(costs.clutter, costs.wanted, jnp.where(route < costs.start, route, -1))
    picked_from = jnp.any(order.visit == jnp.arange(len(route))[:, None], axis=1).at[0].set(True)
    between = costs.drive[route][:, route]

    def leg(before: Array, place: Array) -> tuple[Array, Array]:
        """Stops where nothing is picked are passed by."""
        there = picked_from[place]
        return jnp.where(there, place, before), jnp.where(there, between[before, place], 0.0)

    _, legs = jax.lax.scan(leg, jnp.array(0), jnp.arange(1, len(route)))
    picking = jnp.where(costs.wanted, jnp.minimum(order.time, NEVER), 0.0)
    return RoutePicks(jnp.maximum(order.visit, 0), order.turn, jnp.sum(legs) + jnp.sum(picking))


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
        free = costs.wanted & (load(here)[here] > 1) & (picks[:, stop] < NEVER)
        loss = jnp.where(free, loss, NEVER)
        lost = jnp.argmin(loss)
        return (
            here.at[lost].set(jnp.where(loss[lost] < NEVER, stop, here[lost])),
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
    loss = zero + jnp.where(jnp.arange(zero.shape[1]) == costs.nowhere, 0.0, NEVER).astype(zero.dtype)
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
