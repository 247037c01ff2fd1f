"""The chance constraint of robust planners: pairs of stop and object that are reliable enough, and no others.

A planner that is given these alone needs no change: whatever it chooses is reliable. An object that no stop serves so
reliably keeps those that serve it most reliably, so that it is never left out for its risk.
"""

import dataclasses
from functools import partial

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.compilation import Stored
from basenet_jax.config import PickConfig, WorldConfig
from basenet_jax.geometry import compose
from basenet_jax.planners.candidates import Candidates
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.task.reliability import (
    Chance,
    actual_picks,
    compiled_plan_reliability,
    is_feasible,
    reliable_pairs,
    seen_grasps,
    try_pairs,
)
from basenet_jax.world.scene import Scene

GLANCE = 16  # draws, the largest, that pairs are sorted out by before the few that a plan uses are looked at in full


def likely_pairs(
    robot: Robot, scene: Scene, poses: Array, chosen: Bool[Array, "K M"], chance: Chance, config: PickConfig
) -> Bool[Array, "K M"]:
    """`reliable` by the coarse way: those of the chosen pairs that are, as far as arm solutions and the base go.

    Args:
        robot: the robot.
        scene: unbatched.
        poses: of the stops, (x, y, heading) in W.
        chosen: the pairs to look at.
        chance: the constraint.
        config: of the picks that are planned.
    """
    actual, draws = actual_picks(config, chance.uncertainty), len(chance.errors.base)
    tried = try_pairs(robot, scene, poses, chosen, chance.errors, actual, allowed=chance.allowed, fine=False)
    return reliable_pairs(tried, chosen, chance.allowed, draws)


def likely_times(
    robot: Robot,
    scene: Scene,
    poses: Float[Array, "K 3"],
    pick_time: Float[Array, "K M"],
    first_drive: Float[Array, " K"],
    chance: Chance,
    config: PickConfig,
) -> Float[Array, "K M"]:
    """Estimated pick times (s) without those of pairs that are not reliable, as far as a glance tells.

    Args:
        robot: the robot.
        scene: unbatched.
        poses: of the stops, (x, y, heading) in W.
        pick_time: s; infinite where the stop doesn't serve the object.
        first_drive: s; stops without a way to them serve nothing.
        chance: the constraint.
        config: of the picks that are planned.
    """
    chosen = jnp.isfinite(pick_time) & jnp.isfinite(first_drive)[:, None]
    likely = likely_pairs(robot, scene, poses, chosen, chance.glance(GLANCE), config)
    return jnp.where(likely, pick_time, jnp.inf)


def seem_sure(
    robot: Robot, scene: Scene, base_pose: Float[Array, "M C 3"], chance: Chance, config: PickConfig
) -> Bool[Array, "M C"]:
    """Whether each object of a scene can be picked from C poses of its own reliably enough, as far as a glance tells.

    Args:
        robot: the robot.
        scene: unbatched.
        base_pose: (x, y, heading) in W, for each of its M slots.
        chance: the constraint.
        config: of the picks that are planned.
    """
    slot, errors = jnp.arange(len(base_pose))[:, None, None], chance.glance(GLANCE).errors
    stands = compose(base_pose[..., None, :], errors.base)
    actual = actual_picks(config, chance.uncertainty)
    feasible = is_feasible(robot, stands, seen_grasps(scene, slot, errors.seen), scene.room, actual, fine=False)
    return jnp.sum(~feasible, axis=-1) <= chance.allowed


@partial(Stored, static=("world", "fine"))
def reliable(
    robot: Robot,
    scene: Scene,
    candidates: Candidates,
    chance: Chance,
    *,
    world: WorldConfig = WorldConfig(),
    fine: bool = True,
) -> Candidates:
    """The candidates with those pairs alone that are reliable enough, or the most reliable of their object.

    Args:
        robot: the robot.
        scene: unbatched.
        candidates: checked; those that can't be driven to serve nothing.
        chance: the constraint.
        world: of the picks that were checked.
        fine: whether each draw is a whole pick, or the coarse way will do.
    """
    actual, draws = actual_picks(world.pick, chance.uncertainty), len(chance.errors.base)
    poses, chosen = candidates.base_pose, candidates.serves
    if not chosen.size:
        return candidates
    about = (robot, scene, poses, chosen, chance.errors, actual)
    tried = try_pairs(*about, allowed=chance.allowed, fine=False)
    if fine:
        tried = try_pairs(*about, allowed=chance.allowed, at_least=tried.failed)
    serves = reliable_pairs(tried, chosen, chance.allowed, draws)
    pick_time = jnp.where(serves, candidates.pick_time, jnp.inf)
    clutter = None if candidates.clutter is None else candidates.clutter.only(serves)
    return dataclasses.replace(candidates, serves=serves, pick_time=pick_time, clutter=clutter)


def shortfall(robot: Robot, scene: Scene, plan: Plan, outcome: Outcome, chance: Chance, config: PickConfig) -> float:
    """By how much a plan's picks miss the reliability that is asked for, all together; by whole picks in all draws.

    Args:
        robot: of the plan.
        scene: unbatched.
        plan: of the scene.
        outcome: of executing it.
        chance: the constraint.
        config: of the picks that are planned.
    """
    actual = actual_picks(config, chance.uncertainty)
    sure = compiled_plan_reliability(robot, scene, plan, chance.errors, config=actual)
    missing = np.maximum(float(chance.level) - np.asarray(sure), 0.0)
    return float(np.sum(np.where(outcome.feasible, missing, 0.0)))
