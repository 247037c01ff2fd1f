"""The sequence network: symmetric in the objects, blind to padding, and GATv2 as published."""

import chex
import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.policies.graph_attention import FirstLayer, Layer, Neighbours, attention_scores, dense
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy, compact_sizes, remaining_logits

# float32 sums over up to ten objects in another order.
ROUNDING = 2e-5


@pytest.fixture(scope="module", params=[True, False], ids=["attention", "plain sum"])
def network(request):
    policy = GraspSequencePolicy(features=16, layers=3, attention=request.param)
    params = policy.init(jax.random.key(0), jnp.zeros((6, 4)), jnp.zeros(3), jnp.ones(6, bool))
    return jax.jit(lambda *state: policy.apply(params, *state))


def draw_state(seed, slots=6, remaining=4):
    keys = jax.random.split(jax.random.key(seed), 3)
    grasps = jax.random.uniform(keys[0], (slots, 4), minval=-1.0)
    mask = jax.random.permutation(keys[2], jnp.arange(slots) < remaining)
    return grasps, jax.random.uniform(keys[1], (3,), minval=-2.0), mask


@pytest.mark.parametrize("seed", range(5))
def test_permuting_the_objects_permutes_the_logits(network, seed):
    grasps, robot_pose, mask = draw_state(seed)
    order = jax.random.permutation(jax.random.key(seed + 100), 6)
    logits = network(grasps, robot_pose, mask)
    permuted = network(grasps[order], robot_pose, mask[order])
    np.testing.assert_allclose(permuted, logits[order], atol=ROUNDING)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("value", [1e3, jnp.nan, jnp.inf])
def test_what_stands_in_padded_slots_changes_nothing(network, seed, value):
    grasps, robot_pose, mask = draw_state(seed)
    junk = jnp.where(mask[:, None], grasps, value)
    np.testing.assert_allclose(network(junk, robot_pose, mask), network(grasps, robot_pose, mask), atol=ROUNDING)


def test_more_padding_changes_nothing(network):
    grasps, robot_pose, mask = draw_state(3)
    padded = network(jnp.pad(grasps, ((0, 4), (0, 0))), robot_pose, jnp.pad(mask, (0, 4)))
    np.testing.assert_allclose(padded[:6], network(grasps, robot_pose, mask), atol=ROUNDING)
    assert np.all(np.isneginf(padded[6:]))


def test_logits_are_masked_exactly_where_no_object_remains(network):
    grasps, robot_pose, mask = draw_state(1)
    np.testing.assert_array_equal(np.isneginf(network(grasps, robot_pose, mask)), ~mask)


def test_a_batch_is_its_scenes_one_by_one(network):
    states = [draw_state(seed, remaining=1 + seed) for seed in range(5)]
    batch = network(*(jnp.stack(parts) for parts in zip(*states, strict=True)))
    for logits, state in zip(batch, states, strict=True):
        np.testing.assert_allclose(logits, network(*state), atol=ROUNDING)


@pytest.mark.parametrize("slots", [3, 6, 10])
def test_logits_on_few_slots_are_those_on_all(slots):
    policy = GraspSequencePolicy(features=16, layers=2)
    params = policy.init(jax.random.key(0), jnp.zeros((6, 4)), jnp.zeros(3), jnp.ones(6, bool))
    states = [draw_state(seed, slots, remaining) for seed, remaining in enumerate(range(1, slots + 1))]
    for most in compact_sizes(slots):
        batch = [jnp.stack(x) for x in zip(*states[:most], strict=True)]
        few = remaining_logits(policy, params, *batch, most=most)
        np.testing.assert_allclose(few, jnp.asarray(policy.apply(params, *batch)), atol=ROUNDING)


def test_every_object_and_the_robot_matter(network):
    grasps, robot_pose, mask = draw_state(2, remaining=3)
    logits = network(grasps, robot_pose, mask)
    assert not np.allclose(network(grasps, robot_pose + 0.5, mask), logits)
    first, second = np.flatnonzero(mask)[:2]
    moved = network(grasps.at[first, 0].add(0.5), robot_pose, mask)
    assert abs(moved[second] - logits[second]) > 1e-6


