"""PBG, the paper's proximity-based greedy planner: the nearest object next, from the nearest base pose."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.protocol import PlannerSetup, assemble_plan
from basenet_jax.planners.reachability import CandidateSource, nearest_grasp, unserved_reason
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Plan
from basenet_jax.task.prepared_world import PreparedWorld
from basenet_jax.world.scene import Scene


class Pbg:
    """Picks the object nearest to the base next, from the candidate of least navigation time.

    Checked, it is the paper's PBG-GC, whose candidates passed the full check; else PBG, which trusts the map.
    """

    def __init__(self, setup: PlannerSetup, *, checked: bool):
        self._robot = setup.robot
        self._candidates = CandidateSource(setup, checked=checked)

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored."""
        del key
        candidates, stops = self._candidates(scene)
        if not len(candidates.base_pose):
            return assemble_plan(scene, np.zeros(0, int), np.zeros((0, 3)), np.asarray(candidates.reason))
        steps, reason = jax.device_get(nearest_first(self._robot, scene, candidates, stops))
        return assemble_plan(scene, steps.slot[steps.found], steps.base_pose[steps.found], reason)


class Steps(NamedTuple):
    """One step for each of a scene's M slots."""

    slot: Int[Array, " M"]  # of the object
    base_pose: Float[Array, "M 3"]  # where the base is after the step, (x, y, heading) in W
    found: Bool[Array, " M"]  # whether there was an object, and a pose to pick it from


@jax.jit
def nearest_first(
    robot: Robot, scene: Scene, candidates: Candidates, stops: PreparedWorld
) -> tuple[Steps, Int[Array, " M"]]:
    """The greedy rule, step by step, among the objects that a candidate which can be driven to serves now.

    Args:
        robot: the robot.
        scene: unbatched.
        candidates: at least one.
        stops: the candidates' poses.

    Returns:
        The steps, and for each slot the reason it has if no step found it.
    """
    slots = jnp.arange(len(scene.mask))
    drives = stops.departures(robot, scene.robot_start, candidates.first_drive)

    def step(state: tuple[Array, Array, Array], _: None) -> tuple[tuple[Array, Array, Array], Steps]:
        at, pose, remaining = state
        drive = drives(at)[:, None]
        drive = jnp.where(jnp.isfinite(candidates.times_among(remaining)) & remaining, drive, jnp.inf)
        can_be_had = jnp.any(jnp.isfinite(drive), axis=0)
        slot = jnp.argmin(jnp.where(can_be_had, nearest_grasp(scene.grasps, pose), jnp.inf))
        best, found = jnp.argmin(drive[:, slot]), can_be_had[slot]
        pose = jnp.where(found, candidates.base_pose[best], pose)
        return (jnp.where(found, best, at), pose, remaining & ~(found & (slots == slot))), Steps(slot, pose, found)

    _, steps = jax.lax.scan(step, (jnp.array(-1), scene.robot_start, scene.mask), length=len(scene.mask))
    return steps, unserved_reason(candidates)
