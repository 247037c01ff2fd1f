"""The gradient of REINFORCE for the grasp sequence: by choices, whatever their episode and step."""

import itertools
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy, compact_sizes, remaining_logits
from basenet_jax.policies.pickup import PickupStep

_PARTS = 2  # of a batch of episodes: so many choices are computed at once


def policy_gradient(
    network: GraspSequencePolicy,
    params: Any,
    grasps: Float[Array, "B M 4"],
    steps: PickupStep,
    weight: Float[Array, " B"],
) -> tuple[Any, Float[Array, ""]]:
    """Gradient of the mean over episodes of `weight · log probability of the choices`, and of the choices' entropies.

    Choices are sorted by how many objects remained, and computed on as few slots as these need, some at a time. So
    memory holds the activations of few of them, and the steps of an episode that has ended cost nothing.

    Args:
        network: the policy.
        params: its parameters.
        grasps: in W, of each episode's objects.
        steps: of the episodes, with a leading axis of M steps.
        weight: of the episodes.

    Returns:
        Like the parameters; and nats per episode.
    """
    slots, episodes = steps.choice.shape
    counts = steps.active & ~steps.state.ended
    number = jnp.where(counts, jnp.sum(steps.state.remaining, axis=-1), 0).ravel()
    total = (jax.tree.map(jnp.zeros_like, params), jnp.zeros(()))
    for most, fewer in itertools.pairwise((*compact_sizes(slots), 0)):

        def gradient(choice: Int[Array, " C"], counts: Bool[Array, " C"], most: int = most) -> Any:
            episode = choice % episodes
            state, slot = jax.tree.map(
                lambda x: x.reshape(slots * episodes, *x.shape[2:])[choice],
                ((steps.state.robot_pose, steps.state.remaining), steps.choice),
            )
            own = jnp.where(counts, weight[episode] / episodes, 0.0)

            def weighted(params: Any) -> tuple[Array, Array]:
                logits = remaining_logits(network, params, grasps[episode], *state, most=most)
                return _log_probability(jnp.where(counts[:, None], logits, 0.0), slot, own, counts)

            return jax.grad(weighted, has_aux=True)(params)

        def add(index: Int[Array, " C"], total: Any, gradient: Any = gradient) -> Any:
            more = gradient(jnp.minimum(index, number.size - 1), index < number.size)
            return jax.tree.map(jnp.add, total, more)

        at_once = max(1, episodes // _PARTS)
        total = rounds.over_chosen((number > fewer) & (number <= most), add, total, at_once)
    return total[0], total[1] / episodes


def _log_probability(
    logits: Float[Array, "C M"], choice: Int[Array, " C"], weight: Float[Array, " C"], counts: Bool[Array, " C"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Weighted sum of the log probabilities of choices, and the sum of their distributions' entropies."""
    logs = jax.nn.log_softmax(logits)
    chosen = jnp.take_along_axis(logs, choice[:, None], axis=-1)[:, 0]
    entropy = -jnp.sum(jnp.exp(logs) * jnp.where(jnp.isfinite(logs), logs, 0.0), axis=-1)
    return jnp.sum(jnp.where(counts, weight * chosen, 0.0)), jnp.sum(entropy * counts)
