"""Where an arm's links are at given joints, in NumPy: for checks and pictures of single states."""

import numpy as np
from jaxtyping import Float

from basenet_jax.robot.model import Robot


def link_frames(robot: Robot, joints: Float[np.ndarray, " dof"]) -> Float[np.ndarray, "frames 4 4"]:
    """The arm's base, each link's frame and the tool's, in the base frame."""
    frames = [_matrix(robot.mount_rotation, robot.mount_position)]
    for index, joint in enumerate(joints):
        step = _matrix(robot.joint_rotation[index], robot.joint_position[index])
        motion = np.eye(4)
        if robot.prismatic[index]:
            motion[2, 3] = joint
        else:
            cosine, sine = np.cos(joint), np.sin(joint)
            motion[:2, :2] = [[cosine, -sine], [sine, cosine]]
        frames.append(frames[-1] @ step @ motion)
    return np.stack([*frames, frames[-1] @ _matrix(robot.tool_rotation, robot.tool_position)])


def _matrix(rotation, position) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = np.asarray(rotation), np.asarray(position)
    return result
