"""The paper's planner: the learned grasp sequence with the learned base poses, in one greedy rollout."""

import jax
from jax import Array

from basenet_jax.config import WorldConfig
from basenet_jax.devices import ONE_DEVICE, Devices, use_devices
from basenet_jax.planners.options import LearnedOptions
from basenet_jax.planners.protocol import PlannerSetup, PlanningError, in_parts
from basenet_jax.policies.pickup import as_plan, choose_learned, rollout
from basenet_jax.policies.trained import Weights, load_policies
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene

_BATCH = 1024  # scenes of one call of the compiled program on each device; more go in several calls


class BaSeNetPaper:
    """Plans by both learned policies.

    Raises:
        ValueError: the weights are missing, damaged, not of the networks that their file describes or for another
            robot; the message names them. Or (`PlanningError`) it is a room of several boxes.
    """

    def __init__(self, setup: PlannerSetup, options: LearnedOptions = LearnedOptions()):
        self._robot, self._world, self._devices = (
            setup.robot,
            setup.world,
            use_devices(options.devices or jax.local_device_count()),
        )
        if setup.drive_times is not None:
            raise PlanningError("drive_times: basenet-paper parks wherever its policy says; use basenet or refined")
        if setup.docked is not None:
            raise PlanningError("room: found several boxes, basenet-paper plans for one table; use basenet or refined")
        self._weights = load_policies(options.weights, setup.robot.name)

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored."""
        plans = _plan(self._robot, self._weights, jax.tree.map(lambda x: x[None], scene), key, self._world)
        return jax.tree.map(lambda x: x[0], plans)

    def plan_batch(self, scenes: Scene, key: Array) -> Plan:
        """See `BatchPlanner`; the key is ignored."""

        def plan_part(scenes: Scene, _: Array) -> Plan:
            return _plan(self._robot, self._weights, scenes, key, self._world, self._devices)

        keys = jax.random.split(key, len(scenes.mask))
        return in_parts(plan_part, scenes, keys, devices=self._devices, most=_BATCH)


@jax.jit(static_argnames=("world", "devices"))
def _plan(
    robot: Robot, weights: Weights, scenes: Scene, key: Array, world: WorldConfig, devices: Devices = ONE_DEVICE
) -> Plan:
    def plan(robot: Robot, weights: Weights, scenes: Scene, key: Array) -> Plan:
        choose = choose_learned(weights.sequence_network, weights.sequence, scenes)
        return as_plan(rollout(robot, scenes, weights.base_pose, choose, key, world))

    return devices.apart(plan, in_axes=(None, None, 0, None))(robot, weights, scenes, key)
