"""Plans on estimated pick times, checked where it counts.

An estimate leaves out clearance, costs a small part of a whole check, and is right for nearly all pairs of aligned stop
and object, of which a plan uses very few. So plans are made on estimates, the picks that they use are checked in
full, wrong estimates are corrected and their scenes planned again until every plan holds. (Costs evaluated lazily, as
LazySP does for shortest paths: Dellin and Srinivasa, ICAPS 2016.)
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax import rounds
from basenet_jax.config import PickConfig, WorldConfig
from basenet_jax.policies.stop_policy import StopScene, make_scene
from basenet_jax.policies.stop_rollout import StopPlan
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import pick
from basenet_jax.task.prepared_world import PreparedWorld
from basenet_jax.task.reliability import Chance, actual_picks, reliability
from basenet_jax.task.stop_problem import make_problem
from basenet_jax.world.boxes import Room
from basenet_jax.world.scene import Scene

TOLERANCE_S = 0.02  # refinement changes less


class Settled(NamedTuple):
    """Plans of B scenes, and the times that they were made on."""

    pick_time: Float[Array, "B K M"]  # s; exact where a plan was made that uses it, else as estimated
    plan: StopPlan
    holds: Bool[Array, " B"]


def settle(
    robot: Robot,
    room: Room,
    prepared: PreparedWorld,
    scenes: Scene,
    first_drive: Float[Array, "B K"],
    pick_time: Float[Array, "B K M"],
    choose: Callable[[StopScene], StopPlan],
    world: WorldConfig,
    chance: Chance | None = None,
    *,
    at_once: int,
) -> Settled:
    """Plans whose picks are feasible, reliable enough, and take what they were thought to.

    Args:
        robot: the robot.
        room: of all scenes.
        prepared: the stops.
        scenes: a batch.
        first_drive: s, from where the robot starts.
        pick_time: s, estimates, or exact.
        choose: plans for a batch of `at_once` scenes on the graph.
        world: of drives and picks.
        chance: how sure picks are to be; None: where the base parks without error.
        at_once: scenes planned and checked in one round, of those whose plan doesn't hold yet.
    """
    count = len(scenes.mask)
    at_once = min(at_once, count)

    def improve(index: Array, state: Settled) -> Settled:
        some, first = rounds.take((scenes, first_drive), index, axis=0)
        own = stop_scene(prepared, some, first, state.pick_time)
        plan = choose(own)
        checked, holds = _check(robot, room, prepared, some, own, plan, world, chance)
        return Settled(checked, plan, holds)

    slots = jnp.full(scenes.mask.shape, -1, jnp.int32)
    nothing = StopPlan(slots, slots, jnp.zeros(count, pick_time.dtype), jnp.zeros_like(slots))
    start = Settled(pick_time, nothing, jnp.zeros(count, bool))
    return rounds.until_settled(lambda state: ~state.holds, improve, start, at_once, axis=0)


def stop_scene(
    prepared: PreparedWorld,
    scene: Scene,
    first_drive: Float[Array, "*batch K"],
    pick_time: Float[Array, "*batch K M"],
) -> StopScene:
    """A scene, or a batch, on the prepared stops, by these times (s)."""
    problem = make_problem(prepared.poses, prepared.drive, pick_time, first_drive, scene.mask)
    return make_scene(problem, scene.robot_start, scene.first_grasp)


def _check(
    robot: Robot,
    room: Room,
    prepared: PreparedWorld,
    scenes: Scene,
    own: StopScene,
    plan: StopPlan,
    world: WorldConfig,
    chance: Chance | None,
) -> tuple[Float[Array, "B K M"], Bool[Array, " B"]]:
    """The pick times with those that the plans use made exact, and whether all of these were right."""
    used = plan.picked_at >= 0
    stop = jnp.take_along_axis(plan.stops, jnp.maximum(plan.picked_at, 0), axis=-1)
    scene, slot = jnp.indices(stop.shape)
    thought = own.problem.pick_time[scene, stop, slot]
    picks = pick(robot, prepared.poses[stop], scenes.grasps, room, world.pick)
    possible = picks.feasible
    if chance is not None:
        possible &= chance.holds(_reliabilities(robot, scenes, prepared.poses[stop], chance, world.pick))
    exact = jnp.where(possible, picks.time, jnp.inf)
    right = ~used | (jnp.abs(exact - thought) <= TOLERANCE_S)
    corrected = own.problem.pick_time.at[scene, stop, slot].set(jnp.where(used, exact, thought))
    return corrected, jnp.all(right, axis=-1)


def _reliabilities(
    robot: Robot, scenes: Scene, base_pose: Float[Array, "B M 3"], chance: Chance, config: PickConfig
) -> Float[Array, "B M"]:
    """Those of each scene's objects, each from a pose of its own."""
    actual, slots = actual_picks(config, chance.uncertainty), jnp.arange(base_pose.shape[1])

    def of_one(own: tuple[Scene, Array]) -> Array:
        return reliability(robot, *own, slots, chance.errors, actual)

    return jax.lax.map(of_one, (scenes, base_pose))
