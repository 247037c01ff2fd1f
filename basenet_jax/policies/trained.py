"""Trained policies: all layers as one pytree, from a run's weights file or those shipped with the package."""

import dataclasses
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from basenet_jax.policies.base_pose import BasePosePolicy, untrained_policy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.stop_policy import StopGraph, StopPolicy, make_scene
from basenet_jax.policies.stop_rollout import start
from basenet_jax.robot.reading import DEFAULT_ROBOT
from basenet_jax.weights_file import load_weights

PACKAGED = "default.weights"
_HIDDEN = (256, 256, 256)  # of the base-pose policy


class Weights(NamedTuple):
    """All layers, as a run's `basenet.weights` holds them."""

    base_pose: BasePosePolicy
    sequence: Any  # parameters of `GraspSequencePolicy`
    stops: Any  # parameters of `StopPolicy`


def load_policies(path: Path | None = None, robot: str = DEFAULT_ROBOT) -> Weights:
    """Trained policies of the presets' sizes; by default those shipped with the package.

    Args:
        path: of a run's `basenet.weights`.
        robot: name of the robot that they have to be trained for.

    Raises:
        ValueError: the file is missing or damaged, or holds the weights of other networks or for another robot; the
            message names it.
    """
    like = jax.eval_shape(lambda: Weights(untrained_policy(_HIDDEN), untrained_sequence(), untrained_stops()))
    if path is not None:
        weights, metadata = load_weights(path, like)
        _check_robot(str(path), metadata, robot)
        frame = metadata.get("base_pose_frame", "object")  # older files are all of the object's
        return weights._replace(base_pose=dataclasses.replace(weights.base_pose, frame=frame))
    with as_file(files("basenet_jax.policies") / "weights" / PACKAGED) as packaged:
        weights, metadata = load_weights(packaged, like)
        _check_robot("the weights shipped with the package", metadata, robot)
        return weights


def load_stops(path: Path | None = None, robot: str = DEFAULT_ROBOT) -> Any:
    """The parameters of the trained stop policy, which needs no other layer.

    Args:
        path: of a run's `basenet.weights`, or of its `stops.weights` where only this layer was trained; by default the
            weights shipped with the package.
        robot: name of the robot that they have to be trained for.

    Raises:
        ValueError: see `load_policies`.
    """
    like = jax.eval_shape(untrained_stops)
    if path is None:
        with as_file(files("basenet_jax.policies") / "weights" / PACKAGED) as packaged:
            stops, metadata = load_weights(packaged, like, part="stops")
        _check_robot("the weights shipped with the package", metadata, robot)
        return stops
    try:
        stops, metadata = load_weights(path, like)
    except ValueError:  # not this layer alone
        stops, metadata = load_weights(path, like, part="stops")
    _check_robot(str(path), metadata, robot)
    return stops


def _check_robot(source: str, metadata: dict[str, Any], robot: str) -> None:
    if metadata.get("robot") != robot:
        raise ValueError(
            f"{source}: found weights for the robot {metadata.get('robot')!r}, needed are some for {robot!r}:"
            " train them (python -m basenet_jax.train --robot) and give the run's weights/basenet.weights as --weights,"
            " or take a planner that needs none: pbg, pbg-gc, mbp, mbp-gc, dp, greedy-stops, refined"
        )


def untrained_sequence(network: GraspSequencePolicy = GraspSequencePolicy()) -> Any:
    """Parameters of a sequence policy as it begins, for their shapes: see `load_weights`."""
    return network.init(jax.random.key(0), jnp.zeros((1, 4)), jnp.zeros(3), jnp.ones(1, bool))


def untrained_stops(policy: StopPolicy = StopPolicy()) -> Any:
    """Parameters of a stop policy as it begins, for their shapes: see `load_weights`."""
    graph = StopGraph(jnp.zeros((1, 3)), jnp.zeros((1, 1)))
    scene = make_scene(graph, jnp.zeros((1, 1)), jnp.zeros(1), jnp.zeros(3), jnp.zeros((1, 4)), jnp.ones(1, bool))
    return policy.init(jax.random.key(0), graph, scene, start(scene))
