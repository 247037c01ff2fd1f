"""The grasp-sequence policy: which of the remaining objects to grasp next (layer 1 of the paper)."""

import math
from typing import Any

import flax.linen as nn
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.policies.graph_attention import FirstLayer, Layer, dense
from basenet_jax.trigonometry import sin_cos

OBJECT_FEATURES = 5
ROBOT_FEATURES = 4
_SHARES = (1.0, 0.7, 0.4)  # of the slots; each size is compiled apart
_FEW = 5  # slots, of which a part isn't worth a program of its own


class GraspSequencePolicy(nn.Module):
    """The paper's network: five graph-attention layers, the first heterogeneous, and an MLP of two hidden layers.

    One compiled function serves every number of objects up to the M it is given.
    """

    features: int = 64
    layers: int = 5
    attention: bool = True

    @nn.compact
    def __call__(
        self,
        grasps: Float[Array, "*batch M 4"],
        robot_pose: Float[Array, "*batch 3"],
        remaining: Bool[Array, "*batch M"],
    ) -> Float[Array, "*batch M"]:
        """Logits of a categorical distribution over the remaining objects; minus infinity for all others.

        Args:
            grasps: tool0's x, y, z, yaw in W at each object's grasp.
            robot_pose: (x, y, heading) of the base in W.
            remaining: objects yet to be grasped.
        """
        grasps = jnp.where(remaining[..., None], grasps, 0.0)  # what stands in other slots, NaN included, has no part
        nodes = FirstLayer(self.features, self.attention)(
            object_features(grasps), robot_features(robot_pose), remaining
        )
        for _ in range(self.layers - 1):
            nodes = Layer(self.features, self.attention)(nodes, remaining)
        for _ in range(2):
            nodes = nn.relu(dense(self.features)(nodes))
        logits = dense(1)(nodes)[..., 0]
        return jnp.where(remaining, logits, -jnp.inf)


def compact_sizes(slots: int) -> tuple[int, ...]:
    """Numbers of slots, falling, that states are computed on: the smallest that holds the objects that remain."""
    if slots <= _FEW:
        return (slots,)
    return tuple(math.ceil(share * slots) for share in _SHARES)


def remaining_logits(
    network: GraspSequencePolicy,
    params: Any,
    grasps: Float[Array, "*batch M 4"],
    robot_pose: Float[Array, "*batch 3"],
    remaining: Bool[Array, "*batch M"],
    *,
    most: int,
) -> Float[Array, "*batch M"]:
    """The network's logits, computed on few slots: it is blind to padding and symmetric in the objects.

    Args:
        network: the policy.
        params: its parameters.
        grasps: as for the network.
        robot_pose: likewise.
        remaining: likewise; at most so many as the next argument says.
        most: slots to compute on.
    """
    if most >= grasps.shape[-2]:
        return jnp.asarray(network.apply(params, grasps, robot_pose, remaining))
    rank = jnp.cumsum(remaining, axis=-1) - 1  # of a remaining object among those
    place = jnp.arange(most)[:, None]
    slot = jnp.argmax(remaining[..., None, :] & (rank[..., None, :] == place), axis=-1)
    there = place[:, 0] <= rank[..., -1:]
    few = jnp.take_along_axis(grasps, slot[..., None], axis=-2)
    logits = jnp.asarray(network.apply(params, few, robot_pose, there))
    return jnp.where(remaining, jnp.take_along_axis(logits, jnp.clip(rank, 0, most - 1), axis=-1), -jnp.inf)


def object_features(grasps: Float[Array, "*batch 4"]) -> Float[Array, "*batch 5"]:
    """Position (m) of the grasp in W and the sine and cosine of its yaw."""
    return jnp.concatenate([grasps[..., :3], jnp.stack(sin_cos(grasps[..., 3]), axis=-1)], axis=-1)


def robot_features(robot_pose: Float[Array, "*batch 3"]) -> Float[Array, "*batch 4"]:
    """Position (m) of the base in W and the sine and cosine of its heading."""
    return jnp.concatenate([robot_pose[..., :2], jnp.stack(sin_cos(robot_pose[..., 2]), axis=-1)], axis=-1)
