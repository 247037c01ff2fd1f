"""Plans by the paper's scheme (choose an object, then a base pose for it alone), with one part replaced.

What `benchmarks.paper_planner` compares.
"""

from collections.abc import Callable
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from basenet_jax.config import GridConfig, WorldConfig
from basenet_jax.learning.config import BasePoseRewardConfig
from basenet_jax.planners.candidates import Candidates, check_candidates, grid_poses
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.pickup import Choose, PickupState, choose_learned
from basenet_jax.policies.trained import Weights, load_policies
from basenet_jax.robot.model import Robot
from basenet_jax.task.navigation import navigation_time
from basenet_jax.task.picking import pick
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.world.scene import Scene

Order = Literal["learned", "greatest reward"]

# A scene to N (s), G (s) and the share grasped of its plan.
Evaluate = Callable[[Scene], tuple[float, float, float]]


def make_schemes(setup: PlannerSetup, grid: GridConfig) -> dict[str, Evaluate]:
    """What is compared, by name; exact planning comes first."""
    robot, world, weights = setup.robot, setup.world, load_policies()
    poses = jnp.asarray(grid_poses(robot, setup.room, grid, world.pick))

    def judged(scene: Scene, plan: Plan) -> tuple[float, float, float]:
        outcome = jax.device_get(compiled_execute(robot, scene, plan, config=world))
        return float(outcome.navigation), float(outcome.picking), float(outcome.grasped / np.sum(scene.mask))

    def by_name(name: str) -> Evaluate:
        planner = make_planner(name, setup)
        return lambda scene: judged(scene, planner(scene, jax.random.key(0)))

    def by_reward(order: Order) -> Evaluate:
        def plan(scene: Scene) -> Plan:
            candidates = check_candidates(robot, scene, poses, world=world)
            return _plan_by_reward(robot, weights, scene, candidates, world, order)

        return lambda scene: judged(scene, plan(scene))

    return {
        "dp": by_name("dp"),
        "basenet-paper": by_name("basenet-paper"),
        "basenet-paper, staying where it can": lambda scene: judged(scene, _plan_staying(robot, weights, scene, world)),
        "base poses of greatest reward, learned order": by_reward("learned"),
        "base pose and object of greatest reward": by_reward("greatest reward"),
    }


@jax.jit(static_argnames=("world", "order"))
def _plan_by_reward(
    robot: Robot, weights: Weights, scene: Scene, candidates: Candidates, world: WorldConfig, order: Order
) -> Plan:
    """Parks step by step at the candidate of greatest reward for one object: the base-pose policy's ideal."""
    reward, learned = BasePoseRewardConfig(), _learned_order(weights, scene)
    grasping = jnp.where(candidates.serves, reward.grasping / (1.0 + candidates.pick_time), -jnp.inf)

    def choose(pose: Array, remaining: Array) -> tuple[Array, Array]:
        drive = navigation_time(robot, pose, candidates.base_pose, scene.room, world.navigation)
        worth = jnp.where(remaining, grasping + (reward.navigation / (1.0 + drive))[:, None], -jnp.inf)
        slot = learned(pose, remaining) if order == "learned" else jnp.argmax(jnp.max(worth, axis=0))
        return slot, candidates.base_pose[jnp.argmax(worth[:, slot])]

    return _roll_out(scene, choose)


@jax.jit(static_argnames="world")
def _plan_staying(robot: Robot, weights: Weights, scene: Scene, world: WorldConfig) -> Plan:
    """The learned policies', but what can be picked from where the robot stands is picked first, without a drive."""
    learned = _learned_order(weights, scene)

    def choose(pose: Array, remaining: Array) -> tuple[Array, Array]:
        picks = pick(robot, pose, scene.grasps, scene.room, world.pick)
        here = picks.feasible & remaining
        fastest = jnp.argmin(jnp.where(here, picks.time, jnp.inf))
        slot = jnp.where(jnp.any(here), fastest, learned(pose, remaining))
        return slot, jnp.where(here[slot], pose, weights.base_pose(scene.first_grasp[slot], pose))

    return _roll_out(scene, choose)


def _learned_order(weights: Weights, scene: Scene) -> Callable[[Array, Array], Array]:
    """(robot pose, which objects remain) -> the slot that the sequence policy chooses."""
    choose: Choose = choose_learned(GraspSequencePolicy(), weights.sequence, jax.tree.map(lambda x: x[None], scene))

    def slot(pose: Array, remaining: Array) -> Array:
        return choose(PickupState(pose[None], remaining[None], jnp.zeros(1, bool)), jax.random.key(0), len(remaining))[
            0
        ]

    return slot


def _roll_out(scene: Scene, choose: Callable[[Array, Array], tuple[Array, Array]]) -> Plan:
    """The plan of a rule (robot pose, which objects remain) -> slot of the next object, base pose for it."""

    def step(state: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], tuple[Array, Array, Array]]:
        pose, remaining = state
        slot, goal = choose(pose, remaining)
        after = remaining & (jnp.arange(len(remaining)) != slot)
        return (goal, after), (jnp.where(jnp.any(remaining), slot, -1), goal, jnp.any(remaining))

    _, (slots, poses, active) = jax.lax.scan(step, (scene.robot_start, scene.mask), length=len(scene.mask))
    return Plan(object_index=slots, base_pose=poses, served=active, reason=jnp.zeros_like(slots))
