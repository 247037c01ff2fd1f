"""The eager PyTorch version that `benchmarks.sequence_training` sets beside ours computes the same."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs PyTorch, of the extra `benchmarks`")

from basenet_jax.learning.config import ReinforceConfig, TrainConfig  # noqa: E402
from basenet_jax.learning.policy_gradient import policy_gradient  # noqa: E402
from basenet_jax.learning.training import Training  # noqa: E402
from basenet_jax.policies.trained import load_policies, untrained_sequence  # noqa: E402
from benchmarks.eager_networks import GraspSequence  # noqa: E402
from benchmarks.eager_sequence import EagerReinforce, as_tensors  # noqa: E402

EPISODES, OBJECTS = 24, 4
# Float32 with sums in another order; drives of a minute are exact to a few milliseconds in float32.
LOGIT, SECONDS, GRADIENT = 1e-4, 0.02, 1e-3


@pytest.fixture(scope="module")
def weights():
    return load_policies()


@pytest.fixture(scope="module")
def learner(weights):
    config = TrainConfig(reinforce=ReinforceConfig(objects=OBJECTS))
    return Training(config).reinforce(weights.base_pose)


@pytest.fixture(scope="module")
def eager(learner, weights):
    return EagerReinforce(learner.robot, weights.base_pose, weights.sequence, learner.config, learner.world)


@pytest.fixture(scope="module")
def scenes(learner):
    def draw(key):
        return learner.draw(key, EPISODES, vary_count=True, own_class_share=0.5)

    return jax.jit(draw)(jax.random.key(5))


@pytest.fixture(scope="module")
def steps(learner, weights, scenes):
    return jax.jit(lambda key: learner.play(weights.sequence, scenes, key, greedy=True))(jax.random.key(6))


def test_same_logits(learner, weights, scenes):
    expected = learner.network.apply(weights.sequence, scenes.first_grasp, scenes.robot_start, scenes.mask)
    given = as_tensors(scenes)
    with torch.no_grad():
        found = GraspSequence().load(weights.sequence)(given.grasps, given.robot_start, given.mask).numpy()
    np.testing.assert_array_equal(np.isfinite(found), np.asarray(scenes.mask))
    np.testing.assert_allclose(found, expected, atol=LOGIT)


def test_same_greedy_episodes(learner, eager, scenes, steps):
    with torch.no_grad():
        episodes = eager.play(eager.policy, as_tensors(scenes), greedy=True)
    chosen = np.where(np.asarray(steps.active.T), episodes.choices.numpy(), -1)
    np.testing.assert_array_equal(chosen, np.where(np.asarray(steps.active.T), np.asarray(steps.choice.T), -1))
    np.testing.assert_allclose(episodes.cost, learner.cost(steps), atol=SECONDS)
    assert float(episodes.cost.min()) > 1.0


def test_same_gradient(learner, eager, weights, scenes, steps):
    advantage = jnp.linspace(-1.0, 1.0, EPISODES)
    weight = learner.config.navigation_weight * advantage
    expected, _ = jax.jit(partial(policy_gradient, learner.network))(
        weights.sequence, scenes.first_grasp, steps, weight
    )
    episodes = eager.play(eager.policy, as_tensors(scenes), greedy=True)
    eager.optimizer.zero_grad()
    eager.loss(episodes, torch.tensor(np.asarray(advantage))).backward()
    found, largest = eager.policy.gradient(), max(float(jnp.abs(x).max()) for x in jax.tree.leaves(expected))
    assert jax.tree.structure(dict(found)) == jax.tree.structure(dict(expected))
    for ours, theirs in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
        np.testing.assert_allclose(theirs, ours, atol=GRADIENT * largest)


def test_drives_and_collisions_are_the_packages(learner, eager):
    """Also where ways lead round the table, and where there is none."""
    from basenet_jax.task.navigation import navigation_time
    from basenet_jax.world.clearance import base_collides

    random = np.random.default_rng(0)
    start, goal = (random.uniform((-2.5, -2.0, -np.pi), (2.5, 2.0, np.pi), (500, 3)).astype(np.float32) for _ in "ab")
    expected = np.asarray(jax.jit(navigation_time)(learner.robot, start, goal, learner.room))
    found = eager.drives.duration(torch.tensor(start), torch.tensor(goal)).numpy()
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
    assert 0.2 < np.isfinite(expected).mean() < 0.9
    np.testing.assert_allclose(found, expected, atol=SECONDS)
    collides = np.asarray(base_collides(learner.robot, jnp.asarray(start), learner.room))
    np.testing.assert_array_equal(eager.drives.collides(torch.tensor(start)).numpy(), collides)


def test_an_update_changes_the_policy_and_leaves_the_baseline(learner, weights, scenes):
    params = untrained_sequence()  # a trained policy's choices would be the baseline's
    fresh = EagerReinforce(learner.robot, weights.base_pose, params, learner.config, learner.world)
    before = GraspSequence().load(params)
    torch.manual_seed(0)
    assert np.isfinite(fresh.update(as_tensors(scenes)))
    same = [
        [bool(torch.equal(a, b)) for a, b in zip(network.parameters(), before.parameters(), strict=True)]
        for network in (fresh.policy, fresh.baseline)
    ]
    assert not any(same[0])
    assert all(same[1])
