"""The base-pose learner: it learns a toy problem, from fresh scenes, with a critic that has something to learn."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.learning._brax import networks
from basenet_jax.learning.base_pose_env import BasePoseEnv, Trial
from basenet_jax.learning.config import SacConfig
from basenet_jax.learning.sac import Sac
from basenet_jax.policies.base_pose import BasePosePolicy, base_pose_from_action

SMALL = SacConfig(
    hidden=(64, 64),
    learning_rate=3e-3,
    reward_scale=10.0,
    target_entropy=-3.0,
    final_target_entropy=-3.0,
    final_learning_rate_share=1.0,
    episodes_per_iteration=64,
    updates_per_iteration=8,
    batch_size=128,
    replay_size=4096,
    iterations_per_interval=50,
    evaluation_problems=256,
)


class Bandit(BasePoseEnv):
    """A toy with a known best action: stand 0.7 m from the grasp, along its yaw."""

    def park(self, state, base_pose):
        grasp = state.info["grasp"]
        goal = grasp[..., :2] + 0.7 * jnp.stack([jnp.cos(grasp[..., 3]), jnp.sin(grasp[..., 3])], axis=-1)
        miss = jnp.linalg.norm(base_pose[..., :2] - goal, axis=-1)
        no = jnp.zeros_like(miss, bool)
        return Trial(reward=-miss, success=miss < 0.15, collision=no, navigation_time=miss, pick_time=miss)


@pytest.fixture(scope="module")
def bandit(robot):
    return Sac(Bandit(robot), SMALL)


@pytest.fixture(scope="module")
def trained(bandit):
    chex.clear_trace_counter()
    interval = jax.jit(chex.assert_max_traces(bandit.interval, n=1))
    state, history = jax.jit(bandit.init)(jax.random.key(0)), []
    for _ in range(5):
        state, metrics = interval(state)
        history.append(jax.device_get(metrics))
    return state, history, interval


def test_it_learns_a_toy_bandit(trained):
    _, history, _ = trained
    assert history[-1]["navigation_time"] < 0.1, "mean distance (m) to the best pose, 0.9 at random"
    assert history[-1]["success"] > 0.8


def test_the_critics_learn_from_nonzero_errors(trained):
    _, history, _ = trained
    assert all(metrics["critic_loss"] > 1e-6 for metrics in history)
    assert history[-1]["critic_loss"] < history[0]["critic_loss"]


def test_the_first_iterations_guess_if_so_configured(robot, trained):
    state, *_ = trained
    sac = Sac(Bandit(robot), dataclasses.replace(SMALL, guessed_iterations=2))
    start = jax.jit(jax.vmap(sac.env.reset))(jax.random.split(jax.random.key(1), 64))
    act, step = jax.jit(sac._act), jax.jit(sac.env.step)
    first, second, third = (act(state.replace(iteration=jnp.array(i)), start, jax.random.key(2)) for i in range(3))
    miss = [float(np.mean(step(start, action).metrics["navigation_time"])) for action in (first, third)]
    np.testing.assert_array_equal(first, second)
    assert miss[0] > 0.3 > miss[1], "random ones miss by much, the trained policy's don't"


def test_every_episode_has_a_fresh_scene(trained):
    state, *_ = trained
    count = int(state.replay.insert_position)
    seen = np.asarray(state.replay.data)[:count, :5]
    assert len(np.unique(seen, axis=0)) == count == min(SMALL.replay_size, 64 * 250)


def test_the_temperature_steers_entropy_to_its_target(bandit, trained):
    state, *_ = trained

    @jax.jit
    def log_probability(state):
        batch = jax.vmap(bandit.env.reset)(jax.random.split(jax.random.key(1), 512))
        distribution = bandit.networks.parametric_action_distribution
        logits = bandit.networks.policy_network.apply(state.normalizer, state.actor, batch.obs)
        return distribution.log_prob(logits, distribution.sample_no_postprocessing(logits, jax.random.key(2)))

    entropy = -float(np.mean(log_probability(state)))
    assert entropy == pytest.approx(SMALL.target_entropy, abs=1.0)


def test_policy_is_braxs_deterministic_one(bandit, trained):
    state, *_ = trained
    start = jax.jit(jax.vmap(bandit.env.reset))(jax.random.split(jax.random.key(4), 16))
    act = networks.make_inference_fn(bandit.networks)((state.normalizer, state.actor), deterministic=True)
    action, _ = jax.jit(act)(start.obs, jax.random.key(0))
    expected = jax.jit(base_pose_from_action, static_argnums=2)(action, start.info["grasp"], "object")
    found = jax.jit(BasePosePolicy.__call__)(bandit.policy(state), start.info["grasp"], start.info["robot_pose"])
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_an_interval_is_reproducible_and_traced_once(bandit, trained):
    _, history, interval = trained
    init = jax.jit(bandit.init)
    first, metrics = interval(init(jax.random.key(0)))
    assert {name: float(value) for name, value in metrics.items()} == history[0]
    other, _ = interval(init(jax.random.key(10)))
    assert not np.array_equal(jax.tree.leaves(other.actor)[0], jax.tree.leaves(first.actor)[0])
