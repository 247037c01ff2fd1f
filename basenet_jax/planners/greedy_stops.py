"""Greedy stops: drive where it pays most at once, pick all that can be picked there, repeat. Nothing is learned."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.options import GreedyStopsOptions
from basenet_jax.planners.protocol import PlannerSetup, assemble_plan
from basenet_jax.planners.reachability import CandidateSource, unserved_reason
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import Drives
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene


class GreedyStops:
    """On validated candidates: next the stop of least navigation + excess pick time - worth of the objects served."""

    def __init__(self, setup: PlannerSetup, options: GreedyStopsOptions = GreedyStopsOptions()):
        self._robot, self._drives = setup.robot, setup.drives
        self._candidates = CandidateSource(setup, checked=True)
        self._worth = options.seconds_per_object

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored."""
        del key
        candidates = self._candidates(scene)
        reason = np.asarray(unserved_reason(candidates))
        if not len(candidates.base_pose):
            return assemble_plan(scene, np.zeros(0, int), np.zeros((0, 3), np.float32), reason)
        stops = greedy_stops(self._robot, scene, candidates, self._worth, self._drives)
        pose, serves = jax.device_get((stops.base_pose, stops.serves))
        stop, slot = np.nonzero(serves)
        return assemble_plan(scene, slot, pose[stop], reason)


class Stops(NamedTuple):
    """Stops in order, padded to M."""

    base_pose: Float[Array, "M 3"]
    serves: Bool[Array, "M M"]  # [stop, slot]: what is picked there; nothing at padding


@jax.jit
def greedy_stops(
    robot: Robot, scene: Scene, candidates: Candidates, worth: Float[Array, ""] | float, drives: Drives
) -> Stops:
    """The greedy rule.

    Args:
        robot: the robot.
        scene: unbatched.
        candidates: at least one, with validated pick times.
        worth: of one object served (s).
        drives: of the room.
    """
    excess = candidates.pick_time - jnp.min(candidates.pick_time, axis=0)
    gain = jnp.where(candidates.serves, worth - excess, 0.0)
    ends = drives.ends(robot, candidates.base_pose)

    def stop(state: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], Stops]:
        pose, remaining = state
        drive = drives.times(robot, drives.ends(robot, pose[None]), ends)[0]
        useful = jnp.any(candidates.serves & remaining, axis=1)
        cost = jnp.where(useful, drive - gain @ remaining.astype(gain.dtype), jnp.inf)
        best = jnp.argmin(cost)
        served = remaining & candidates.serves[best] & jnp.isfinite(cost[best])
        pose = jnp.where(jnp.any(served), candidates.base_pose[best], pose)
        return (pose, remaining & ~served), Stops(pose, served)

    _, stops = jax.lax.scan(stop, (scene.robot_start, scene.mask), length=len(scene.mask))
    return stops
