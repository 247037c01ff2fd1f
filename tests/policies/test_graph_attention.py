"""The sequence network: symmetric in the objects, blind to padding, and GATv2 as published."""

from functools import partial

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
    params = jax.jit(policy.init)(jax.random.key(0), np.zeros((6, 4)), np.zeros(3), np.ones(6, bool))
    apply = jax.jit(policy.apply)
    return lambda *state: np.asarray(apply(params, *state))


def draw_state(seed, slots=6, remaining=4):
    rng = np.random.default_rng(seed)
    grasps, robot_pose = rng.uniform(-1, 1, (slots, 4)), rng.uniform(-2, 2, 3)
    return grasps.astype(np.float32), robot_pose.astype(np.float32), rng.permutation(np.arange(slots) < remaining)


def normal(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("seed", range(5))
def test_permuting_the_objects_permutes_the_logits(network, seed):
    grasps, robot_pose, mask = draw_state(seed)
    order = np.random.default_rng(seed + 100).permutation(6)
    logits = network(grasps, robot_pose, mask)
    permuted = network(grasps[order], robot_pose, mask[order])
    np.testing.assert_allclose(permuted, logits[order], atol=ROUNDING)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("value", [1e3, np.nan, np.inf])
def test_what_stands_in_padded_slots_changes_nothing(network, seed, value):
    grasps, robot_pose, mask = draw_state(seed)
    junk = np.where(mask[:, None], grasps, np.float32(value))
    np.testing.assert_allclose(network(junk, robot_pose, mask), network(grasps, robot_pose, mask), atol=ROUNDING)


def test_more_padding_changes_nothing(network):
    grasps, robot_pose, mask = draw_state(3)
    padded = network(np.pad(grasps, ((0, 4), (0, 0))), robot_pose, np.pad(mask, (0, 4)))
    np.testing.assert_allclose(padded[:6], network(grasps, robot_pose, mask), atol=ROUNDING)
    assert np.all(np.isneginf(padded[6:]))


def test_logits_are_masked_exactly_where_no_object_remains(network):
    grasps, robot_pose, mask = draw_state(1)
    np.testing.assert_array_equal(np.isneginf(network(grasps, robot_pose, mask)), ~mask)


def test_a_batch_is_its_scenes_one_by_one(network):
    states = [draw_state(seed, remaining=1 + seed) for seed in range(5)]
    batch = network(*(np.stack(parts) for parts in zip(*states, strict=True)))
    for logits, state in zip(batch, states, strict=True):
        np.testing.assert_allclose(logits, network(*state), atol=ROUNDING)


@pytest.mark.parametrize("slots", [3, 6, 10])
def test_logits_on_few_slots_are_those_on_all(slots):
    policy = GraspSequencePolicy(features=16, layers=2)
    params = jax.jit(policy.init)(jax.random.key(0), np.zeros((6, 4)), np.zeros(3), np.ones(6, bool))
    states = [draw_state(seed, slots, remaining) for seed, remaining in enumerate(range(1, slots + 1))]
    batch = [np.stack(x) for x in zip(*states, strict=True)]
    every = np.asarray(jax.jit(policy.apply)(params, *batch))
    for most in compact_sizes(slots):
        rows = np.resize(np.arange(most), slots)  # those of at most so many objects
        few = jax.jit(partial(remaining_logits, policy, most=most))(params, *(x[rows] for x in batch))
        np.testing.assert_allclose(few, every[rows], atol=ROUNDING)


def test_every_object_and_the_robot_matter(network):
    grasps, robot_pose, mask = draw_state(2, remaining=3)
    logits = network(grasps, robot_pose, mask)
    assert not np.allclose(network(grasps, robot_pose + 0.5, mask), logits)
    first, second = np.flatnonzero(mask)[:2]
    grasps[first, 0] += 0.5
    moved = network(grasps, robot_pose, mask)
    assert abs(moved[second] - logits[second]) > 1e-6


def test_attention_is_gatv2_written_as_loops():
    queries, values = normal(1, 2, 5, 8)
    remaining = np.array([True, True, False, True, True])
    layer = Neighbours()
    params = jax.jit(layer.init)(jax.random.key(2), queries, values, remaining)
    vector = np.asarray(params["params"]["vector"])[:, 0]
    expected = np.zeros((5, 8))
    for i in range(5):
        others = [j for j in range(5) if remaining[j] and j != i]
        hidden = [np.asarray(queries[i] + values[j]) for j in others]
        scores = [vector @ np.where(h > 0, h, 0.2 * h) for h in hidden]
        weights = np.exp(scores) / np.sum(np.exp(scores))
        expected[i] = sum(w * np.asarray(values[j]) for w, j in zip(weights, others, strict=True))
    np.testing.assert_allclose(jax.jit(layer.apply)(params, queries, values, remaining), expected, atol=1e-5)


@pytest.mark.parametrize("shape", [(4, 4), (3, 5), (1, 2)], ids=str)
@pytest.mark.parametrize("batch", [(), (2, 3)], ids=str)
def test_the_scores_gradient_is_the_derived_one(shape, batch):
    def derived(queries, values, vector):
        return nn.leaky_relu(queries[..., :, None, :] + values[..., None, :, :], 0.2) @ vector

    queries, values = (normal(i, *batch, shape[i], 8) for i in range(2))
    vector, weight = normal(2, 8), normal(3, *batch, *shape)
    found, gradients = pulled(attention_scores, weight, queries, values, vector)
    expected, expected_gradients = pulled(derived, weight, queries, values, vector)
    chex.assert_trees_all_close(found, expected, atol=1e-6)
    chex.assert_trees_all_close(gradients, expected_gradients, atol=1e-5)


def pulled(function, weight, *inputs):
    """Values of a function, and the weighted gradients of all its inputs."""

    @jax.jit
    def both(weight, *inputs):
        values, pull = jax.vjp(function, *inputs)
        return values, pull(weight)

    return both(weight, *inputs)


def test_the_dense_layer_is_flaxs():
    inputs, weight = normal(0, 2, 3, 5), normal(1, 2, 3, 4)
    params = jax.jit(dense(4).init)(jax.random.key(1), inputs)
    found, gradients = pulled(dense(4).apply, weight, params, inputs)
    expected, expected_gradients = pulled(nn.Dense(4).apply, weight, params, inputs)
    chex.assert_trees_all_close(found, expected, atol=1e-6)
    chex.assert_trees_all_close(gradients, expected_gradients, atol=1e-5)


def test_the_plain_sum_has_no_coefficients():
    queries, values = normal(1, 2, 4, 8)
    layer = Neighbours(attention=False)
    params = jax.jit(layer.init)(jax.random.key(2), queries, values, np.ones(4, bool))
    total = values.sum(axis=0) - values
    found = np.asarray(jax.jit(layer.apply)(params, queries, values, np.ones(4, bool)))
    np.testing.assert_allclose(found, total, atol=1e-5)
    assert not jax.tree.leaves(params)


@pytest.mark.parametrize("attention", [True, False])
def test_a_lonely_object_gathers_nothing_and_has_finite_gradients(attention):
    layer = FirstLayer(8, attention)
    objects, *others = np.ones((3, 5), np.float32), np.ones(4, np.float32), np.array([False, True, False])
    params = jax.jit(layer.init)(jax.random.key(0), objects, *others)
    gradient = jax.jit(jax.grad(lambda p: jnp.sum(jnp.asarray(layer.apply(p, objects, *others))[1])))(params)
    chex.assert_tree_all_finite(gradient)
    apply, elsewhere = jax.jit(layer.apply), np.where(np.arange(3)[:, None] == 0, np.float32(9), objects)
    moved, same = (np.asarray(apply(params, each, *others)) for each in (elsewhere, objects))
    np.testing.assert_array_equal(moved[1], same[1])


def test_first_layer_is_the_papers_equation():
    """`h_i = ReLU(w_g s_i + w_r s_r + sum_j s_j w_o)` with all coefficients 1."""
    layer = FirstLayer(8, attention=False)
    objects, robot = normal(0, 3, 5), normal(1, 4)
    params = jax.jit(layer.init)(jax.random.key(2), objects, robot, np.ones(3, bool))
    weights = {name: np.asarray(part["kernel"]) for name, part in params["params"].items()}
    found = np.asarray(jax.jit(layer.apply)(params, objects, robot, np.ones(3, bool)))
    for i in range(3):
        others = sum(objects[j] @ weights["others"] for j in range(3) if j != i)
        expected = np.maximum(objects[i] @ weights["considered"] + robot @ weights["robot"] + others, 0.0)
        np.testing.assert_allclose(found[i], expected, atol=1e-5)


def test_layer_keeps_the_number_of_objects_free():
    layer = Layer(8)
    params = jax.jit(layer.init)(jax.random.key(0), np.ones((3, 8)), np.ones(3, bool))
    assert np.asarray(jax.jit(layer.apply)(params, np.ones((7, 8)), np.ones(7, bool))).shape == (7, 8)