def test_attention_is_gatv2_written_as_loops():
    queries, values = jax.random.normal(jax.random.key(1), (2, 5, 8))
    remaining = np.array([True, True, False, True, True])
    layer = Neighbours()
    params = layer.init(jax.random.key(2), queries, values, remaining)
    vector = np.asarray(params["params"]["vector"])[:, 0]
    expected = np.zeros((5, 8))
    for i in range(5):
        others = [j for j in range(5) if remaining[j] and j != i]
        hidden = [np.asarray(queries[i] + values[j]) for j in others]
        scores = [vector @ np.where(h > 0, h, 0.2 * h) for h in hidden]
        weights = np.exp(scores) / np.sum(np.exp(scores))
        expected[i] = sum(w * np.asarray(values[j]) for w, j in zip(weights, others, strict=True))
    np.testing.assert_allclose(jnp.asarray(layer.apply(params, queries, values, remaining)), expected, atol=1e-5)


@pytest.mark.parametrize("shape", [(4, 4), (3, 5), (1, 2)], ids=str)
@pytest.mark.parametrize("batch", [(), (2, 3)], ids=str)
def test_the_scores_gradient_is_the_derived_one(shape, batch):
    def derived(queries, values, vector):
        return nn.leaky_relu(queries[..., :, None, :] + values[..., None, :, :], 0.2) @ vector

    keys = jax.random.split(jax.random.key(3), 4)
    queries, values = (jax.random.normal(keys[i], (*batch, shape[i], 8)) for i in range(2))
    vector, weight = jax.random.normal(keys[2], (8,)), jax.random.normal(keys[3], (*batch, *shape))
    found, pull = jax.vjp(attention_scores, queries, values, vector)
    expected, expected_pull = jax.vjp(derived, queries, values, vector)
    chex.assert_trees_all_close(found, expected, atol=1e-6)
    chex.assert_trees_all_close(pull(weight), expected_pull(weight), atol=1e-5)


def test_the_dense_layer_is_flaxs():
    inputs = jax.random.normal(jax.random.key(0), (2, 3, 5))
    params = dense(4).init(jax.random.key(1), inputs)
    found, pull = jax.vjp(lambda p, x: jnp.asarray(dense(4).apply(p, x)), params, inputs)
    expected, expected_pull = jax.vjp(lambda p, x: jnp.asarray(nn.Dense(4).apply(p, x)), params, inputs)
    chex.assert_trees_all_close(found, expected, atol=1e-6)
    chex.assert_trees_all_close(pull(expected), expected_pull(expected), atol=1e-5)


def test_the_plain_sum_has_no_coefficients():
    queries, values = jax.random.normal(jax.random.key(1), (2, 4, 8))
    layer = Neighbours(attention=False)
    params = layer.init(jax.random.key(2), queries, values, jnp.ones(4, bool))
    total = values.sum(axis=0) - values
    found = jnp.asarray(layer.apply(params, queries, values, jnp.ones(4, bool)))
    np.testing.assert_allclose(found, total, atol=1e-5)
    assert not jax.tree.leaves(params)


@pytest.mark.parametrize("attention", [True, False])
def test_a_lonely_object_gathers_nothing_and_has_finite_gradients(attention):
    layer = FirstLayer(8, attention)
    inputs = (jnp.ones((3, 5)), jnp.ones(4), jnp.array([False, True, False]))
    params = layer.init(jax.random.key(0), *inputs)
    gradient = jax.grad(lambda p: jnp.sum(jnp.asarray(layer.apply(p, *inputs))[1]))(params)
    chex.assert_tree_all_finite(gradient)
    moved = layer.apply(params, inputs[0].at[0].set(9.0), *inputs[1:])
    np.testing.assert_array_equal(jnp.asarray(moved)[1], jnp.asarray(layer.apply(params, *inputs))[1])


def test_first_layer_is_the_papers_equation():
    """`h_i = ReLU(w_g s_i + w_r s_r + sum_j s_j w_o)` with all coefficients 1."""
    layer = FirstLayer(8, attention=False)
    objects, robot = jax.random.normal(jax.random.key(0), (3, 5)), jax.random.normal(jax.random.key(1), (4,))
    params = layer.init(jax.random.key(2), objects, robot, jnp.ones(3, bool))
    weights = {name: np.asarray(part["kernel"]) for name, part in params["params"].items()}
    objects_, robot_ = np.asarray(objects), np.asarray(robot)
    for i in range(3):
        others = sum(objects_[j] @ weights["others"] for j in range(3) if j != i)
        expected = np.maximum(objects_[i] @ weights["considered"] + robot_ @ weights["robot"] + others, 0.0)
        found = jnp.asarray(layer.apply(params, objects, robot, jnp.ones(3, bool)))[i]
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_layer_keeps_the_number_of_objects_free():
    layer = Layer(8)
    params = layer.init(jax.random.key(0), jnp.ones((3, 8)), jnp.ones(3, bool))
    assert jnp.asarray(layer.apply(params, jnp.ones((7, 8)), jnp.ones(7, bool))).shape == (7, 8)
