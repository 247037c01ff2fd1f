"""The pickup episode: choose an object, park where the base-pose policy says, go on from there."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.config import WorldConfig
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy, compact_sizes, remaining_logits
from basenet_jax.robot.model import Robot
from basenet_jax.task.navigation import navigation_time
from basenet_jax.task.plan import Plan
from basenet_jax.world.clearance import base_collides
from basenet_jax.world.scene import Scene


@struct.dataclass
class PickupState:
    """Where an episode stands; batches along leading axes."""

    robot_pose: Float[Array, "*batch 3"]
    remaining: Bool[Array, "*batch M"]
    ended: Bool[Array, "*batch"]  # by a base pose that collides or can't be reached; nothing is executed any more


@struct.dataclass
class PickupStep:
    """One step: the state before it, what was chosen, and what came of it."""

    state: PickupState
    choice: Int[Array, "*batch"]  # slot of the object; any slot when no object remains
    base_pose: Float[Array, "*batch 3"]
    navigation_time: Float[Array, "*batch"]  # s; 0 for a drive that isn't executed
    active: Bool[Array, "*batch"]  # whether an object remained to choose
    executed: Bool[Array, "*batch"]  # whether the drive was


# (state, key of the step, at most so many objects remain) -> slot of the object to grasp next
Choose = Callable[[PickupState, Array, int], Array]


def rollout(
    robot: Robot,
    scene: Scene,
    base_pose: BasePosePolicy,
    choose: Choose,
    key: Array,
    world: WorldConfig,
    *,
    sizes: Sequence[int] | None = None,
) -> PickupStep:
    """Plays whole episodes of a batch of scenes; the result has a leading axis of M steps.

    The state is refreshed after every step: the next base pose is conditioned on where the robot then stands. An
    object whose pick fails stays on the table and isn't tried again, as in a plan.

    Args:
        robot: the robot.
        scene: a batch of scenes (B, M objects).
        base_pose: the frozen base-pose policy.
        choose: picks the next object.
        key: consumed; one part for each step.
        world: table, navigation, pick cycle.
        sizes: numbers of objects, falling from M, that choices are made for; each is a program of its own. By default
            those of `compact_sizes`, on which the network is faster.
    """
    grasps = scene.first_grasp
    slots = grasps.shape[-2]

    sizes = tuple(sizes or compact_sizes(slots))

    def choosing(most: int) -> Callable[[PickupState, Array], Array]:
        return lambda state, key: choose(state, key, most)

    def step(state: PickupState, own: tuple[Array, Array]) -> tuple[PickupState, PickupStep]:
        key, size = own
        choice = jax.lax.switch(size, [choosing(most) for most in sizes], state, key)
        grasp = jnp.take_along_axis(grasps, choice[..., None, None], axis=-2)[..., 0, :]
        goal = base_pose(grasp, state.robot_pose)
        drive = navigation_time(robot, state.robot_pose, goal, scene.room, world.navigation)
        collides = base_collides(robot, goal, scene.room, world.pick.base_clearance_m, world.pick.touching_m)
        active = jnp.any(state.remaining, axis=-1)
        ended = state.ended | (active & (collides | ~jnp.isfinite(drive)))
        executed = active & ~ended
        after = PickupState(
            robot_pose=jnp.where(executed[..., None], goal, state.robot_pose),
            remaining=state.remaining & (jnp.arange(slots) != choice[..., None]),
            ended=ended,
        )
        return after, PickupStep(state, choice, goal, jnp.where(executed, drive, 0.0), active, executed)

    start = PickupState(scene.robot_start, scene.mask, jnp.zeros(scene.mask.shape[:-1], bool))
    left = slots - np.arange(slots)  # at most so many objects remain
    size = np.sum(left[:, None] <= np.array(sizes), axis=1) - 1  # the smallest that holds them
    return jax.lax.scan(step, start, (jax.random.split(key, slots), size))[1]


def episode_cost(steps: PickupStep, failure_time: float) -> Float[Array, "*batch"]:
    """Navigation time of episodes (s), plus `failure_time` for every object not driven to.

    Without the second term ending an episode early would be the cheapest thing to do.
    """
    return jnp.sum(steps.navigation_time + failure_time * (steps.active & ~steps.executed), axis=0)


def as_plan(steps: PickupStep) -> Plan:
    """The plans that episodes amount to."""
    choice, active = (jnp.moveaxis(x, 0, -1) for x in (steps.choice, steps.active))
    return Plan(
        object_index=jnp.where(active, choice, -1),
        base_pose=jnp.moveaxis(steps.base_pose, 0, -2),
        served=active,
        reason=jnp.zeros_like(choice),
    )


def choose_learned(network: GraspSequencePolicy, params: Any, scene: Scene, *, greedy: bool | Array = True) -> Choose:
    """What the sequence policy chooses: the most probable object, or one drawn by its probabilities."""

    def choose(state: PickupState, key: Array, most: int) -> Array:
        logits = remaining_logits(network, params, scene.first_grasp, state.robot_pose, state.remaining, most=most)
        # Where nothing remains all logits are minus infinity, and any choice will do.
        logits = jnp.where(jnp.any(state.remaining, axis=-1, keepdims=True), logits, 0.0)
        noise = 0.0 if greedy is True else jnp.where(greedy, 0.0, jax.random.gumbel(key, logits.shape, logits.dtype))
        return jnp.argmax(logits + noise, axis=-1)

    return choose


def choose_nearest(scene: Scene) -> Choose:
    """The remaining object whose grasp is nearest to the robot."""

    def choose(state: PickupState, key: Array, most: int) -> Array:
        del key, most
        distance = jnp.linalg.norm(scene.first_grasp[..., :2] - state.robot_pose[..., None, :2], axis=-1)
        return jnp.argmin(jnp.where(state.remaining, distance, jnp.inf), axis=-1)

    return choose


def choose_random(state: PickupState, key: Array, most: int) -> Array:
    """Any of the remaining objects."""
    del most
    return jax.random.categorical(key, jnp.where(state.remaining, 0.0, -jnp.inf), axis=-1)
