"""Greedy stops: drive where it pays most at once, pick all that can be picked there, repeat. Nothing is learned."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.options import GreedyStopsOptions
from basenet_jax.planners.protocol import PlannerSetup, assemble_plan, no_plan
from basenet_jax.planners.reachability import CandidateSource, unserved_reason
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.task.prepared_world import PreparedWorld
from basenet_jax.world.scene import Scene


class GreedyStops:
    """On validated candidates: next the stop of least navigation + excess pick time - worth of the objects served."""

    def __init__(self, setup: PlannerSetup, options: GreedyStopsOptions = GreedyStopsOptions()):
        self._setup = setup
        self._candidates = CandidateSource(setup, checked=True)
        self._worth = options.seconds_per_object

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored."""
        del key
        candidates, prepared = self._candidates(scene)
        reason = np.asarray(unserved_reason(candidates))
        if not len(candidates.base_pose):
            return assemble_plan(scene, np.zeros(0, int), np.zeros((0, 3), np.float32), reason)
        stops = greedy_stops(self._setup.robot, scene, candidates, self._worth, prepared)
        pose, serves = jax.device_get((stops.base_pose, stops.serves))
        stop, slot = np.nonzero(serves)
        return assemble_plan(scene, slot, pose[stop], reason)

    def preparations(self, scene: Scene) -> Sequence[Callable[[], object]]:
        """See `PreparedPlanner`."""
        robot, world = self._setup.robot, self._setup.world
        judged = (robot, scene, no_plan(scene), self._setup.docked)
        return [*self._candidates.preparations(scene), partial(compiled_execute.prepare, *judged, config=world)]


class Stops(NamedTuple):
    """Stops in order, padded to M."""

    base_pose: Float[Array, "M 3"]
    serves: Bool[Array, "M M"]  # [stop, slot]: what is picked there; nothing at padding


@jax.jit
def greedy_stops(
    robot: Robot, scene: Scene, candidates: Candidates, worth: Float[Array, ""] | float, prepared: PreparedWorld
) -> Stops:
    """The greedy rule.

    Args:
        robot: the robot.
        scene: unbatched.
        candidates: at least one, with validated pick times.
        worth: of one object served (s).
        prepared: the candidates' poses.
    """
    excess = candidates.pick_time - jnp.min(candidates.pick_time, axis=0)
    gain = jnp.where(candidates.serves, worth - excess, 0.0)
    drives = prepared.departures(robot, scene.robot_start, candidates.first_drive)

    def stop(state: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], Stops]:
        at, remaining = state
        useful = jnp.any(candidates.serves & remaining, axis=1)
        cost = jnp.where(useful, drives(at) - gain @ remaining.astype(gain.dtype), jnp.inf)
        best = jnp.argmin(cost)
        served = remaining & candidates.serves[best] & jnp.isfinite(cost[best])
        at = jnp.where(jnp.any(served), best, at)
        return (at, remaining & ~served), Stops(candidates.base_pose[at], served)

    _, stops = jax.lax.scan(stop, (jnp.array(-1), scene.mask), length=len(scene.mask))
    return stops
