"""What the learned order of grasps is worth: beside the nearest object first and random order, same base poses."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from basenet_jax.config import WorldConfig
from basenet_jax.planners.protocol import Planner
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.pickup import Choose, as_plan, choose_learned, choose_nearest, choose_random, rollout
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Outcome, execute
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.scene import Scene, Table

EVALUATION_SEED = 2_000_003


class OrderResult(NamedTuple):
    """Per scene: share of objects grasped, navigation time N, grasping time G and N + G (s)."""

    grasped: np.ndarray
    navigation: np.ndarray
    grasping: np.ndarray
    execution: np.ndarray


def compare_orders(
    robot: Robot,
    base_pose: BasePosePolicy,
    network: GraspSequencePolicy,
    params: dict,
    *,
    objects: int,
    scenes: int,
    world: WorldConfig = WorldConfig(),
    seed: int = EVALUATION_SEED,
) -> dict[str, OrderResult]:
    """Executes the plans of three orders with the base poses of one policy, on the same random scenes.

    Args:
        robot: the robot.
        base_pose: where to park for each grasp.
        network: of the sequence policy, and
        params: its parameters.
        objects: in each scene.
        scenes: their number.
        world: table, navigation, pick cycle.
        seed: of the scenes and of the random order.

    Returns:
        Results of "learned", "nearest" and "random".
    """
    scene_key, play_key = jax.random.split(jax.random.key(seed))
    batch = random_scenes(scene_key, objects, scenes, world)

    orders: dict[str, Choose] = {
        "learned": choose_learned(network, params, batch),
        "nearest": choose_nearest(batch),
        "random": choose_random,
    }
    results = {}
    for name, choose in orders.items():
        play: Callable[[], Outcome] = jax.jit(
            lambda choose=choose: execute(
                robot, batch, as_plan(rollout(robot, batch, base_pose, choose, play_key, world)), world
            )
        )
        results[name] = _result(play(), objects)
    return results


def judge_planner(
    planner: Planner,
    robot: Robot,
    *,
    objects: int,
    scenes: int,
    world: WorldConfig = WorldConfig(),
    seed: int = EVALUATION_SEED,
) -> OrderResult:
    """Executes a planner's plans for the scenes of `compare_orders`.

    Args:
        planner: plans scene after scene.
        robot: the robot.
        objects: in each scene.
        scenes: their number.
        world: table, navigation, pick cycle.
        seed: of the scenes and of the planner.
    """
    scene_key, plan_key = jax.random.split(jax.random.key(seed))
    batch = random_scenes(scene_key, objects, scenes, world)
    plans = [planner(jax.tree.map(lambda x, i=i: x[i], batch), plan_key) for i in range(scenes)]
    plan = jax.tree.map(lambda *leaves: jnp.stack(leaves), *plans)
    return _result(jax.jit(execute, static_argnames="config")(robot, batch, plan, world), objects)


def random_scenes(key: Array, objects: int, count: int, world: WorldConfig = WorldConfig()) -> Scene:
    """A batch of random scenes with the same number of objects.

    Raises:
        ValueError: so many objects don't fit on the table.
    """
    table = Table.from_config(world.table)
    draw = jax.jit(
        jax.vmap(lambda key: draw_scene(key, objects, table, slots=objects, config=world.scene)),
    )
    scenes, placed = draw(jax.random.split(key, count))
    if not bool(jnp.all(placed)):
        raise ValueError(f"objects: found {objects}, which don't fit on the table; allowed are fewer")
    return scenes


def _result(outcome: Outcome, objects: int) -> OrderResult:
    figures = (outcome.grasped / objects, outcome.navigation, outcome.picking, outcome.execution)
    return OrderResult(*(np.asarray(figure, float) for figure in figures))
