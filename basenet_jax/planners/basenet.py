"""The paper's planner: the learned grasp sequence with the learned base poses, in one greedy rollout."""

from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from basenet_jax.config import ReinforceConfig, SacConfig, WorldConfig
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.policies.base_pose import BasePosePolicy, untrained_policy
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.pickup import PickupState, as_plan, rollout
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Plan
from basenet_jax.weights_file import load_weights
from basenet_jax.world.scene import Scene

PACKAGED = "default.weights"


class PolicyWeights(NamedTuple):
    """Both trained layers, as a run's `basenet.weights` holds them."""

    base_pose: BasePosePolicy
    sequence: Any  # parameters of `GraspSequencePolicy`


class BaSeNet:
    """Plans by both learned policies.

    Raises:
        ValueError: the weights are missing, damaged or of other networks; the message names the file.
    """

    def __init__(self, setup: PlannerSetup):
        self._robot = setup.robot
        self._weights = load_policies(setup.weights)
        self._world = setup.world

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored."""
        return _plan(self._robot, self._weights, scene, key, self._world)


def load_policies(path: Path | None = None) -> PolicyWeights:
    """Trained policies from a run's `basenet.weights`; by default those shipped with the package.

    Raises:
        ValueError: the file is missing, damaged or holds other networks' weights; the message names it.
    """
    if path is not None:
        return load_weights(path, jax.eval_shape(_untrained))[0]
    with as_file(files("basenet_jax.policies") / "weights" / PACKAGED) as packaged:
        return load_weights(packaged, jax.eval_shape(_untrained))[0]


def _untrained() -> PolicyWeights:
    """Weights of the presets' sizes; only their shapes matter."""
    nothing = jnp.zeros((1, 4)), jnp.zeros(3), jnp.ones(1, bool)
    sequence = _network().init(jax.random.key(0), *nothing)
    return PolicyWeights(untrained_policy(SacConfig().hidden), sequence)


def _network() -> GraspSequencePolicy:
    config = ReinforceConfig()
    return GraspSequencePolicy(config.features, config.layers, config.attention)


@jax.jit(static_argnames="world")
def _plan(robot: Robot, weights: PolicyWeights, scene: Scene, key: Array, world: WorldConfig) -> Plan:
    batch = jax.tree.map(lambda x: x[None], scene)

    def choose(state: PickupState, key: Array) -> Array:
        del key
        logits = _network().apply(weights.sequence, batch.grasps, state.robot_pose, state.remaining)
        return jnp.argmax(jnp.asarray(logits), axis=-1)

    steps = rollout(robot, batch, weights.base_pose, choose, key, world)
    return jax.tree.map(lambda x: x[0], as_plan(steps))
