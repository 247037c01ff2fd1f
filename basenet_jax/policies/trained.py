"""Trained policies: all layers as one pytree, from a run's weights file or those shipped with the package."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from basenet_jax import struct
from basenet_jax.policies.base_pose import BasePosePolicy, untrained_policy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.networks import read_networks
from basenet_jax.policies.stop_policy import StopPolicy, make_scene
from basenet_jax.policies.stop_rollout import start
from basenet_jax.robot.reading import DEFAULT_ROBOT
from basenet_jax.task.stop_problem import make_problem
from basenet_jax.weights_file import load_described

PACKAGED = "default.weights"


@struct.dataclass
class Weights:
    """All layers, as a run's `basenet.weights` holds them, and the networks that they are of."""

    base_pose: BasePosePolicy
    sequence: Any  # parameters of `sequence_network`
    stops: Any  # parameters of `stop_network`
    sequence_network: GraspSequencePolicy = struct.field(pytree_node=False, default=GraspSequencePolicy())
    stop_network: StopPolicy = struct.field(pytree_node=False, default=StopPolicy())


def load_policies(path: Path | None = None, robot: str = DEFAULT_ROBOT) -> Weights:
    """Trained policies, of the networks that their file describes; by default those shipped with the package.

    Args:
        path: of a run's `basenet.weights`.
        robot: name of the robot that they have to be trained for.

    Raises:
        ValueError: the file is missing or damaged, or its weights aren't those of the networks that it describes (or,
            where it describes none, of the presets'), or are for another robot; the message names it.
    """
    with _file(path) as (file, name):
        weights, metadata = load_described(file, _untrained)
        _check_robot(name, metadata, robot)
        return weights


def load_stops(path: Path | None = None, robot: str = DEFAULT_ROBOT) -> tuple[StopPolicy, Any]:
    """The trained stop policy, which needs no other layer: the network and its parameters.

    Args:
        path: of a run's `basenet.weights`, or of its `stops.weights` where only this layer was trained; by default the
            weights shipped with the package.
        robot: name of the robot that they have to be trained for.

    Raises:
        ValueError: see `load_policies`.
    """

    def like(metadata: dict[str, Any]) -> Any:
        return jax.eval_shape(lambda: untrained_stops(read_networks(metadata).stops.make()))

    with _file(path) as (file, name):
        stops, metadata = load_described(file, like, part="stops", or_alone=True)
        _check_robot(name, metadata, robot)
        return read_networks(metadata).stops.make(), stops


@contextmanager
def _file(path: Path | None) -> Iterator[tuple[Path, str]]:
    """The file, by default the package's, and what to call it."""
    if path is not None:
        yield path, str(path)
        return
    with as_file(files("basenet_jax.policies") / "weights" / PACKAGED) as packaged:
        yield packaged, "the weights shipped with the package"


def _untrained(metadata: dict[str, Any]) -> Weights:
    """All layers of the networks that a file describes, for their shapes."""
    networks = read_networks(metadata)
    sequence, stops = networks.sequence.make(), networks.stops.make()

    def make() -> Weights:
        base_pose = untrained_policy(networks.base_pose.hidden, networks.base_pose.frame)
        return Weights(base_pose, untrained_sequence(sequence), untrained_stops(stops), sequence, stops)

    return jax.eval_shape(make)


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
    nothing = jnp.zeros((1, 1))
    problem = make_problem(jnp.zeros((1, 3)), nothing, nothing, jnp.zeros(1), jnp.ones(1, bool))
    scene = make_scene(problem, jnp.zeros(3), jnp.zeros((1, 4)))
    return policy.init(jax.random.key(0), scene, start(scene))
