"""Which objects the gripper itself touches at a grasp, wherever the base stands and however the arm gets there.

They are in the way of every arm solution of that grasp. Known for a scene's few grasps, they spare looking at the many
solutions of its many pairs of base pose and object that can't be of use any more.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.config import PickConfig
from basenet_jax.robot.distances import segment_box_distance
from basenet_jax.robot.model import Robot
from basenet_jax.task.arm_solutions import axes, heights, turns
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.boxes import Boxes
from basenet_jax.world.grasps import Grasps

_SLACK_M = 5e-3  # more than a converged solution's errors of position and orientation move the gripper


def gripper_blockers(
    robot: Robot, grasps: Grasps, boxes: Boxes, config: PickConfig = PickConfig()
) -> Bool[Array, "M G T N"]:
    """For each of an object's G grasps and T ways to turn the gripper, the boxes that it must touch on the way down.

    Args:
        robot: the capsules of its last link are the gripper's.
        grasps: of M objects in W, "M G".
        boxes: N of them in W.
        config: of the approach.
    """
    x, y, z, roll, pitch, yaw = (jnp.asarray(grasps.pose)[..., axis] for axis in range(6))
    own = jnp.where(grasps.approach > 0, grasps.approach / (config.pregrasp_height_m or 1.0), 1.0)
    last = np.flatnonzero(np.array(robot.capsule_link) == robot.dof)
    in_tool = [(points[last] - robot.tool_position) @ robot.tool_rotation for points in _ends(robot)]
    frame, origin = axes(roll, pitch, yaw), (x, y, z)
    sine, cosine = sin_cos(boxes.pose[:, 2])
    half = (*boxes.half_size.T, 0.5 * (boxes.high - boxes.low))
    center = (*boxes.pose[:, :2].T, 0.5 * (boxes.high + boxes.low))
    radius = robot.capsule_radius[last] - _SLACK_M

    def in_box(point: Float[Array, "capsules 3"], turn: Array, height: Array) -> tuple[Array, ...]:
        """One end of each capsule in each box's frame, "M G capsules N"."""
        turn_sine, turn_cosine = sin_cos(turn)
        local = (
            turn_cosine * point[:, 0] - turn_sine * point[:, 1],
            turn_sine * point[:, 0] + turn_cosine * point[:, 1],
            point[:, 2] - (own * height)[..., None],
        )
        world = [
            origin[k][..., None] + sum((frame[axis][k][..., None] * local[axis] for axis in range(3)), jnp.zeros(()))
            for k in range(3)
        ]
        along, across, up = (world[k][..., None] - center[k] for k in range(3))
        return cosine * along + sine * across, cosine * across - sine * along, up

    def touches(at: tuple[Array, Array]) -> Bool[Array, "M G N"]:
        start, end = (in_box(point, *at) for point in in_tool)
        distance = segment_box_distance(start, end, tuple(jnp.broadcast_to(h, start[0].shape) for h in half))
        return jnp.any(distance <= radius[:, None], axis=2)

    ways_to_turn, steps = np.arange(turns(config)) * np.pi, heights(config)
    each = (np.repeat(ways_to_turn, len(steps)), np.tile(steps, len(ways_to_turn)))
    found = jax.lax.map(touches, tuple(jnp.asarray(part, x.dtype) for part in each))
    found = jnp.any(found.reshape(len(ways_to_turn), len(steps), *found.shape[1:]), axis=1)
    return jnp.moveaxis(found, 0, 2) & boxes.blocks_arm


def _ends(robot: Robot) -> tuple[Array, Array]:
    return jnp.asarray(robot.capsule_start), jnp.asarray(robot.capsule_end)
