"""Drives between poses near to those of known drives, over the vias of these: that spares searching.

Straight ways and roads of one piece are tried as always, and every piece is tested, so that such a drive can be driven;
a faster one may go over other vias.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from basenet_jax import struct
from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import straight_duration, turn_duration
from basenet_jax.task.docked_drives import SAME_POSE, straight_ways
from basenet_jax.task.gates import Gates, one_way_times
from basenet_jax.task.road_search import MOST_PIECES, away_from, gears, pieces
from basenet_jax.task.roadmap import Roadmap, road_turn_time
from basenet_jax.task.way_search import Ways, search_ways
from basenet_jax.trigonometry import atan2, wrap_angle

MOST_VIAS = MOST_PIECES + 1


@struct.dataclass
class Road:
    """The vias that a drive goes over, in order; or a batch."""

    via: Float[Array, "*batch R 2"]  # m, in W; after the last one, copies of it
    count: Int[Array, "*batch"]


def fastest_roads(robot: Robot, roadmap: Roadmap, ends: Gates) -> Road:
    """The roads of the L - 1 fastest drives from each of L poses to the next one.

    Args:
        robot: its base counts.
        roadmap: of the room.
        ends: of the poses, by `gates`.
    """
    pairs = jax.tree.map(lambda x: jnp.stack([x[:-1], x[1:]], axis=1), ends)
    return jax.lax.map(lambda pair: _road_of(robot, roadmap, search_ways(robot, roadmap, pair)), pairs)


class _Step(NamedTuple):
    """Where the way back has come to."""

    via: Int[Array, ""]
    come: Int[Array, ""]  # from where: 0 is the start, others are neighbours
    vias: Int[Array, " R"]  # so far, from the last one on
    found: Int[Array, ""]  # how many they are


def _road_of(robot: Robot, roadmap: Roadmap, ways: Ways) -> Road:
    """Of the fastest way; the last via's place in its times says where the base comes from, and so on."""
    best = jnp.argmin(ways.over)
    last, come, gear, begin, _ = jnp.unravel_index(best, ways.over.shape)
    direction, most = away_from(roadmap), roadmap.neighbour.shape[1]

    def step_back(step: _Step) -> _Step:
        before, leave = jnp.divmod(roadmap.back[step.via, step.come - 1], most)
        turn = road_turn_time(robot, direction[before, leave] - ways.first.direction[begin, before])
        straight = ways.reached.straight[before, gear, begin] + turn
        over = ways.reached.over[before, :, gear, begin] + roadmap.turn[before, :, leave]
        came = jnp.argmin(jnp.append(straight, over))
        return _Step(before, came, step.vias.at[step.found].set(before, mode="drop"), step.found + 1)

    start = _Step(last, come, jnp.full(MOST_VIAS, last), jnp.array(1))
    done = jax.lax.while_loop(lambda step: (step.come > 0) & (step.found < MOST_VIAS), step_back, start)
    faster = jnp.minimum(jnp.min(ways.straight), jnp.min(ways.direct)) <= jnp.min(ways.over)
    order = jnp.maximum(done.found - 1 - jnp.arange(MOST_VIAS), 0)
    return Road(roadmap.via[done.vias[order]], jnp.where(faster, 0, done.found))


def times_over(robot: Robot, roadmap: Roadmap, start: Gates, goal: Gates, road: Road) -> Float[Array, "S T"]:
    """Times (s) of drives from each pose to each over a road's vias, or straight, or by a road of one piece.

    Args:
        robot: its base counts.
        roadmap: of the room.
        start: of the poses to drive from, by `gates`.
        goal: likewise, to drive to.
        road: one for all of them.
    """
    leave, come = (one_way_times(each, reverse=roadmap.reverse)[i] for i, each in enumerate((start, goal)))
    begin, end = start.place.reshape(-1, 2), goal.place.reshape(-1, 2)
    heading, goal_heading = (jnp.repeat(each.pose[:, 2], each.time.shape[1]) for each in (start, goal))
    first, last = pieces(robot, roadmap, begin, road.via[:1]), pieces(robot, roadmap, road.via[-1:], end)
    direct = pieces(robot, roadmap, begin, end)
    ahead, onward, both_gears = first.direction, last.direction, gears(robot, roadmap)

    def turn(angle: Array) -> Array:
        return road_turn_time(robot, angle)

    def in_the_better_gear(out: Array, arriving: Array) -> Array:
        """The turns at both ends, in directions of leaving and arriving."""
        turns = [turn(out + gear - heading[:, None]) + turn(goal_heading - arriving - gear) for gear in both_gears]
        return jnp.min(jnp.stack(turns), axis=0)

    along, between = _middle(robot, road)
    several = turn(along[0] - ahead) + between + turn(onward - along[1])
    over = first.time + jnp.where(road.count == 1, turn(onward - ahead), several) + last.time
    over = jnp.where(road.count > 0, over + in_the_better_gear(ahead, onward), jnp.inf)
    one_piece = direct.time + in_the_better_gear(direct.direction, direct.direction)
    one_piece = jnp.where(direct.same, turn(goal_heading - heading[:, None]), one_piece)
    roads = jnp.minimum(over, one_piece).reshape(*leave.shape, *come.shape)
    docked = jnp.min(leave[:, :, None, None] + roads + come, axis=(1, 3))
    angle = goal.pose[:, 2] - start.pose[:, None, 2]
    if robot.omnidirectional:
        docked += turn_duration(robot, angle)
    shift = goal.pose[:, :2] - start.pose[:, None, :2]
    same = jnp.all(jnp.abs(shift) <= SAME_POSE, axis=-1) & (jnp.abs(wrap_angle(angle)) <= SAME_POSE)
    straight = jnp.min(jnp.stack(straight_ways(robot, roadmap, start, goal)), axis=0)
    return jnp.where(same, 0.0, jnp.minimum(docked, straight))


def _middle(robot: Robot, road: Road) -> tuple[tuple[Array, Array], Array]:
    """Of the pieces between a road's vias: directions of the first and the last, and the time (s) from via to via."""
    step = road.via[1:] - road.via[:-1]
    there = jnp.arange(len(step)) < road.count - 1
    direction = atan2(step[:, 1], jnp.where(there, step[:, 0], 1.0))
    time = jnp.where(there, straight_duration(robot, jnp.sqrt(jnp.sum(step * step, axis=-1))), 0.0)
    turns = jnp.where(there[1:], road_turn_time(robot, direction[1:] - direction[:-1]), 0.0)
    final = direction[jnp.maximum(road.count - 2, 0)]
    return (direction[0], final), jnp.sum(time) + jnp.sum(turns)
