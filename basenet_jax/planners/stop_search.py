"""Iterated local search over sequences of stops, for more objects than exact planning can take (Lourenço et al., 2003).

Every iteration costs all neighbours of a route at once (see `stop_moves`). The cheapest neighbour is the next route
until none is cheaper. Then the route is accepted if it is hardly worse than the best, some of its stops are changed at
random, and the descent begins anew. The first one, from the empty route, inserts greedily.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from basenet_jax import struct
from basenet_jax.planners.stop_moves import NEVER, Costs, best_neighbour, make_costs, route_picks
from basenet_jax.task.clutter import Clutter

MAX_STOPS = 20  # 50 random objects on the default table need 16 at most
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
    turn: Int[Array, " N"]  # which of the objects of one stop come first
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
    clutter: Clutter | None = None,
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
        clutter: the ways to pick, where objects are in each other's way. Neighbours are costed as if none were, routes
            that are looked at as they are.

    Raises:
        ValueError: the start has room for more stops than are allowed.
    """
    room = min(pick_time.shape[1], MAX_STOPS) if max_stops is None else max_stops
    if start is not None and len(start) > room:
        raise ValueError(f"start: found room for {len(start)} stops, allowed are max_stops = {room}")
    return _search(pick_time, first_drive, drive, key, iterations, start, clutter, room)


def plan_steps(sequence: StopSequence) -> tuple[Int[np.ndarray, " S"], Int[np.ndarray, " S"]]:
    """The picked objects in order, and the candidate that each is picked from: what `assemble_plan` takes."""
    stops, picked_at, turn = (np.asarray(x) for x in (sequence.stops, sequence.picked_at, sequence.turn))
    order = np.lexsort((turn, picked_at))[np.sum(picked_at < 0) :]
    return order, stops[picked_at[order]]


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
    clutter: Clutter | None,
    max_stops: int,
) -> StopSequence:
    costs = make_costs(pick_time, first_drive, drive, clutter)
    route = jnp.full(max_stops + 2, costs.nowhere).at[0].set(costs.start)
    if start is not None:
        route = route.at[1 : len(start) + 1].set(jnp.where(start < 0, costs.nowhere, start))

    def step(iteration: Array, state: _State) -> _State:
        return _step(costs, state, jax.random.fold_in(key, iteration))

    nothing = _Found(route, jnp.full((), jnp.inf, costs.pick.dtype))
    best = jax.lax.fori_loop(0, iterations, step, _State(route, nothing, nothing, nothing)).best.route
    picks = route_picks(costs, best)
    stops = jnp.where(best < costs.start, best, -1)[1:-1]
    return StopSequence(stops, picks.place - 1, picks.turn, jnp.where(picks.cost < NEVER, picks.cost, jnp.inf))


def _step(costs: Costs, state: _State, key: PRNGKeyArray) -> _State:
    """One route looked at: on to its cheapest neighbour, or from an accepted route to a new descent."""
    here = _Found(state.route, route_picks(costs, state.route).cost)
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
