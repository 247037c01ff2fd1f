"""Dense, masked GATv2 layers over the objects that remain to be grasped (Flax).

Every object is a node and attends to all other remaining ones. Arrays are padded to M objects; what stands in padded
or grasped slots changes nothing, and permuting the objects permutes the results.
"""

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float


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
        considered = nn.Dense(self.features, name="considered")(objects)
        considered = considered + nn.Dense(self.features, name="robot")(robot)[..., None, :]
        others = nn.Dense(self.features, name="others")(objects)
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
        considered = nn.Dense(self.features, name="considered")(nodes)
        others = nn.Dense(self.features, name="others")(nodes)
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
        hidden = nn.leaky_relu(queries[..., :, None, :] + values[..., None, :, :], 0.2)
        scores = jnp.where(neighbours, hidden @ vector, -jnp.inf)
        largest = jax.lax.stop_gradient(jnp.max(scores, axis=-1, keepdims=True))
        weights = jnp.where(neighbours, jnp.exp(scores - jnp.where(jnp.isfinite(largest), largest, 0.0)), 0.0)
        total = jnp.sum(weights, axis=-1, keepdims=True)
        return (weights / jnp.where(total > 0, total, 1.0)) @ values
