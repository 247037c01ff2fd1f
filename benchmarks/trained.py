"""Trained policies from weights files, for benchmarks that need them; untrained ones of the same size otherwise."""

from pathlib import Path
from typing import Any, NamedTuple

import jax
from jax import Array

from basenet_jax.learning.config import TrainConfig, make_preset
from basenet_jax.learning.training import Training
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.policies.trained import Weights, untrained_stops
from basenet_jax.weights_file import load_weights
from benchmarks.environment import fingerprint


class Trained(NamedTuple):
    """All layers, the training they are of, and what identifies them in results."""

    training: Training
    weights: Weights
    source: dict[str, Any]


def load_basenet(path: Path) -> Trained:
    """Reads all layers from a run's `weights/basenet.weights`.

    Raises:
        ValueError: the file is missing, damaged or of other networks than the package's presets.
    """
    weights, metadata = load_weights(path, jax.eval_shape(_fresh(Training(TrainConfig())), jax.random.key(0)))
    config = make_preset(metadata["preset"], objects=metadata["objects"], seed=metadata["seed"])
    return Trained(Training(config), weights, fingerprint(path) | {"metadata": metadata})


def untrained_basenet(training: Training, key: Array) -> Trained:
    """Fresh networks, of which only the speed means anything."""
    return Trained(training, jax.jit(_fresh(training))(key), {"file": None})


def load_base_pose(path: Path | None, training: Training, key: Array) -> tuple[BasePosePolicy, dict[str, Any]]:
    """The policy of a run's `weights/base_pose.weights`, or a fresh one without a path; and what identifies it.

    Raises:
        ValueError: see `load_basenet`.
    """

    def fresh(key: Array) -> BasePosePolicy:
        return training.sac.policy(training.sac.init(key))

    if path is None:
        return jax.jit(fresh)(key), {"file": None}
    policy, metadata = load_weights(path, jax.eval_shape(fresh, key))
    return policy, fingerprint(path) | {"metadata": metadata}


def _fresh(training: Training):
    def fresh(key: Array) -> Weights:
        base_pose = training.sac.policy(training.sac.init(key))
        return Weights(base_pose, training.reinforce(base_pose).init(key).params, untrained_stops())

    return fresh
