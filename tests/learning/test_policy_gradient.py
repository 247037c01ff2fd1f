"""The gradient by choices, in chunks and on few slots, against autodiff of the whole episodes' log probabilities."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.learning.policy_gradient import policy_gradient
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy, compact_sizes
from basenet_jax.policies.pickup import PickupState, PickupStep

SLOTS = 7

estimated = jax.jit(policy_gradient, static_argnums=0)


@pytest.fixture(scope="module")
def network():
    return GraspSequencePolicy(features=8, layers=2)


@pytest.fixture(scope="module")
def episodes():
    """Nine made-up ones with 0 to 7 objects, of which one ends early."""
    numbers = np.array([7, 1, 4, 2, 7, 5, 3, 6, 0])
    rng = np.random.default_rng(0)
    orders = np.stack([rng.permutation(SLOTS) for _ in numbers])
    remaining = np.stack(
        [np.isin(np.arange(SLOTS), order[:number]) for order, number in zip(orders, numbers, strict=True)]
    )
    steps = []
    for step in range(SLOTS):
        active = step < numbers
        ended = (np.arange(len(numbers)) == 4) & (step > 2)
        pose = rng.uniform(-2, 2, (len(numbers), 3)).astype(np.float32)
        last = np.maximum(numbers - 1 - step, 0)
        choice = np.take_along_axis(orders, last[:, None], axis=1)[:, 0]
        state = PickupState(jnp.asarray(pose), jnp.asarray(remaining), jnp.asarray(ended))
        zero = jnp.zeros(len(numbers))
        executed = jnp.asarray(active & ~ended)
        steps.append(PickupStep(state, jnp.asarray(choice), state.robot_pose, zero, jnp.asarray(active), executed))
        remaining = remaining & (np.arange(SLOTS) != np.where(active, choice, -1)[:, None])
    grasps = jnp.asarray(rng.uniform(-1, 1, (len(numbers), SLOTS, 4)).astype(np.float32))
    return grasps, jax.tree.map(lambda *x: jnp.stack(x), *steps), jnp.asarray(rng.normal(size=len(numbers)))


def test_it_is_the_derived_gradient(network, episodes):
    grasps, steps, weight = episodes
    params = jax.jit(network.init)(jax.random.key(0), grasps[0], jnp.zeros(3), jnp.ones(SLOTS, bool))
    counts = steps.active & ~steps.state.ended

    def mean(params):
        logits = network.apply(params, jnp.broadcast_to(grasps, (SLOTS, *grasps.shape)), *in_state(steps))
        logs = jax.nn.log_softmax(jnp.where(counts[..., None], logits, 0.0))
        chosen = jnp.take_along_axis(logs, steps.choice[..., None], axis=-1)[..., 0]
        entropy = -jnp.sum(jnp.where(jnp.isfinite(logs), jnp.exp(logs) * logs, 0.0), axis=-1)
        terms = jnp.where(counts, weight * chosen, 0.0), jnp.where(counts, entropy, 0.0)
        return tuple(jnp.mean(jnp.sum(term, axis=0)) for term in terms)

    expected, expected_entropy = jax.jit(jax.grad(mean, has_aux=True))(params)
    found, entropy = estimated(network, params, grasps, steps, weight)
    assert len(compact_sizes(SLOTS)) > 1
    chex.assert_trees_all_close(found, expected, atol=2e-6, rtol=1e-4)
    assert float(entropy) == pytest.approx(float(expected_entropy), rel=1e-5)


def test_no_choices_no_gradient(network, episodes):
    grasps, steps, weight = episodes
    params = jax.jit(network.init)(jax.random.key(0), grasps[0], jnp.zeros(3), jnp.ones(SLOTS, bool))
    nothing = steps.replace(active=jnp.zeros_like(steps.active))
    found, entropy = estimated(network, params, grasps, nothing, weight)
    assert all(not np.any(leaf) for leaf in jax.tree.leaves(found))
    assert float(entropy) == 0.0


def in_state(steps):
    return steps.state.robot_pose, steps.state.remaining
