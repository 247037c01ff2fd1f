"""MBP, the paper's minimum-base-poses planner: fewest stops that serve all objects, then the nearest stop next."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.cover_minimum import minimum_cover
from basenet_jax.planners.protocol import PlannerSetup, assemble_plan
from basenet_jax.planners.reachability import CandidateSource, unserved_reason
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Plan
from basenet_jax.task.prepared_world import PreparedWorld
from basenet_jax.world.scene import Scene


class Mbp:
    """Chooses fewest base poses that serve all objects and goes to the one of least navigation time next.

    Checked, it is the paper's MBP-GC, whose candidates passed the full check; else MBP, which trusts the map.
    """

    def __init__(self, setup: PlannerSetup, *, checked: bool):
        self._robot = setup.robot
        self._candidates = CandidateSource(setup, checked=checked)

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored."""
        del key
        candidates, prepared = self._candidates(scene)
        coverage = np.asarray(_coverage(self._robot, scene, candidates, prepared))
        stop_of_pose = minimum_cover(coverage)
        if np.all(stop_of_pose < 0):
            return assemble_plan(scene, np.zeros(0, int), np.zeros((0, 3)), np.asarray(unserved_reason(candidates)))
        if candidates.clutter is None:
            visits = nearest_stops(self._robot, scene, candidates, stop_of_pose, prepared)
            visited, grasps, candidates = jax.device_get((visits, _grasps(scene), candidates))
            order, pose = picks_at_stops(visited[visited >= 0], candidates, grasps)
        else:
            steps = nearest_open_stops(self._robot, scene, candidates, stop_of_pose >= 0, prepared)
            order, pose, found = jax.device_get(steps)
            order, pose, candidates = order[found], pose[found], jax.device_get(candidates)
        return assemble_plan(scene, order, candidates.base_pose[pose], np.asarray(unserved_reason(candidates)))


@jax.jit
def nearest_stops(
    robot: Robot, scene: Scene, candidates: Candidates, stop_of_pose: Int[Array, " K"], prepared: PreparedWorld
) -> Int[Array, " M"]:
    """Visits the chosen stops, always the one of least navigation time next.

    Args:
        robot: the robot.
        scene: unbatched.
        candidates: at least one.
        stop_of_pose: which stop each candidate makes, -1 for none: the nearest of those that make the same is taken.
        prepared: the candidates' poses.

    Returns:
        The visited candidates in order, padded with -1. A stop that can't be driven to is left out.
    """
    drives = prepared.departures(robot, scene.robot_start, candidates.first_drive)
    slots = len(scene.mask)  # a minimum cover has no more sets than objects

    def visit(tour: _Tour) -> _Tour:
        drive = jnp.where((stop_of_pose >= 0) & tour.remaining[stop_of_pose], drives(tour.at), jnp.inf)
        best = jnp.argmin(drive)
        found = jnp.isfinite(drive[best])
        # Where no stop is left that can be driven to, the tour is over.
        remaining = tour.remaining.at[stop_of_pose[best]].set(False) & found
        visited = tour.visited.at[tour.length].set(jnp.where(found, best, -1))
        return _Tour(tour.length + 1, best, remaining, visited)

    remaining = jnp.arange(slots) <= jnp.max(stop_of_pose)
    start = _Tour(jnp.array(0), jnp.array(-1), remaining, jnp.full(slots, -1))
    return jax.lax.while_loop(lambda tour: jnp.any(tour.remaining), visit, start).visited


@jax.jit
def nearest_open_stops(
    robot: Robot, scene: Scene, candidates: Candidates, chosen: Bool[Array, " K"], prepared: PreparedWorld
) -> tuple[Int[Array, " M"], Int[Array, " M"], Bool[Array, " M"]]:
    """Picks one object after the other where some are in the way of others: the fastest of those free at this stop.

    Where none is, the chosen stop of least navigation time at which one is free is driven to; where the chosen ones
    can't go on, any candidate.

    Args:
        robot: the robot.
        scene: unbatched.
        candidates: at least one, with the ways to pick.
        chosen: which of them make the cover.
        prepared: the candidates' poses.

    Returns:
        For each step the object's slot, the candidate, and whether there was one.
    """
    drives, slots = prepared.departures(robot, scene.robot_start, candidates.first_drive), jnp.arange(len(scene.mask))

    def step(state: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], tuple[Array, Array, Array]]:
        at, remaining = state
        time = jnp.where(remaining, candidates.times_among(remaining), jnp.inf)
        drive = jnp.where(jnp.any(jnp.isfinite(time), axis=1), drives(at), jnp.inf)
        on_cover = jnp.where(chosen, drive, jnp.inf)
        best = jnp.argmin(jnp.where(jnp.any(jnp.isfinite(on_cover)), on_cover, drive))
        found = jnp.isfinite(drive[best])
        slot = jnp.argmin(time[best])
        return (jnp.where(found, best, at), remaining & ~(found & (slots == slot))), (slot, best, found)

    return jax.lax.scan(step, (jnp.array(-1), scene.mask), length=len(scene.mask))[1]


class _Tour(NamedTuple):
    """The stops visited so far."""

    length: Int[Array, ""]
    at: Int[Array, ""]  # the candidate where the base is; -1: where it starts
    remaining: Bool[Array, " M"]  # by number of the stop
    visited: Int[Array, " M"]  # candidates, padded with -1


def picks_at_stops(
    visited: Int[np.ndarray, " S"], candidates: Candidates, grasps: Float[np.ndarray, "M G 2"]
) -> tuple[Int[np.ndarray, " P"], Int[np.ndarray, " P"]]:
    """What is picked where: at each stop all that it serves and that remains, the fastest first, then the nearest.

    Args:
        visited: the stops in order, as candidates' indices.
        candidates: on the host.
        grasps: tool0's x, y in W at each slot's grasps; infinite for those that pad.

    Returns:
        Slots in the order of the picks, and the candidate that each is picked from.
    """
    order: list[int] = []
    poses: list[int] = []
    for stop in visited:
        served = np.setdiff1d(np.flatnonzero(candidates.serves[stop]), order)
        distance = np.linalg.norm(grasps[served] - candidates.base_pose[stop, :2], axis=-1).min(axis=-1)
        order += served[np.lexsort((distance, candidates.pick_time[stop, served]))].tolist()
        poses += [int(stop)] * len(served)
    return np.array(order, int), np.array(poses, int)


@jax.jit
def _coverage(robot: Robot, scene: Scene, candidates: Candidates, prepared: PreparedWorld) -> Bool[Array, "K M"]:
    """What can be picked from the candidates that can be driven to from the start."""
    drive = candidates.first_drive
    if drive is None:
        drive = prepared.first_drives(robot, scene.robot_start[None])[0]
    return candidates.serves & jnp.isfinite(drive)[:, None]


@jax.jit
def _grasps(scene: Scene) -> Float[Array, "M G 2"]:
    grasps = scene.grasps
    return jnp.where(grasps.there[..., None], grasps.pose[..., :2], jnp.inf)
