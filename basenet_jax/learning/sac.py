"""Soft Actor-Critic for the base-pose policy, from Brax's parts.

Brax's own training loop restores only part of its state and fixes the target entropy; here the whole state is one
pytree, and an interval of episodes, updates and evaluation is one jitted program.
"""

import copy
import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array

from basenet_jax import struct
from basenet_jax.devices import ONE_DEVICE, Devices
from basenet_jax.learning._brax import (
    State,
    gradients,
    losses,
    networks,
    replay_buffers,
    running_statistics,
    specs,
)
from basenet_jax.learning.base_pose_env import BasePoseEnv
from basenet_jax.learning.config import SacConfig
from basenet_jax.policies.base_pose import BasePosePolicy

Metrics = dict[str, Array]


class Memory(NamedTuple):
    """One episode, as the replay buffer keeps it: nothing follows its only step."""

    observation: Array
    action: Array
    reward: Array


@struct.dataclass
class SacState:
    """Everything that training needs to go on."""

    actor: Any
    critics: Any
    log_alpha: Array
    actor_optimizer: Any
    critics_optimizer: Any
    alpha_optimizer: Any
    normalizer: running_statistics.RunningStatisticsState
    replay: replay_buffers.ReplayBufferState
    key: Array
    iteration: Array


class Sac:
    """The learner: `init` makes a state, `interval` trains on and evaluates."""

    def __init__(self, env: BasePoseEnv, config: SacConfig, devices: Devices = ONE_DEVICE):
        """Builds networks, losses and replay buffer for an environment; evaluation draws the five classes only.

        Raises:
            ValueError: the batches can't be shared out to the devices.
        """
        self.env, self.config, self.devices = env, config, devices
        devices.check(config.batches)
        self.evaluation_env = copy.copy(env)
        self.evaluation_env.own_class_share = 0.0
        normalize: Any = running_statistics.normalize
        self.networks = networks.make_sac_networks(
            env.observation_size,
            env.action_size,
            preprocess_observations_fn=normalize,
            hidden_layer_sizes=config.hidden,
        )
        _, _, actor_loss = losses.make_losses(
            self.networks, config.reward_scale, discounting=1.0, action_size=env.action_size
        )
        updates = config.intervals * config.iterations_per_interval * config.updates_per_iteration
        adam = optax.adam(optax.cosine_decay_schedule(config.learning_rate, updates, config.final_learning_rate_share))
        self.optimizer = adam
        self._update_critics = _gradient_step(self._critic_loss, adam)
        self._update_actor = _gradient_step(actor_loss, adam)
        self._update_alpha = _gradient_step(self._alpha_loss, adam)
        self.replay = replay_buffers.UniformSamplingQueue(
            config.replay_size,
            Memory(jnp.zeros(env.observation_size), jnp.zeros(env.action_size), jnp.zeros(())),
            config.batch_size,
        )

    def init(self, key: Array) -> SacState:
        """The first state: fresh networks and an empty replay buffer.

        Args:
            key: consumed.
        """
        actor_key, critics_key, replay_key, key = jax.random.split(key, 4)
        actor = self.networks.policy_network.init(actor_key)
        critics = self.networks.q_network.init(critics_key)
        log_alpha = jnp.log(jnp.array(self.config.initial_alpha, jnp.float32))
        state = SacState(
            actor=actor,
            critics=critics,
            log_alpha=log_alpha,
            actor_optimizer=self.optimizer.init(actor),
            critics_optimizer=self.optimizer.init(critics),
            alpha_optimizer=self.optimizer.init(log_alpha),
            normalizer=running_statistics.init_state(specs.Array((self.env.observation_size,), jnp.dtype("float32"))),
            replay=self.replay.init(replay_key),
            key=key,
            iteration=jnp.zeros((), jnp.int32),
        )
        return self.devices.everywhere(state)

    def interval(self, state: SacState) -> tuple[SacState, Metrics]:
        """Some iterations of episodes and updates, then the evaluation of the deterministic policy.

        Args:
            state: may be donated.
        """
        state, training = jax.lax.scan(self._iterate, state, length=self.config.iterations_per_interval)
        metrics = {name: jnp.mean(values) for name, values in training.items()}
        metrics |= self.evaluate(self.policy(state), jax.random.key(self.config.evaluation_seed))
        return self.devices.everywhere((state, metrics))

    def evaluate(self, policy: BasePosePolicy, key: Array) -> Metrics:
        """Single-pick success, collisions and mean times of a deterministic policy, on problems drawn by `key`."""
        env, apart = self.evaluation_env, self.devices.apart
        start = apart(jax.vmap(env.reset))(jax.random.split(key, self.config.evaluation_problems))
        base_pose = policy(start.info["grasp"], start.info["robot_pose"])
        trial = apart(env.park, in_axes=(0, 0))(start, base_pose)
        success, collision = jnp.mean(trial.success), jnp.mean(trial.collision)
        return {
            "success": success,
            "collision": collision,
            "navigation_time": jnp.mean(trial.navigation_time) / jnp.maximum(1.0 - collision, 1e-6),
            "pick_time": jnp.mean(trial.pick_time) / jnp.maximum(success, 1e-6),
        }

    def policy(self, state: SacState) -> BasePosePolicy:
        """The deterministic policy, without anything of training."""
        layers = [state.actor["params"][f"hidden_{i}"] for i in range(len(state.actor["params"]))]
        normalizer: Any = state.normalizer
        return BasePosePolicy(
            kernels=tuple(layer["kernel"] for layer in layers),
            biases=tuple(layer["bias"] for layer in layers),
            mean=normalizer.mean,
            std=normalizer.std,
            frame=self.env.frame,
        )

    def _iterate(self, state: SacState, _: None) -> tuple[SacState, Metrics]:
        reset_key, action_key, update_key, key = jax.random.split(state.key, 4)

        memory, measured = self._play(reset_key, lambda start: self._act(state, start, action_key))
        state = dataclasses.replace(
            state,
            key=key,
            iteration=state.iteration + 1,
            normalizer=running_statistics.update(state.normalizer, memory.observation),
            replay=self.replay.insert_internal(state.replay, self.devices.everywhere(memory)),
        )
        # Unrolled, XLA's CPU runtime runs independent products of one update side by side on two cores.
        keys = jax.random.split(update_key, self.config.updates_per_iteration)
        state, updates = jax.lax.scan(self._update, state, keys, unroll=4)
        explored = {"exploration_success": measured["success"], "exploration_collision": measured["collision"]}
        metrics = {name: jnp.mean(values) for name, values in (updates | explored).items()}
        return state, metrics | {"reward": jnp.mean(memory.reward)}

    def _update(self, state: SacState, key: Array) -> tuple[SacState, Metrics]:
        """One gradient step of temperature, critics and actor each, on one batch from the replay buffer."""
        alpha_key, actor_key = jax.random.split(key)
        replay, memory = self.replay.sample_internal(state.replay)
        memory = self.devices.split(memory)
        alpha = jnp.exp(state.log_alpha)
        alpha_loss, log_alpha, alpha_optimizer = self._update_alpha(
            state.log_alpha,
            state.actor,
            state.normalizer,
            memory,
            self._target_entropy(state.iteration),
            alpha_key,
            optimizer_state=state.alpha_optimizer,
        )
        critic_loss, critics, critics_optimizer = self._update_critics(
            state.critics, state.normalizer, memory, optimizer_state=state.critics_optimizer
        )
        actor_loss, actor, actor_optimizer = self._update_actor(
            state.actor, state.normalizer, critics, alpha, memory, actor_key, optimizer_state=state.actor_optimizer
        )
        state = dataclasses.replace(
            state,
            actor=actor,
            critics=critics,
            log_alpha=log_alpha,
            actor_optimizer=actor_optimizer,
            critics_optimizer=critics_optimizer,
            alpha_optimizer=alpha_optimizer,
            replay=replay,
        )
        metrics = {"critic_loss": critic_loss, "actor_loss": actor_loss, "alpha_loss": alpha_loss, "alpha": alpha}
        return state, metrics

    def _act(self, state: SacState, start: State, key: Array) -> Array:
        """Actions drawn from the policy; in the first iterations, if so configured, sensible ones at random."""
        policy_key, guess_key = jax.random.split(key) if self.config.guessed_iterations else (key, None)
        logits = self.networks.policy_network.apply(state.normalizer, state.actor, start.obs)
        action = self.networks.parametric_action_distribution.sample(logits, policy_key)
        if guess_key is None:
            return action
        guessed = state.iteration < self.config.guessed_iterations
        return jnp.where(guessed, self.env.guess(start, guess_key), action)

    def _play(self, key: Array, act: Callable[[State], Array]) -> tuple[Memory, Metrics]:
        """A batch of fresh episodes with the actions that `act` gives for their first states."""
        apart = self.devices.apart
        start = apart(jax.vmap(self.env.reset))(jax.random.split(key, self.config.episodes_per_iteration))
        observation: Any = start.obs
        action = act(start)
        end = apart(self.env.step, in_axes=(0, 0))(start, action)
        return Memory(observation, action, end.reward), end.metrics

    def _target_entropy(self, iteration: Array) -> Array:
        """The target entropy (nats) of an iteration: from the first one's to the last one's in a straight line."""
        first, last = self.config.target_entropy, self.config.final_target_entropy
        return first + (last - first) * iteration / (self.config.intervals * self.config.iterations_per_interval)

    def _critic_loss(self, critics: Any, normalizer: Any, memory: Memory) -> Array:
        """Mean squared error of both critics' values of the actions taken, in units of the scaled reward.

        Nothing follows an episode's only step, so the reward is all there is to an action's value: unlike Brax's loss
        this one needs neither target critics nor the policy's next action, a fifth of an update's work.
        """
        value: Any = self.networks.q_network.apply(normalizer, critics, memory.observation, memory.action)
        return 0.5 * jnp.mean(jnp.square(value - self.config.reward_scale * memory.reward[:, None]))

    def _alpha_loss(
        self, log_alpha: Array, actor: Any, normalizer: Any, memory: Memory, target_entropy: Array, key: Array
    ) -> Array:
        """Equation 18 of Haarnoja et al. 2018 (arXiv 1812.05905), with the target entropy as a setting."""
        logits = self.networks.policy_network.apply(normalizer, actor, memory.observation)
        distribution = self.networks.parametric_action_distribution
        raw = distribution.sample_no_postprocessing(logits, key)
        surplus = -distribution.log_prob(logits, raw) - target_entropy
        return jnp.exp(log_alpha) * jnp.mean(jax.lax.stop_gradient(surplus))


def _gradient_step(loss: Callable[..., Any], optimizer: optax.GradientTransformation) -> Callable[..., Any]:
    return gradients.gradient_update_fn(loss, optimizer, pmap_axis_name=None)
