"""REINFORCE with a greedy-rollout baseline for the grasp-sequence policy.

As in Kool, van Hoof and Welling (arXiv 1803.08475): the baseline is the cost of the greedy rollout of a frozen copy
of the policy on the same scene; the copy is replaced when a one-sided paired t-test on scenes set apart says that the
policy has become better, and then a fresh set of scenes is drawn.
"""

import dataclasses
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax import Array
from jaxtyping import Float

from basenet_jax import struct
from basenet_jax.config import WorldConfig
from basenet_jax.devices import ONE_DEVICE, Devices
from basenet_jax.learning.config import ReinforceConfig
from basenet_jax.learning.policy_gradient import policy_gradient
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.pickup import PickupStep, choose_learned, choose_nearest, episode_cost, rollout
from basenet_jax.robot.model import Robot
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.scene import Scene

Metrics = dict[str, Array]


@struct.dataclass
class ReinforceState:
    """Everything that training needs to go on."""

    params: Any
    baseline: Any  # the frozen copy's parameters
    optimizer: Any
    test_key: Array  # of the scenes of the baseline's t-test
    key: Array
    update: Array
    swaps: Array


def sequence_network(config: ReinforceConfig) -> GraspSequencePolicy:
    """The network of a configuration."""
    return GraspSequencePolicy(features=config.features, layers=config.layers, attention=config.attention)


