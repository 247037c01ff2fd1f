"""Trained policies: both layers as one pytree, from a run's weights file or those shipped with the package."""

from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from basenet_jax.config import ReinforceConfig, SacConfig
from basenet_jax.policies.base_pose import BasePosePolicy, untrained_policy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.weights_file import load_weights

PACKAGED = "default.weights"


class Weights(NamedTuple):
    """Both trained layers, as a run's `basenet.weights` holds them."""

    base_pose: BasePosePolicy
    sequence: Any  # parameters of `GraspSequencePolicy`; None where that layer isn't trained


def load_policies(path: Path | None = None) -> Weights:
    """Trained policies of the presets' sizes; by default those shipped with the package.

    Raises:
        ValueError: the file is missing, damaged or holds other networks' weights; the message names it.
    """
    if path is not None:
        return load_weights(path, jax.eval_shape(_untrained))[0]
    with as_file(files("basenet_jax.policies") / "weights" / PACKAGED) as packaged:
        return load_weights(packaged, jax.eval_shape(_untrained))[0]


def sequence_network(config: ReinforceConfig = ReinforceConfig()) -> GraspSequencePolicy:
    """The network of a configuration; by default the presets'."""
    return GraspSequencePolicy(features=config.features, layers=config.layers, attention=config.attention)


def _untrained() -> Weights:
    """Weights of the presets' sizes; only their shapes matter."""
    sequence = sequence_network().init(jax.random.key(0), jnp.zeros((1, 4)), jnp.zeros(3), jnp.ones(1, bool))
    return Weights(untrained_policy(SacConfig().hidden), sequence)
