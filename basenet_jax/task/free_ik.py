"""Inverse kinematics that keeps clear of obstacles, in batches, with another base for every element."""

import dataclasses

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.config import PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import pick
from basenet_jax.world.boxes import UNBOUNDED, Boxes, Room
from basenet_jax.world.grasps import Grasps


@struct.dataclass
class FreeIK:
    """Joints at which the tool is at a grasp and nothing is touched."""

    found: Bool[Array, "*batch"]
    joints: Float[Array, "*batch dof"]  # rad, or m; home where there are none
    grasp: Int[Array, "*batch"]  # which of the G grasps; -1 where there are none
    reason: Int[Array, "*batch"]  # a `Reason`: the rule at which no solution was left


def collision_free_ik(
    robot: Robot,
    boxes: Boxes,
    base_pose: Float[Array, "*batch 3"],
    grasps: Grasps,
    *,
    base_clearance: float = 0.0,
    itself: bool = True,
    config: PickConfig = PickConfig(),
) -> FreeIK:
    """Joints for grasps from base poses, among boxes; jit-, vmap- and shard-able.

    Of all branches of all grasps, and both ways to hold a symmetric gripper, the one that is reached soonest from home
    among those at which neither the arm touches a box, the robot's body or itself, nor the base a box. Arms without a
    closed form search from a lattice of seeds, and may miss a solution.

    Args:
        robot: the robot.
        boxes: obstacles in W, B for all or "*batch B"; those that block nothing pad.
        base_pose: (x, y, heading) in W.
        grasps: of tool0 in W, "*batch G"; `top_down` makes the simple ones.
        base_clearance: how far (m) the base must be from boxes; 0: it must not touch.
        itself: whether links that aren't neighbours, and the pedestal, must not touch.
        config: tolerances, symmetry of the gripper and how solutions are found.
    """
    there = dataclasses.replace(
        config,
        pregrasp_height_m=0.0,
        descent_heights_m=(),
        swept_points=0,
        base_clearance_m=base_clearance,
        object_in_the_way="off",
        arm_hits_itself="on" if itself else "off",
        near_singular="off",
    )
    floor = jnp.broadcast_to(jnp.asarray(UNBOUNDED), (*boxes.low.shape[:-1], 4))
    picks = pick(robot, base_pose, grasps, Room(boxes, floor), there)
    return FreeIK(picks.feasible, picks.joints[..., -1, :], picks.grasp, picks.reason)
