"""Greedy stops: drive where it pays most at once, pick all that can be picked there, repeat. Nothing is learned."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.options import GreedyStopsOptions
from basenet_jax.planners.protocol import PlannerSetup, assemble_plan, no_plan
from basenet_jax.planners.reachability import CandidateSource, unserved_reason
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.task.prepared_world import PreparedWorld
from basenet_jax.task.stop_problem import StopProblem
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
    drives = prepared.departures(robot, scene.robot_start, candidates.first_drive)
    at, serves = greedy_visits(candidates, candidates.pick_time, drives, scene.mask, worth)
    return Stops(candidates.base_pose[at], serves)


class HasTimes(Protocol):
    """What says how fast poses serve objects."""

    def times_among(self, standing: Bool[Array, " M"]) -> Float[Array, "K M"]:
        """Pick times (s) while these objects stand; infinite where the pose can't serve the object yet."""
        ...


def greedy_visits(
    stops: HasTimes,
    pick_time: Float[Array, "K M"],
    drives: Callable[[Array], Array],
    mask: Bool[Array, " M"],
    worth: Float[Array, ""] | float,
) -> tuple[Int[Array, " M"], Bool[Array, "M M"]]:
    """The greedy rule's visits, of which each serves something until nothing more can be had, and what each serves.

    What can be picked at a stop is picked; what only then can be, at the same stop or another, by a later visit.

    Args:
        stops: K of them.
        pick_time: s, with everything else gone.
        drives: from a stop, or from the start (-1), to all stops (s).
        mask: the objects.
        worth: of one object served (s).
    """
    least = jnp.min(pick_time, axis=0)

    def visit(state: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        at, remaining = state
        time = stops.times_among(remaining)
        serves = jnp.isfinite(time) & remaining
        gain = jnp.sum(jnp.where(serves, worth - (time - least), 0.0), axis=1)
        cost = jnp.where(jnp.any(serves, axis=1), drives(at) - gain, jnp.inf)
        best = jnp.argmin(cost)
        served = serves[best] & jnp.isfinite(cost[best])
        at = jnp.where(jnp.any(served), best, at)
        return (at, remaining & ~served), (at, served)

    _, visits = jax.lax.scan(visit, (jnp.array(-1), mask), length=len(mask))
    return visits


def greedy_route(problem: StopProblem, worth: Float[Array, ""] | float) -> Int[Array, " M"]:
    """The stops of the greedy rule in order, then -1.

    Args:
        problem: unbatched.
        worth: of one object served (s).
    """

    def drives(stop: Array) -> Array:
        return jnp.where(stop < 0, problem.first_drive, problem.drive[stop])

    at, serves = greedy_visits(problem, problem.pick_time, drives, problem.mask, worth)
    arrives = jnp.any(serves, axis=1) & (at != jnp.roll(at, 1).at[0].set(-1))
    return jnp.where(arrives, at, -1)[jnp.argsort(~arrives, stable=True)]
