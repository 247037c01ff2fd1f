"""Whether the UR5e alone reaches a grasp of any orientation: every branch, and every equivalent of its joints."""

import math

import numpy as np

from tests.oracles import arm


def tool_pose(grasp):
    """A grasp (x, y, z, roll, pitch, yaw) as a transform: Rz(yaw) Ry(pitch) Rx(roll)."""
    x, y, z, roll, pitch, yaw = grasp
    about_y = np.eye(4)
    about_y[[0, 2], [0, 2]] = math.cos(pitch)
    about_y[0, 2], about_y[2, 0] = math.sin(pitch), -math.sin(pitch)
    return arm.pose(x, y, z, yaw) @ about_y @ arm.rotation_x(roll)


def reached(base_pose, grasp, lower=arm.LOWER, upper=arm.UPPER, slack=0.0):
    """Whether a solution within the limits (rad) misses by no more than 1 mm and 0.5 degrees, plus slack (m, rad)."""
    arm_base = arm.pose(base_pose[0], base_pose[1], 0.0, base_pose[2]) @ arm.pose(*arm.MOUNT, 0.0)
    target = np.linalg.inv(arm_base) @ tool_pose(grasp)
    for branch in arm.BRANCHES:
        joints = arm.inverse_kinematics(target, branch)
        equivalents = joints + 2 * math.pi * np.arange(-2, 3)[:, None]
        if not np.all(np.any((equivalents >= lower - slack) & (equivalents <= upper + slack), axis=0)):
            continue
        position, orientation = arm.pose_error(joints, target)
        if position <= 1e-3 + slack and orientation <= math.radians(0.5) + slack:
            return True
    return False