class Reinforce:
    """The learner: `init` makes a state, `interval` trains on and evaluates."""

    def __init__(
        self,
        robot: Robot,
        base_pose: BasePosePolicy,
        config: ReinforceConfig,
        world: WorldConfig,
        devices: Devices = ONE_DEVICE,
    ):
        """Builds the network and its optimiser, for a frozen base-pose policy.

        Raises:
            ValueError: the batches can't be shared out to the devices.
        """
        self.robot, self.base_pose, self.config, self.world = robot, base_pose, config, world
        self.devices = devices
        devices.check(config.batches)
        self.room = Room.from_config(world.table)
        self.network = sequence_network(config)
        updates = config.updates_per_interval * config.intervals
        schedule = optax.cosine_decay_schedule(config.learning_rate, updates, config.final_learning_rate_share)
        self.optimizer = optax.adam(schedule)

    def init(self, key: Array) -> ReinforceState:
        """The first state; the baseline is a copy of the fresh network.

        Args:
            key: consumed.
        """
        network_key, test_key, key = jax.random.split(key, 3)
        slots = self.config.objects
        params = self.network.init(network_key, jnp.zeros((slots, 4)), jnp.zeros(3), jnp.ones(slots, bool))
        state = ReinforceState(
            params=params,
            baseline=jax.tree.map(jnp.copy, params),
            optimizer=self.optimizer.init(params),
            test_key=test_key,
            key=key,
            update=jnp.zeros((), jnp.int32),
            swaps=jnp.zeros((), jnp.int32),
        )
        return self.devices.everywhere(state)

    def interval(self, state: ReinforceState) -> tuple[ReinforceState, Metrics]:
        """Some updates, the baseline's t-test, and the greedy policy's evaluation.

        Args:
            state: may be donated.
        """
        state, training = jax.lax.scan(self._update, state, length=self.config.updates_per_interval)
        state = self._challenge_baseline(state)
        metrics = {name: jnp.mean(values) for name, values in training.items()}
        metrics |= self.evaluate(state.params) | {"baseline_swaps": state.swaps}
        return self.devices.everywhere((state, metrics))

    def evaluate(self, params: Any) -> Metrics:
        """Navigation time (s) of greedy rollouts on fixed scenes with all objects, beside nearest-object-first's."""
        scene_key, play_key = jax.random.split(jax.random.key(self.config.evaluation_seed))
        scenes = self.draw(scene_key, self.config.evaluation_scenes, vary_count=False, own_class_share=0.0)
        greedy = self.play(params, scenes, play_key, greedy=True)
        nearest = rollout(
            self.robot,
            scenes,
            self.base_pose,
            choose_nearest(scenes),
            play_key,
            self.world,
            sizes=(self.config.objects,),
        )
        return {
            "navigation_time": jnp.mean(jnp.sum(greedy.navigation_time, axis=0)),
            "nearest_navigation_time": jnp.mean(jnp.sum(nearest.navigation_time, axis=0)),
            "driven_to": jnp.sum(greedy.executed) / jnp.sum(greedy.active),
        }

    def draw(self, key: Array, count: int, *, vary_count: bool, own_class_share: float) -> Scene:
        """A batch of random scenes, with 1 to `objects` objects each or with all of them."""
        count_key, scene_key = jax.random.split(key)
        slots = self.config.objects
        numbers = jax.random.randint(count_key, (count,), 1, slots + 1) if vary_count else jnp.full(count, slots)

        def draw_one(key: Array, number: Array) -> Scene:
            scene, _ = draw_scene(
                key, number, self.room, slots=slots, own_class_share=own_class_share, config=self.world.scene
            )
            return scene

        return self.devices.apart(jax.vmap(draw_one), in_axes=(0, 0))(jax.random.split(scene_key, count), numbers)

    def play(self, params: Any, scenes: Scene, key: Array, *, greedy: bool | Array) -> PickupStep:
        """Rolls the policy out, sampling objects or taking the most probable ones."""
        choose = choose_learned(self.network, params, scenes, greedy=greedy)
        return rollout(self.robot, scenes, self.base_pose, choose, key, self.world)

    def _play_both(
        self, state: ReinforceState, scenes: Scene, keys: Array, *, greedy: Array
    ) -> tuple[PickupStep, PickupStep]:
        """Episodes of the policy, then of its baseline, by one program."""
        params = jax.tree.map(lambda *x: jnp.stack(x), state.params, state.baseline)

        def play(own: tuple[Any, Array, Array]) -> PickupStep:
            return self.play(own[0], scenes, own[1], greedy=own[2])

        steps = jax.lax.map(play, (params, keys, greedy))
        return jax.tree.map(lambda x: x[0], steps), jax.tree.map(lambda x: x[1], steps)

    def _update(self, state: ReinforceState, _: None) -> tuple[ReinforceState, Metrics]:
        scene_key, play_key, baseline_key, key = jax.random.split(state.key, 4)
        scenes = self.draw(
            scene_key, self.config.episodes_per_update, vary_count=True, own_class_share=self.config.own_class_share
        )
        if self.config.baseline:
            keys = jnp.stack([play_key, baseline_key])
            steps, baseline = self._play_both(state, scenes, keys, greedy=jnp.array([False, True]))
            cost = self.cost(steps)
            advantage = cost - self.cost(baseline)
        else:
            steps = self.play(state.params, scenes, play_key, greedy=False)
            cost = advantage = self.cost(steps)
        weight = self.config.navigation_weight * advantage
        gradient, entropy = self.gradient(state.params, scenes.first_grasp, steps, weight)
        change, optimizer = self.optimizer.update(gradient, state.optimizer, state.params)
        metrics = {"cost": jnp.mean(cost), "advantage": jnp.mean(advantage), "entropy": entropy}
        state = dataclasses.replace(
            state,
            params=optax.apply_updates(state.params, change),
            optimizer=optimizer,
            key=key,
            update=state.update + 1,
        )
        return state, metrics | {"gradient_norm": optax.tree.norm(gradient)}

    def gradient(
        self, params: Any, grasps: Float[Array, "B M 4"], steps: PickupStep, weight: Float[Array, " B"]
    ) -> tuple[Any, Float[Array, ""]]:
        """See `policy_gradient`."""
        own = self.devices.apart(partial(policy_gradient, self.network), in_axes=(None, 0, 1, 0), mean=True)
        return own(params, grasps, steps, weight)

    def cost(self, steps: PickupStep) -> Array:
        """Cost (s) of each episode."""
        return episode_cost(steps, self.config.failure_time_s)

    def _challenge_baseline(self, state: ReinforceState) -> ReinforceState:
        """Replaces the baseline if the policy is significantly better on the test scenes, which are then renewed."""
        scene_key, play_key, next_key = jax.random.split(state.test_key, 3)
        scenes = self.draw(
            scene_key, self.config.test_episodes, vary_count=True, own_class_share=self.config.own_class_share
        )
        keys = jnp.stack([play_key, play_key])
        ours, theirs = (
            self.cost(steps) for steps in self._play_both(state, scenes, keys, greedy=jnp.array([True, True]))
        )
        better = paired_t_test(ours, theirs) < self.config.significance

        def pick(new: Any, old: Any) -> Any:
            return jax.tree.map(lambda a, b: jnp.where(better, a, b), new, old)

        return dataclasses.replace(
            state,
            baseline=pick(state.params, state.baseline),
            test_key=jax.lax.select(better, next_key, state.test_key),
            swaps=state.swaps + better,
        )


def paired_t_test(ours: Array, theirs: Array) -> Array:
    """One-sided p-value of the hypothesis that `ours` is not smaller than `theirs` in the mean, paired by index.

    By Student's t distribution: P(T <= t) = 1/2 I_x(n/2, 1/2) for t < 0, with n degrees of freedom and
    x = n / (n + t^2).
    """
    difference = ours - theirs
    count = difference.shape[0]
    deviation = jnp.std(difference, ddof=1) / jnp.sqrt(count)
    t = jnp.mean(difference) / jnp.where(deviation > 0, deviation, 1.0)
    tail = 0.5 * jax.scipy.special.betainc(0.5 * (count - 1), 0.5, (count - 1) / (count - 1 + t * t))
    return jnp.where(deviation > 0, jnp.where(t < 0, tail, 1.0 - tail), 1.0)
