"""The base-pose environment: one step, fresh scenes, the paper's reward, and two backends that agree."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.learning.base_pose_env import BasePoseEnv
from basenet_jax.learning.config import BasePoseRewardConfig
from basenet_jax.planners.candidates import within_reach
from basenet_jax.policies.base_pose import ACTION_SIZE, OBSERVATION_SIZE, base_pose_from_action
from basenet_jax.world.clearance import base_collides


@pytest.fixture(scope="module")
def env(robot):
    return BasePoseEnv(robot, own_class_share=0.5)


@pytest.fixture(scope="module")
def step(robot):
    """The environment's, compiled once for all weights of its reward."""

    def step(start, action, reward):
        made: Any = BasePoseEnv(robot, own_class_share=0.5)
        made.reward = SimpleNamespace(**reward)
        return made.step(start, action)

    compiled = jax.jit(step)
    return lambda start, action, reward=BasePoseRewardConfig(): compiled(start, action, dataclasses.asdict(reward))


@pytest.fixture(scope="module")
def episodes(env, step):
    """Ends of 1,024 episodes that mix hopeless, colliding and promising base poses."""
    start = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 1024))
    action = np.random.default_rng(1).uniform(-0.7, 0.7, (1024, ACTION_SIZE)).astype(np.float32)
    return *jax.device_get((start, action)), jax.device_get(step(start, action))


def test_reset_draws_a_fresh_scene_for_every_key(env, episodes):
    start, _, _ = episodes
    assert start.obs.shape == (1024, OBSERVATION_SIZE) == (1024, env.observation_size)
    assert len(np.unique(start.info["grasp"], axis=0)) == 1024
    assert len(np.unique(start.info["robot_pose"], axis=0)) == 1024


def test_robot_starts_free_of_the_table_half_of_the_time_near_it(env, episodes):
    pose = episodes[0].info["robot_pose"]
    assert not bool(jnp.any(base_collides(env.robot, pose, env.room)))
    assert float(jnp.max(jnp.hypot(pose[:, 0], pose[:, 1]))) <= 3.0
    near = float(jnp.mean((jnp.abs(pose[:, 0]) <= 2.0) & (jnp.abs(pose[:, 1]) <= 1.5)))
    assert 0.6 < near < 0.8, "half by construction, and some of the others by chance"


def test_every_episode_ends_with_its_first_step(episodes):
    _, _, end = episodes
    assert np.all(np.asarray(end.done) == 1.0)
    assert np.all(np.asarray(end.info["truncation"]) == 0.0)


def test_reward_is_the_papers(episodes):
    metrics, reward = episodes[2].metrics, np.asarray(episodes[2].reward)
    success, collision = np.asarray(metrics["success"]) > 0, np.asarray(metrics["collision"]) > 0
    assert success.sum() > 20
    assert collision.sum() > 20
    assert (~success & ~collision).sum() > 20
    drive, pick = np.asarray(metrics["navigation_time"]), np.asarray(metrics["pick_time"])
    expected = np.where(success, 1.0 + 0.5 / (1 + drive) + 0.5 / (1 + pick), 0.0) - 0.2 * collision
    np.testing.assert_allclose(reward, expected, atol=1e-6)
    assert not np.any(success & collision)


def test_single_episodes_under_vmap_are_the_batch(env, episodes):
    start, action, end = episodes
    part = jax.tree.map(lambda x: x[:32], start)
    one_by_one = jax.jit(jax.vmap(env.step))(part, action[:32])
    np.testing.assert_allclose(one_by_one.reward, end.reward[:32], atol=1e-5)


def test_rewards_weights_are_settings(robot, step, episodes):
    start, action, end = episodes
    weights = BasePoseRewardConfig(collision=-7.0, success=0.0, navigation=0.0, grasping=0.0)
    np.testing.assert_allclose(step(start, action, weights).reward, -7.0 * end.metrics["collision"], atol=1e-6)
    assert BasePoseEnv(robot, reward=weights).reward is weights


def test_guesses_make_sense_and_succeed_far_more_often(env, step, episodes):
    start, action, end = episodes
    draw = jax.jit(env.guess)
    guess = draw(start, jax.random.key(2))
    assert guess.shape == action.shape
    assert float(jnp.max(jnp.abs(guess))) <= 1.0
    base_pose = base_pose_from_action(guess, start.info["grasp"], env.frame)
    clear = ~base_collides(env.robot, base_pose, env.room, env.world.pick.base_clearance_m)
    assert float(jnp.mean(clear & within_reach(env.robot, base_pose, start.info["grasp"][..., :3]))) > 0.98
    succeeded = float(jnp.mean(step(start, guess).metrics["success"]))
    assert succeeded > 2.0 * float(jnp.mean(end.metrics["success"]))
    np.testing.assert_array_equal(guess, draw(start, jax.random.key(2)))


def test_an_unknown_backend_is_refused_by_name(robot):
    with pytest.raises(ValueError, match=r"'bullet'.*'kernels' and 'mjx'"):
        BasePoseEnv(robot, backend="bullet")


@pytest.mark.slow
def test_mjx_contacts_give_the_same_rewards_in_1024_environments(robot, episodes):
    start, action, end = episodes
    env = BasePoseEnv(robot, own_class_share=0.5, backend="mjx")
    np.testing.assert_allclose(jax.jit(env.step)(start, action).reward, end.reward, atol=1e-5)
