"""Trained policies: all layers as one pytree, from a run's weights file or those shipped with the package."""

from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from basenet_jax.policies.base_pose import BasePosePolicy, untrained_policy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.stop_policy import StopGraph, StopPolicy, make_scene
from basenet_jax.policies.stop_rollout import start
from basenet_jax.weights_file import load_weights

PACKAGED = "default.weights"
_HIDDEN = (256, 256, 256)  # of the base-pose policy


class Weights(NamedTuple):
    """All layers, as a run's `basenet.weights` holds them."""

    base_pose: BasePosePolicy
    sequence: Any  # parameters of `GraspSequencePolicy`
    stops: Any  # parameters of `StopPolicy`


def load_policies(path: Path | None = None) -> Weights:
    """Trained policies of the presets' sizes; by default those shipped with the package.

    Raises:
        ValueError: the file is missing, damaged or holds other networks' weights; the message names it.
    """
    like = jax.eval_shape(lambda: Weights(untrained_policy(_HIDDEN), untrained_sequence(), untrained_stops()))
    if path is not None:
        return load_weights(path, like)[0]
    with as_file(files("basenet_jax.policies") / "weights" / PACKAGED) as packaged:
        return load_weights(packaged, like)[0]


def untrained_sequence(network: GraspSequencePolicy = GraspSequencePolicy()) -> Any:
    """Parameters of a sequence policy as it begins, for their shapes: see `load_weights`."""
    return network.init(jax.random.key(0), jnp.zeros((1, 4)), jnp.zeros(3), jnp.ones(1, bool))


def untrained_stops(policy: StopPolicy = StopPolicy()) -> Any:
    """Parameters of a stop policy as it begins, for their shapes: see `load_weights`."""
    graph = StopGraph(jnp.zeros((1, 3)), jnp.zeros((1, 1)))
    scene = make_scene(graph, jnp.zeros((1, 1)), jnp.zeros(1), jnp.zeros(3), jnp.zeros((1, 4)), jnp.ones(1, bool))
    return policy.init(jax.random.key(0), graph, scene, start(scene))
