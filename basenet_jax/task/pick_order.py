"""What to pick at which visit of a sequence of stops, where objects are in each other's way."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.task.clutter import Clutter, as_bits


class PickOrder(NamedTuple):
    """The picks of M objects, by slot. They are in order by (visit, turn); those of one visit and turn in any."""

    visit: Int[Array, " M"]  # -1: not picked
    turn: Int[Array, " M"]
    time: Float[Array, " M"]  # s; infinite where it isn't picked


class _Round(NamedTuple):
    """Where the first pass stands: everything is picked as soon as it can be."""

    visit: Int[Array, ""]
    turn: Int[Array, ""]
    picked_at: Int[Array, " M"]
    turn_of: Int[Array, " M"]


def order_picks(clutter: Clutter, mask: Bool[Array, " M"], visited: Int[Array, " T"]) -> PickOrder:
    """Picks at the visits of a sequence of stops, so that nothing is in the way: all that the visits can have.

    First everything is picked as soon as it can be. Then, from the last object to the first, each goes to the visit
    where picking it is fastest, among those from its own up to the first at which it must be gone for another.

    Args:
        clutter: the ways, unbatched.
        mask: the objects that are wanted; others are in nobody's way.
        visited: stops, -1: none.
    """
    stop = jnp.maximum(visited, 0)
    at = Clutter(jnp.where((visited >= 0)[:, None, None], clutter.time[stop], jnp.inf), clutter.blockers[stop])
    soonest = _as_soon_as_possible(at, mask)
    return _as_fast_as_possible(at, mask, soonest)


def _as_soon_as_possible(at: Clutter, mask: Bool[Array, " M"]) -> _Round:
    visits, slots = at.time.shape[:2]

    def step(state: _Round) -> _Round:
        """Picks all that can be picked while all of that stands, or drives on."""
        standing = mask & (state.picked_at < 0)
        here = jax.tree.map(lambda x: x[state.visit][None], at)
        open_now = standing & jnp.isfinite(here.times_among(standing)[0])
        return _Round(
            visit=state.visit + ~jnp.any(open_now),
            turn=state.turn + 1,
            picked_at=jnp.where(open_now, state.visit, state.picked_at),
            turn_of=jnp.where(open_now, state.turn, state.turn_of),
        )

    nobody = jnp.full(slots, -1, jnp.int32)
    start = _Round(jnp.array(0, jnp.int32), jnp.array(0, jnp.int32), nobody, jnp.zeros_like(nobody))
    return jax.lax.while_loop(lambda s: (s.visit < visits) & jnp.any(mask & (s.picked_at < 0)), step, start)


def _as_fast_as_possible(at: Clutter, mask: Bool[Array, " M"], soonest: _Round) -> PickOrder:
    visits, slots = at.time.shape[:2]
    visit_number, objects = jnp.arange(visits), jnp.arange(slots)
    picked = mask & (soonest.picked_at >= 0)

    def place(state: tuple[Array, Array, Array], item: Array) -> tuple[tuple[Array, Array, Array], None]:
        """One object, all those after it being placed."""
        visit_of, time_of, latest = state
        before = picked & (soonest.turn_of < soonest.turn_of[item])
        gone = before | ((time_of >= 0) & (visit_of < visit_number[:, None]))
        standing = as_bits(mask & ~gone & (objects != item))
        blocked = jnp.any((at.blockers[:, item] & standing[:, None]) != 0, axis=-1)
        times = jnp.where(blocked, jnp.inf, at.time[:, item])
        allowed = (visit_number >= soonest.picked_at[item]) & (visit_number <= latest[item])
        times = jnp.where(allowed[:, None], times, jnp.inf)
        visit, way = jnp.divmod(jnp.argmin(times), times.shape[1])
        needed = (at.blockers[visit, item, way][objects // 32] >> (objects % 32).astype(jnp.uint32)) & 1
        latest = jnp.where((needed == 1) & picked[item], jnp.minimum(latest, visit), latest)
        visit_of = visit_of.at[item].set(jnp.where(picked[item], visit, -1))
        return (visit_of, time_of.at[item].set(jnp.where(picked[item], jnp.min(times), -1.0)), latest), None

    last_first = jnp.argsort(jnp.where(picked, -soonest.turn_of, 1), stable=True)
    start = (soonest.picked_at, jnp.full(slots, -1.0, at.time.dtype), jnp.full(slots, visits, jnp.int32))
    (visit_of, time_of, _), _ = jax.lax.scan(place, start, last_first)
    return PickOrder(visit_of, soonest.turn_of, jnp.where(picked, time_of, jnp.inf))
