"""The UR5e: forward kinematics by 4x4 matrices, inverse kinematics in closed form, and its capsules."""

import math
from typing import NamedTuple

import numpy as np

D = (0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996)  # m
A = (0.0, -0.425, -0.3922, 0.0, 0.0, 0.0)  # m
ALPHA = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
HOME = np.radians([-180.0, -80.0, 105.0, -155.0, -95.0, -180.0])
STOW = np.radians([-170.771, -79.755, 119.569, -129.814, -90.000, -80.771])
LOWER = np.array([-2.0, -2.0, -1.0, -2.0, -2.0, -2.0]) * math.pi
UPPER = -LOWER
MOUNT = (-0.299, -0.158, 0.92)  # of the arm's base frame in the mobile base's frame, m
BODY = (0.80, 0.50, 0.75)  # m
ELBOW_OFFSET, GRIPPER_LENGTH = 0.138, 0.20  # m
RADII = (0.06, 0.06, 0.06, 0.05, 0.05, 0.05, 0.05, 0.05)  # m, in the order of `capsules`


def pose(x, y, z, yaw):
    """The transform of a frame at (x, y, z), turned about z."""
    transform = rotation_z(yaw)
    transform[:3, 3] = x, y, z
    return transform


def rotation_z(angle):
    """A 4x4 rotation about z."""
    transform = np.eye(4)
    transform[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    return transform


def rotation_x(angle):
    """A 4x4 rotation about x."""
    transform = np.eye(4)
    transform[1:3, 1:3] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    return transform


def link(index, angle):
    """Transform of DH frame `index + 1` in DH frame `index`: Rz(angle) Tz(d) Tx(a) Rx(alpha)."""
    transform = rotation_z(angle)
    transform[:3, 3] = transform[:3, :3] @ (A[index], 0.0, D[index])
    return transform @ rotation_x(ALPHA[index])


def chain(joints):
    """The seven DH frames, from the arm's base to tool0, in the arm's base frame."""
    frames = [np.eye(4)]
    for index, angle in enumerate(joints):
        frames.append(frames[-1] @ link(index, angle))
    return frames


def pose_error(joints, target):
    """Position (m) and orientation (rad) error of tool0 at these joints."""
    tool = chain(joints)[-1]
    turn = tool[:3, :3].T @ target[:3, :3]
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.linalg.norm(tool[:3, 3] - target[:3, 3]), math.atan2(np.linalg.norm(axis), np.trace(turn) - 1.0)


class Branch(NamedTuple):
    """Which of the eight solutions."""

    shoulder: int  # 0 or 1, as the others
    wrist: int
    elbow: int


BRANCHES = tuple(Branch(s, w, e) for s in (0, 1) for w in (0, 1) for e in (0, 1))


def inverse_kinematics(target, branch: Branch):
    """Joints in (-pi, pi] on one branch; where the target is out of reach, the joints of a nearby pose."""
    wrist = target @ (0.0, 0.0, -D[5], 1.0)
    aside = math.acos(min(1.0, D[3] / max(math.hypot(wrist[0], wrist[1]), 1e-12)))
    q1 = math.atan2(wrist[1], wrist[0]) + math.pi / 2 + (aside if branch.shoulder else -aside)
    in_shoulder = np.linalg.inv(link(0, q1)) @ target
    q5 = math.acos(np.clip((in_shoulder[2, 3] - D[3]) / D[5], -1.0, 1.0)) * (1 if branch.wrist else -1)
    sine = math.copysign(max(abs(math.sin(q5)), 1e-12), q5)
    q6 = math.atan2(-in_shoulder[2, 1] / sine, in_shoulder[2, 0] / sine)
    in_forearm = in_shoulder @ np.linalg.inv(link(4, q5) @ link(5, q6))
    x, y = (in_forearm @ (0.0, -D[3], 0.0, 1.0))[:2]
    cosine = (x * x + y * y - A[1] ** 2 - A[2] ** 2) / (2 * A[1] * A[2])
    q3 = math.acos(np.clip(cosine, -1.0, 1.0)) * (1 if branch.elbow else -1)
    q2 = math.atan2(y, x) - math.atan2(A[2] * math.sin(q3), A[1] + A[2] * math.cos(q3))
    rest = np.linalg.inv(link(1, q2) @ link(2, q3)) @ in_forearm
    q4 = math.atan2(rest[1, 0], rest[0, 0])
    joints = np.array([q1, q2, q3, q4, q5, q6])
    return joints - 2 * math.pi * np.ceil((joints - math.pi) / (2 * math.pi))


def capsules(joints, base_pose):
    """Start and end of each capsule in W, (8, 2, 3)."""
    base = pose(base_pose[0], base_pose[1], 0.0, base_pose[2]) @ pose(*MOUNT, 0.0)
    frames = [base @ frame for frame in chain(joints)]
    origin = [frame[:3, 3] for frame in frames]
    shoulder, elbow = (origin[i] + ELBOW_OFFSET * frames[1][:3, 2] for i in (1, 2))
    tip = origin[6] + GRIPPER_LENGTH * frames[6][:3, 2]
    ends = [
        (origin[1], shoulder),
        (shoulder, elbow),
        (elbow, origin[2]),
        (origin[2], origin[3]),
        (origin[3], origin[4]),
        (origin[4], origin[5]),
        (origin[5], origin[6]),
        (origin[6], tip),
    ]
    return np.array(ends)
