"""Dense, masked GATv2 layers over the objects that remain to be grasped (Flax).

Every object is a node and attends to all other remaining ones. Arrays are padded to M objects; what stands in padded
or grasped slots changes nothing, and permuting the objects permutes the results.
"""

from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

_SLOPE = 0.2  # of LeakyReLU below 0


class FirstLayer(nn.Module):
    """The paper's heterogeneous first layer: `h_i = w_g s_i + w_r s_r + sum_j alpha_ij w_o s_j`, then ReLU.

    `s_i` is the object considered, `s_r` the robot, `s_j` the other remaining objects; each kind has its own weights.
    """

    features: int
    attention: bool = True

    @nn.compact
    def __call__(
        self,
        objects: Float[Array, "*batch M inputs"],
        robot: Float[Array, "*batch robot_inputs"],
        remaining: Bool[Array, "*batch M"],
    ) -> Float[Array, "*batch M features"]:
        """Context embeddings of all objects."""
        considered = dense(self.features, "considered")(objects)
        considered = considered + dense(self.features, "robot")(robot)[..., None, :]
        others = dense(self.features, "others")(objects)
        return nn.relu(considered + Neighbours(self.attention, name="neighbours")(considered, others, remaining))


class Layer(nn.Module):
    """A further layer of the same form: `h_i' = ReLU(w_s h_i + sum_j alpha_ij w_o h_j)`."""

    features: int
    attention: bool = True

    @nn.compact
    def __call__(
        self, nodes: Float[Array, "*batch M inputs"], remaining: Bool[Array, "*batch M"]
    ) -> Float[Array, "*batch M features"]:
        """New embeddings of all objects."""
        considered = dense(self.features, "considered")(nodes)
        others = dense(self.features, "others")(nodes)
        return nn.relu(considered + Neighbours(self.attention, name="neighbours")(considered, others, remaining))


class Neighbours(nn.Module):
    """What each object gathers from the other remaining ones: `sum_j alpha_ij v_j`.

    GATv2 attention (Brody, Alon and Yahav, arXiv 2105.14491): `alpha_ij = softmax_j(a^T LeakyReLU(q_i + v_j))`;
    the plain sum (all alpha 1) without attention. An object without neighbours gathers nothing.
    """

    attention: bool = True

    @nn.compact
    def __call__(
        self,
        queries: Float[Array, "*batch M features"],
        values: Float[Array, "*batch M features"],
        remaining: Bool[Array, "*batch M"],
    ) -> Float[Array, "*batch M features"]:
        """The weighted sums."""
        count = remaining.shape[-1]
        neighbours = remaining[..., None, :] & ~jnp.eye(count, dtype=bool)
        if not self.attention:
            return neighbours.astype(values.dtype) @ values
        vector = self.param("vector", nn.initializers.lecun_normal(), (values.shape[-1], 1))[:, 0]
        scores = jnp.where(neighbours, attention_scores(queries, values, vector), -jnp.inf)
        largest = jax.lax.stop_gradient(jnp.max(scores, axis=-1, keepdims=True))
        weights = jnp.where(neighbours, jnp.exp(scores - jnp.where(jnp.isfinite(largest), largest, 0.0)), 0.0)
        total = jnp.sum(weights, axis=-1, keepdims=True)
        return (weights / jnp.where(total > 0, total, 1.0)) @ values


@jax.custom_vjp
def attention_scores(
    queries: Float[Array, "*batch I features"],
    values: Float[Array, "*batch J features"],
    vector: Float[Array, " features"],
) -> Float[Array, "*batch I J"]:
    """GATv2's scores before the softmax: `e_ij = a^T LeakyReLU(q_i + v_j)`.

    Its own gradient never holds an array of I x J x features. With `g_ij` the gradient of `e_ij` and `d_ijk` the slope
    of LeakyReLU there, it needs the sums `Q_ik = sum_j g_ij d_ijk` and `V_jk = sum_i g_ij d_ijk` only: the gradients by
    `q_ik` and `v_jk` are `a_k` times these, and, as LeakyReLU(x) = d x, the gradient by `a_k` is
    `sum_i Q_ik q_ik + sum_j V_jk v_jk`. On a CPU this is ten times as fast as the derived gradient.
    """
    return nn.leaky_relu(queries[..., :, None, :] + values[..., None, :, :], _SLOPE) @ vector


def _scores_forward(queries: Array, values: Array, vector: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    return attention_scores(queries, values, vector), (queries, values, vector)


def _scores_backward(saved: tuple[Array, Array, Array], gradient: Array) -> tuple[Array, Array, Array]:
    queries, values, vector = saved
    by_queries = _slopes_gathered(queries, values, gradient)
    by_values = _slopes_gathered(values, queries, jnp.swapaxes(gradient, -1, -2))
    by_vector = jnp.einsum("...k,...k->k", by_queries, queries) + jnp.einsum("...k,...k->k", by_values, values)
    return by_queries * vector, by_values * vector, by_vector


attention_scores.defvjp(_scores_forward, _scores_backward)


def _slopes_gathered(
    own: Float[Array, "*batch I features"],
    others: Float[Array, "*batch J features"],
    weight: Float[Array, "*batch I J"],
) -> Float[Array, "*batch I features"]:
    """`sum_j w_ij d(x_ik + y_jk)` with d the slope of LeakyReLU: one term after the other, which XLA makes one loop."""
    total = jnp.zeros_like(own)
    for j in range(others.shape[-2]):
        each = weight[..., j, None]
        total = total + jnp.where(own + others[..., j, None, :] >= 0, each, _SLOPE * each)
    return total


def dense(features: int, name: str | None = None, **options: Any) -> nn.Dense:
    """A dense layer whose products are of two matrices, whatever batch it is given.

    On a CPU XLA computes the kernel's gradient, a product over all axes of the batch, twice as fast over one axis.
    Further options are Flax's.
    """
    return nn.Dense(features, name=name, dot_general=_flat_product, **options)


def _flat_product(batch: Array, kernel: Array, *_: Any, **options: Any) -> Array:
    """`batch @ kernel` in the form of `jax.lax.dot_general`, of which Flax's dense layer needs only this."""
    flat = jax.lax.dot_general(batch.reshape(-1, batch.shape[-1]), kernel, (((1,), (0,)), ((), ())), **options)
    return flat.reshape(*batch.shape[:-1], kernel.shape[-1])
