"""The sequence learner: its gradient is the exact one, its baseline and t-test do what they say."""

import itertools
from functools import partial

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from basenet_jax.config import WorldConfig
from basenet_jax.learning.config import ReinforceConfig
from basenet_jax.learning.policy_gradient import policy_gradient
from basenet_jax.learning.reinforce import Reinforce, paired_t_test
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.policies.pickup import rollout

TINY = ReinforceConfig(
    objects=3,
    features=8,
    layers=2,
    episodes_per_update=128,
    updates_per_interval=40,
    intervals=2,
    learning_rate=5e-3,
    final_learning_rate_share=1.0,
    test_episodes=1024,  # enough for the t-test to see a gain of a second
    evaluation_scenes=256,
    navigation_weight=1.0,
)


def parking_policy():
    """Parks opposite the grasp on its side of the table, headed towards where the robot is; no hidden layers."""
    kernel = np.zeros((15, 8), np.float32)
    kernel[0, 0], kernel[1, 1] = 0.5, 1e3
    kernel[3, 2] = kernel[4, 3] = 1.0
    return BasePosePolicy(
        (jnp.asarray(kernel),), (jnp.array([0.1, 0.0, 0.2, 0.1, 0, 0, 0, 0.0]),), jnp.zeros(15), jnp.ones(15), "table"
    )


@pytest.fixture(scope="module")
def learner(robot):
    return Reinforce(robot, parking_policy(), TINY, WorldConfig())


@pytest.fixture(scope="module")
def trained(learner):
    """The first state and those after three intervals, with their metrics."""
    interval = jax.jit(chex.assert_max_traces(learner.interval, n=1))
    states, every = [jax.jit(learner.init)(jax.random.key(3))], []
    for _ in range(3):
        state, metrics = interval(states[-1])
        states.append(state)
        every.append(jax.device_get(metrics))
    return interval, states, every


def test_gradient_is_that_of_the_expected_cost_by_enumeration(learner):
    """Over all six orders, sum of P · cost · grad log P, against autodiff of sum of P · cost."""
    params = jax.jit(learner.init)(jax.random.key(0)).params

    @jax.jit
    def draw(key):
        scenes = learner.draw(key, 1, vary_count=False, own_class_share=0.0)
        return jax.tree.map(lambda x: jnp.broadcast_to(x[0], (6, *x.shape[1:])), scenes)

    scenes = draw(jax.random.key(1))
    orders = np.array(list(itertools.permutations(range(3))))

    def forced(state, *_):
        step = 3 - jnp.sum(state.remaining, axis=-1)
        return jnp.take_along_axis(jnp.asarray(orders), jnp.minimum(step, 2)[:, None], axis=1)[:, 0]

    @jax.jit
    def roll_out(key):
        steps = rollout(learner.robot, scenes, learner.base_pose, forced, key, learner.world)
        return steps, learner.cost(steps)

    steps, cost = roll_out(jax.random.key(2))
    assert float(np.std(cost)) > 0.1, "all orders cost the same: the test would show nothing"

    @jax.jit
    def probabilities(params):
        chances = []
        for row, order in enumerate(orders):
            chance, remaining = 1.0, np.ones(3, bool)
            for step, choice in enumerate(order):
                pose = steps.state.robot_pose[step, row]
                logits = learner.network.apply(params, scenes.first_grasp[0], pose, jnp.asarray(remaining))
                weights = jnp.where(jnp.asarray(remaining), jnp.exp(jnp.asarray(logits)), 0.0)
                chance = chance * weights[choice] / jnp.sum(weights)
                remaining = remaining & (np.arange(3) != choice)
            chances.append(chance)
        return jnp.stack(chances)

    exact = jax.jit(jax.grad(lambda params: jnp.sum(probabilities(params) * cost)))(params)
    chance = np.asarray(probabilities(params))
    np.testing.assert_allclose(np.sum(chance), 1.0, atol=1e-5)
    estimated = jax.jit(policy_gradient, static_argnums=0)
    for baseline in (0.0, np.mean(cost)):  # a constant baseline doesn't bias the gradient
        weight = 6 * chance * (np.asarray(cost) - baseline)
        estimate, _ = estimated(learner.network, params, scenes.first_grasp, steps, weight)
        chex.assert_trees_all_close(estimate, exact, atol=2e-4, rtol=2e-3)
    assert np.max(np.abs(jax.tree.leaves(exact)[0])) > 1e-3


def test_training_lowers_the_cost_and_swaps_the_baseline(learner, trained):
    _, states, metrics = trained
    start = jax.jit(learner.evaluate)(states[0].params)
    assert float(metrics[-1]["navigation_time"]) < float(start["navigation_time"])
    assert int(states[-1].swaps) >= 1
    assert int(states[-1].update) == 120
    chex.assert_tree_all_finite(states[-1].params)


def test_one_interval_is_reproducible_and_traced_once(trained):
    interval, states, metrics = trained
    again, same = interval(states[0])
    chex.assert_trees_all_equal(again.params, states[1].params)
    chex.assert_trees_all_equal(jax.device_get(same), metrics[0])
    assert not np.array_equal(jax.random.key_data(states[2].key), jax.random.key_data(states[1].key))


def test_scenes_have_one_to_all_objects(learner):
    draw = partial(learner.draw, count=300, vary_count=True, own_class_share=0.5)
    scenes = jax.device_get(jax.jit(draw)(jax.random.key(8)))
    assert set(np.unique(scenes.mask.sum(-1))) == {1, 2, 3}
    assert 0.3 < np.mean(scenes.object_class == -1) < 0.7


@pytest.mark.parametrize("shift", [-0.3, -0.05, 0.0, 0.2])
def test_paired_t_test_is_scipys(shift):
    rng = np.random.default_rng(0)
    theirs = rng.normal(10, 3, 500).astype(np.float32)
    ours = (theirs + rng.normal(shift, 1.0, 500)).astype(np.float32)
    expected = scipy.stats.ttest_rel(ours, theirs, alternative="less").pvalue
    assert float(paired_t_test(jnp.asarray(ours), jnp.asarray(theirs))) == pytest.approx(expected, rel=2e-3, abs=1e-6)


def test_equal_policies_never_swap():
    cost = jnp.arange(10.0)
    assert float(paired_t_test(cost, cost)) == 1.0
