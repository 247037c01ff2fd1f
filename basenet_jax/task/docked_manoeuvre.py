"""The drive that `drive_times` is the time of: found by the same search in float64, and traced back."""

import dataclasses
import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from basenet_jax.robot.model import Robot
from basenet_jax.task.docked_drives import SAME_POSE
from basenet_jax.task.drive_space import TOUCHING_M, DriveSpace
from basenet_jax.task.gates import gates
from basenet_jax.task.manoeuvre import Manoeuvre, through, turn_time
from basenet_jax.task.roadmap import SAME_PLACE_M, Roadmap
from basenet_jax.task.way_search import Ways, search_ways

_TOUCHING_M = 3.0 * TOUCHING_M  # so that what float32 calls free is free here


def find_manoeuvre(
    robot: Robot, roadmap: Roadmap, start: Float[ArrayLike, "3"], goal: Float[ArrayLike, "3"]
) -> Manoeuvre:
    """The fastest drive from one pose (x, y, heading in W) to another; on the host.

    Args:
        robot: its base counts.
        roadmap: of the room.
        start: pose to drive from.
        goal: pose to drive to.

    Raises:
        ValueError: there is no way.
    """
    ends = np.array([start, goal], float)
    shift = ends[1] - ends[0]
    if np.hypot(*shift[:2]) <= SAME_POSE and abs(np.remainder(shift[2] + np.pi, 2 * np.pi) - np.pi) <= SAME_POSE:
        return Manoeuvre(())
    with jax.enable_x64(True):
        found = jax.device_get(_search(robot, roadmap, ends))
    kinds = (found.straight, found.direct, found.over)
    kind = int(np.argmin([ways.min() for ways in kinds]))
    way = tuple(map(int, np.unravel_index(kinds[kind].argmin(), kinds[kind].shape)))
    if not np.isfinite(kinds[kind][way]):
        raise ValueError(f"goal: {ends[1].tolist()} can't be reached from {ends[0].tolist()}: no drive between is free")
    if kind == 0:
        poses = _turn_straight_turn(robot, ends[0], ends[1], way[0])
    else:
        gear, begin, end = way[-3:]
        vias = _trace_back(robot, jax.device_get(roadmap), found, way) if kind == 2 else []
        poses = _docked(robot, ends[0], ends[1], [found.places[0, begin], *vias, found.places[1, end]], np.pi * gear)
    poses = np.array(poses)
    return through(robot, np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])]))


@jax.jit
def _search(robot: Robot, roadmap: Roadmap, ends: Float[Array, "2 3"]) -> Ways:
    roadmap = jax.tree.map(lambda x: x.astype(ends.dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, roadmap)
    space: DriveSpace = dataclasses.replace(roadmap.space, touching=jnp.asarray(_TOUCHING_M))
    roadmap = dataclasses.replace(roadmap, space=space)
    return search_ways(robot, roadmap, gates(robot, roadmap.space, ends))


def _trace_back(robot: Robot, roadmap: Roadmap, found: Ways, way: tuple[int, ...]) -> list[Float[np.ndarray, "2"]]:
    """The vias of a way of `over`: the last one's place there says where the base comes from, and so on."""
    via, come, gear, begin = way[:4]
    vias, away = [via], roadmap.via[roadmap.neighbour] - roadmap.via[:, None]
    direction = np.arctan2(away[..., 1], away[..., 0])
    while come > 0:
        before, leave = np.divmod(roadmap.back[via, come - 1], roadmap.neighbour.shape[1])
        turn = 0.0 if robot.omnidirectional else direction[before, leave] - found.first.direction[begin, before]
        straight = found.reached.straight[before, gear, begin] + turn_time(robot, math.remainder(turn, 2.0 * math.pi))
        over = found.reached.over[before, :, gear, begin] + roadmap.turn[before, :, leave]
        via, come = int(before), int(np.argmin([straight, *over]))
        vias.append(via)
    return [np.asarray(roadmap.via[via], float) for via in reversed(vias)]


def _turn_straight_turn(robot: Robot, start: np.ndarray, goal: np.ndarray, way: int) -> list[np.ndarray]:
    """The poses of a way of `straight_ways`."""
    if np.hypot(*(goal - start)[:2]) <= SAME_POSE:
        return [start, np.array([*start[:2], goal[2]])]
    if robot.omnidirectional:
        return [start, np.array([*start[:2], goal[2]]) if way == 0 else np.array([*goal[:2], start[2]]), goal]
    heading = np.arctan2(*(goal - start)[1::-1]) + np.pi * way
    return [start, np.array([*start[:2], heading]), np.array([*goal[:2], heading]), goal]


def _docked(robot: Robot, start: np.ndarray, goal: np.ndarray, road: list[np.ndarray], gear: float) -> list[np.ndarray]:
    """The poses of a way over a road, from its first point to its last; one that is no way at all turns there alone."""
    poses = [start, np.array([*road[0], start[2]])]
    for before, after in itertools.pairwise(road):
        if np.hypot(*(after - before)) < SAME_PLACE_M:
            continue
        heading = goal[2] if robot.omnidirectional else np.arctan2(*(after - before)[::-1]) + gear
        poses += [np.array([*before, heading]), np.array([*after, heading])]
    return [*poses, np.array([*road[-1], goal[2]]), goal]
