"""All ways between two poses at once, with what they take: what is traced back to find the fastest one's legs."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import turn_duration
from basenet_jax.task.docked_drives import straight_ways
from basenet_jax.task.gates import Gates, one_way_times
from basenet_jax.task.road_search import Pieces, Reached, away_from, gears, pieces, reach_vias
from basenet_jax.task.roadmap import Roadmap, road_turn_time


class Ways(NamedTuple):
    """Times (s) of all ways between two poses with K turning places each, and what they are made of."""

    straight: Float[Any, " W"]  # see `straight_ways`
    direct: Float[Any, "G K K"]  # by road without vias, by gear and turning places
    over: Float[Any, "V from G K K"]  # by the last via and where the base comes from: the start, or a neighbour
    reached: Reached  # from the turning places of the start
    first: Pieces  # from them to all vias
    places: Float[Any, "2 K 2"]  # m, of start and goal


def search_ways(robot: Robot, roadmap: Roadmap, both: Gates) -> Ways:
    """The ways from one pose to another.

    Args:
        robot: its base counts.
        roadmap: of the room.
        both: of the two poses, by `gates`.
    """
    start, goal = (jax.tree.map(lambda x, i=i: x[i : i + 1], both) for i in range(2))
    gear, vias, heading = gears(robot, roadmap), len(roadmap.via), both.pose[:, 2]
    begin = jnp.concatenate([both.place[0], jnp.broadcast_to(heading[0], (len(both.place[0]), 1))], axis=-1)
    ahead = pieces(robot, roadmap, both.place[0], jnp.concatenate([roadmap.via, both.place[1]]))
    first, direct = (Pieces(*(x[:, some] for x in ahead)) for some in (slice(vias), slice(vias, None)))
    last = pieces(robot, roadmap, roadmap.via, both.place[1])
    reached = reach_vias(robot, roadmap, begin, first)

    def turn(angle: Array) -> Array:
        return road_turn_time(robot, angle)

    def onto(come: Array) -> Array:
        """From directions of arriving at each via, its last axes counting gears and places, to each last piece."""
        return turn(jnp.expand_dims(last.direction, tuple(range(1, come.ndim))) - come[..., None])

    leave, come = (one_way_times(each, reverse=roadmap.reverse)[i] for i, each in enumerate((start, goal)))
    docks = leave[0, :, None] + come[0]
    if robot.omnidirectional:
        docks += turn_duration(robot, heading[1] - heading[0])
    turns = turn(direct.direction + gear[:, None, None] - heading[0])
    turns += turn(heading[1] - direct.direction - gear[:, None, None])
    in_place = turn(heading[1] - heading[0])
    comes = jnp.concatenate(
        [
            reached.straight[:, None, ..., None] + onto(first.direction.T[:, None, None]),
            reached.over[..., None] + onto((away_from(roadmap) + jnp.pi)[..., None, None]),
        ],
        axis=1,
    )
    onward = last.time[:, None] + turn(heading[1] - last.direction[:, None] - gear[:, None])
    return Ways(
        straight=jnp.stack(straight_ways(robot, roadmap, start, goal)).ravel(),
        direct=jnp.where(direct.same, in_place, direct.time + turns) + docks,
        over=comes + onward[:, None, :, None] + docks,
        reached=reached,
        first=first,
        places=both.place,
    )
