"""What the learned order of grasps is worth: beside the nearest object first and random order, same base poses."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from basenet_jax.config import SceneConfig, WorldConfig
from basenet_jax.planners.protocol import Planner
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.pickup import PickupState, as_plan, choose_learned, choose_nearest, choose_random, rollout
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.scene import Scene

EVALUATION_SEED = 2_000_003
ORDERS = ("learned", "nearest", "random")


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
    slots: int | None = None,
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
        slots: of the scenes; with the same ones for several numbers of objects all is compiled once.
        world: table, navigation, pick cycle.
        seed: of the scenes and of the random order.

    Returns:
        Results of "learned", "nearest" and "random".
    """
    scene_key, play_key = jax.random.split(jax.random.key(seed))
    batch = random_scenes(scene_key, objects, scenes, world, slots=slots)
    return {
        order: judge(robot, batch, _play(robot, batch, base_pose, network, params, play_key, index, world), world)
        for index, order in enumerate(ORDERS)
    }


def judge_planner(
    planner: Planner,
    robot: Robot,
    *,
    objects: int,
    scenes: int,
    slots: int | None = None,
    world: WorldConfig = WorldConfig(),
    seed: int = EVALUATION_SEED,
) -> OrderResult:
    """Executes a planner's plans for the scenes of `compare_orders`.

    Args:
        planner: plans scene after scene.
        robot: the robot.
        objects: in each scene.
        scenes: their number.
        slots: of the scenes, see `compare_orders`.
        world: table, navigation, pick cycle.
        seed: of the scenes and of the planner.
    """
    scene_key, plan_key = jax.random.split(jax.random.key(seed))
    batch = random_scenes(scene_key, objects, scenes, world, slots=slots)
    plans = [planner(jax.tree.map(lambda x, i=i: x[i], batch), plan_key) for i in range(scenes)]
    return judge(robot, batch, jax.tree.map(lambda *leaves: jnp.stack(leaves), *plans), world)


def judge(robot: Robot, scenes: Scene, plans: Plan, world: WorldConfig = WorldConfig()) -> OrderResult:
    """What a batch of plans comes to."""
    outcome = jax.device_get(compiled_execute(robot, scenes, plans, config=world))
    figures = (
        outcome.grasped / np.sum(scenes.mask, axis=-1),
        outcome.navigation,
        outcome.picking,
        outcome.execution,
    )
    return OrderResult(*(np.asarray(figure, float) for figure in figures))


def random_scenes(
    key: Array, objects: int, count: int, world: WorldConfig = WorldConfig(), *, slots: int | None = None
) -> Scene:
    """A batch of random scenes with the same number of objects, and as many slots unless given.

    Raises:
        ValueError: so many objects don't fit on the table.
    """
    room = Room.from_config(world.table)
    scenes, placed = _draw_scenes(jax.random.split(key, count), objects, room, slots or objects, world.scene)
    if not bool(jnp.all(placed)):
        raise ValueError(f"objects: found {objects}, which don't fit on the table; allowed are fewer")
    return scenes


@jax.jit(static_argnames=("slots", "config"))
def _draw_scenes(keys: Array, objects: int, room: Room, slots: int, config: SceneConfig) -> tuple[Scene, Array]:
    return jax.vmap(lambda key: draw_scene(key, objects, room, slots=slots, config=config))(keys)


@jax.jit(static_argnames=("network", "world"))
def _play(
    robot: Robot,
    scenes: Scene,
    base_pose: BasePosePolicy,
    network: GraspSequencePolicy,
    params: dict,
    key: Array,
    order: Array | int,
    world: WorldConfig,
) -> Plan:
    """The plans of one of `ORDERS`, by its index: one program for all, since the picks in it take long to compile."""
    choices = (choose_learned(network, params, scenes), choose_nearest(scenes), choose_random)

    def choose(state: PickupState, key: Array, most: int) -> Array:
        return jax.lax.switch(order, [lambda *now, rule=rule: rule(*now, most) for rule in choices], state, key)

    return as_plan(rollout(robot, scenes, base_pose, choose, key, world))
