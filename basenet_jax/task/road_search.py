"""Least times along roads: from turning places, over vias, to turning places, all in one search for many of them.

The state of the search is a via and the neighbour that the base comes from, since what the next turn takes depends on
it. Driving all forward or all in reverse only changes the first and the last turn; a base that drives in any direction
turns elsewhere, and has one gear.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds
from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import straight_duration
from basenet_jax.task.drive_space import is_free
from basenet_jax.task.roadmap import BLOCK, SAME_PLACE_M, Roadmap, road_turn_time
from basenet_jax.trigonometry import atan2

MOST_PIECES = 16  # between vias
_AT_ONCE = 64  # places from which roads are searched at once
_FEW_SUMS = 1 << 20  # so many are formed at once: loops that leave out what needn't be formed cost more
_GOALS = 16  # of those seen from a via, that are gone on to at once


class Pieces(NamedTuple):
    """Straight pieces from A points to B points."""

    direction: Float[Array, "A B"]  # rad, in W
    time: Float[Array, "A B"]  # s; infinite: not free, or no piece at all
    same: Bool[Array, "A B"]  # whether the two points are one


class Reached(NamedTuple):
    """Least times (s) from P places, in G gears, to arriving at V vias, the last turn still to come."""

    straight: Float[Array, "V G P"]  # from the place itself
    over: Float[Array, "V D G P"]  # from another via, the neighbour of that number


def road_times(
    robot: Robot, roadmap: Roadmap, start: Float[Array, "P 3"], goal: Float[Array, "Q 3"]
) -> Float[Array, "2 P Q"]:
    """Least times (s) to turn, drive a road and turn, between poses at turning places; infinite if there is no road.

    Turned by half a turn, a base drives the same way in the other gear. So headings count up to half a turn: the first
    times are of poses as given, and if both are turned; the second ones if one of the two is.

    Args:
        robot: its base counts.
        roadmap: of the room.
        start: poses (x, y, heading) in W.
        goal: likewise.
    """
    last = pieces(robot, roadmap, roadmap.via, goal[:, :2])
    times = rounds.in_chunks(lambda some: _roads(robot, roadmap, some, goal, last), start, _AT_ONCE)
    return jnp.moveaxis(times, 1, 0)


def gears(robot: Robot, roadmap: Roadmap) -> Float[Array, " G"]:
    """From the direction of driving to the heading (rad): forward and, where it is allowed, reverse."""
    return jnp.array([0.0, jnp.pi]) if roadmap.reverse and not robot.omnidirectional else jnp.zeros(1)


def pieces(robot: Robot, roadmap: Roadmap, start: Float[Array, "A 2"], end: Float[Array, "B 2"]) -> Pieces:
    """All straight pieces between turning places."""
    begin, x, y = (start[:, None, 0], start[:, None, 1]), end[:, 0], end[:, 1]
    along, up = x - begin[0], y - begin[1]
    length = jnp.sqrt(along * along + up * up)
    same = length < SAME_PLACE_M
    time = straight_duration(robot, length)
    free = is_free(roadmap.space, begin, (x, y)) & ~same
    return Pieces(atan2(up, along), jnp.where(free, time, jnp.inf), same)


def reach_vias(robot: Robot, roadmap: Roadmap, start: Float[Array, "P 3"], first: Pieces) -> Reached:
    """From poses at turning places to all vias.

    Rounds of relaxing all pieces between vias at once, until none makes any way shorter.

    Args:
        robot: its base counts.
        roadmap: of the room.
        start: poses (x, y, heading) in W.
        first: from each straight to each via.
    """
    direction, away = first.direction.T, away_from(roadmap)
    first_turn = road_turn_time(robot, direction[:, None] + gears(robot, roadmap)[:, None] - start[:, 2])
    straight = jnp.where(roadmap.is_via[:, None, None], first.time.T[:, None] + first_turn, jnp.inf)
    onto = road_turn_time(robot, away[:, :, None] - direction[:, None])
    seed = roadmap.time[:, :, None, None] + (straight[:, None] + onto[:, :, None])
    if roadmap.turn.size * seed.shape[2] * seed.shape[3] <= _FEW_SUMS:
        return Reached(straight, _relax_all(roadmap, seed))
    return Reached(straight, _relax_rows(roadmap, seed))


def _relax_all(roadmap: Roadmap, seed: Float[Array, "V D G P"]) -> Float[Array, "V D G P"]:
    """Times of arriving at vias, from those of setting out on pieces; by all sums at once."""

    def arrive(left: Array) -> Array:
        """Pieces by where they end instead of by where they begin."""
        return left.reshape(roadmap.time.size, -1)[roadmap.back.ravel()].reshape(seed.shape)

    def relax(over: Array, _: Array) -> Array:
        left = jnp.min(over[:, :, None] + roadmap.turn[..., None, None], axis=1)
        return jnp.minimum(over, arrive(left + roadmap.time[:, :, None, None]))

    return _until_nothing_is_faster(relax, arrive(seed))


def _relax_rows(roadmap: Roadmap, seed: Float[Array, "V D G P"]) -> Float[Array, "V D G P"]:
    """The same over the pieces that there are, block by block, where the lists of neighbours are long and few full."""
    rows, size, most = roadmap.rows, roadmap.time.size, roadmap.neighbour.shape[1]
    there = rows < size
    place = jnp.zeros(size, jnp.int32).at[rows].set(jnp.arange(len(rows)), mode="drop")
    other_end = jnp.where(there, place[roadmap.back.ravel()[jnp.minimum(rows, size - 1)]], len(rows) - 1)
    time = jnp.where(there, roadmap.time.ravel()[jnp.minimum(rows, size - 1)], jnp.inf)[:, None, None]
    via, degree = jnp.minimum(rows // most, len(roadmap.via) - 1), _degree(roadmap)
    owner, column = via[::BLOCK], rows[::BLOCK] % most
    block = (owner, column, place[owner * most], there[::BLOCK] & (column < degree[owner]))

    def relax(over: Array, faster: Array) -> Array:
        # From other vias nobody sets out: none has come to them faster since they were left last.
        count = jnp.where(jnp.zeros(len(roadmap.via), bool).at[via].max(faster), degree, 0)

        def leave(block: tuple[Array, ...]) -> Array:
            via, column, first, there = block
            turn = jax.lax.dynamic_slice(roadmap.turn, (via, 0, column), (1, most, BLOCK))[0]
            return _least_sum(over, turn, jnp.where(there, count[via], 0), first)

        left = jax.lax.map(leave, block).reshape(over.shape)
        return jnp.minimum(over, (left + time)[other_end])

    first = seed.reshape(size, *seed.shape[2:]).at[rows].get(mode="fill", fill_value=jnp.inf)[other_end]
    over = _until_nothing_is_faster(relax, first)
    whole = jnp.full((size, *over.shape[1:]), jnp.inf, over.dtype)
    return whole.at[rows].set(over, mode="drop").reshape(seed.shape)


def _until_nothing_is_faster(relax: Callable[[Array, Array], Array], first: Array) -> Array:
    """Rounds of relaxing, which is told the rows that became faster in the last one."""

    def again(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        over, faster, count = state
        new = relax(over, faster)
        return new, jnp.any(new < over, axis=(-2, -1)), count + 1

    start = (first, jnp.ones(first.shape[:-2], bool), jnp.array(1))
    return jax.lax.while_loop(lambda state: jnp.any(state[1]) & (state[2] < MOST_PIECES), again, start)[0]


def away_from(roadmap: Roadmap) -> Float[Array, "V D"]:
    """Directions (rad, in W) from each via to its neighbours."""
    along = roadmap.via[roadmap.neighbour] - roadmap.via[:, None]
    return atan2(along[..., 1], along[..., 0])


def _roads(robot: Robot, roadmap: Roadmap, start: Array, goal: Array, last: Pieces) -> Float[Array, "P 2 Q"]:
    """Of all goals, via by via: each way's last piece starts there, but for those without a via."""
    gear, vias = gears(robot, roadmap)[:, None], len(roadmap.via)
    ahead = pieces(robot, roadmap, start[:, :2], jnp.concatenate([roadmap.via, goal[:, :2]]))
    first, direct = (Pieces(*(x[:, some] for x in ahead)) for some in (slice(vias), slice(vias, None)))
    reached = reach_vias(robot, roadmap, start, first)

    def onto_goal(arrived: Array, direction: Array, heading: Array) -> Array:
        """With the last turn, of the goal's heading and of the opposite one."""
        turn = road_turn_time(robot, heading[:, None] - direction[:, None] - gear[:, 0])[..., None]
        return jnp.stack([jnp.min(arrived + each, axis=1) for each in (turn, turn[:, ::-1])])

    def from_all_at_once(straight: Array, over: Array, away: Array, arriving: Array, leaving: Array, time: Array):
        turn = road_turn_time(robot, leaving - away[:, None] - jnp.pi)
        arrived = jnp.min(over[:, None] + turn[..., None, None], axis=0)
        arrived = jnp.minimum(arrived, straight + road_turn_time(robot, leaving[:, None] - arriving)[:, None])
        return onto_goal(arrived + time[:, None, None], leaving, goal[:, 2])

    def from_via(ways: Array, via: tuple[Array, ...]) -> tuple[Array, None]:
        """To the goals that are seen from there, some at a time: in large rooms these are few of all."""
        straight, over, away, arriving, leaving, time, degree = via
        (seen,) = jnp.nonzero(jnp.isfinite(time), size=len(time), fill_value=len(time))
        seen = jnp.pad(seen, (0, -len(time) % _GOALS), constant_values=len(time))

        def some(index: Array, ways: Array) -> Array:
            which = jax.lax.dynamic_slice_in_dim(seen, _GOALS * index, _GOALS)
            direction, onward, heading = (x.at[which].get(mode="clip") for x in (leaving, time, goal[:, 2]))
            turn = road_turn_time(robot, direction - away[:, None] - jnp.pi)
            arrived = _least_sum(over, turn, degree)
            arrived = jnp.minimum(arrived, straight + road_turn_time(robot, direction[:, None] - arriving)[:, None])
            return ways.at[:, which].min(onto_goal(arrived + onward[:, None, None], direction, heading), mode="drop")

        return jax.lax.fori_loop(0, -(-jnp.sum(jnp.isfinite(time)) // _GOALS), some, ways), None

    first_turn = road_turn_time(robot, direct.direction + gear[..., None] - start[:, 2, None])
    last_turn = road_turn_time(robot, goal[:, 2] - direct.direction - gear[..., None])
    turns = jnp.stack([jnp.min(first_turn + each, axis=0) for each in (last_turn, last_turn[::-1])])
    halves = jnp.array([0.0, jnp.pi])[:, None, None]
    in_place = road_turn_time(robot, goal[:, 2] - start[:, 2, None] + halves)
    ways = jnp.where(direct.same, in_place, direct.time + turns)
    from_vias = (reached.straight, reached.over, away_from(roadmap), first.direction.T, last.direction, last.time)
    ways = jnp.swapaxes(ways, 1, 2)
    if reached.over.size * len(goal) <= _FEW_SUMS:
        ways = jnp.minimum(ways, jnp.min(jax.vmap(from_all_at_once)(*from_vias), axis=0))
    else:
        ways = jax.lax.scan(from_via, ways, (*from_vias, _degree(roadmap)))[0]
    return jnp.moveaxis(ways, 2, 0)


def _degree(roadmap: Roadmap) -> Int[Array, " V"]:
    """How many neighbours each via has."""
    return jnp.sum(jnp.isfinite(roadmap.time), axis=1)


def _least_sum(
    before: Float[Array, "R G P"], turn: Float[Array, "D X"], count: Array, first: Array | int = 0
) -> Float[Array, "X G P"]:
    """The least of before + turn over `count` rows, of `before` from its `first` on, a block of them at a time."""

    def block(index: Array, best: Array) -> Array:
        some = jax.lax.dynamic_slice_in_dim(before, first + BLOCK * index, BLOCK)
        turns = jax.lax.dynamic_slice_in_dim(turn, BLOCK * index, BLOCK)
        for row in range(BLOCK):
            other = some[row] + turns[row][:, None, None]  # never NaN, which `jnp.minimum` would look for
            best = jnp.where(other < best, other, best)
        return best

    none = jnp.full((turn.shape[1], *before.shape[1:]), jnp.inf, before.dtype)
    return jax.lax.fori_loop(0, -(-count // BLOCK), block, none)
