"""Arms like Universal Robots', recognised by their axes: whatever frames a model has, calibrated or turned.

Joints 2 to 4 turn about parallel axes; joint 1's is square to them and meets joint 2's; those of joints 4 and 5, and of
5 and 6, meet squarely. Such an arm has Denavit-Hartenberg frames in which the closed form holds, and each of its joints
differs from DH's by sense and offset alone. A calibrated arm is so only nearly: the closed form then gives seeds.
"""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from basenet_jax.robot.model import Robot, UrFrames

_SQUARE, _MEET_M = 0.03, 0.02  # rad and m: how far axes may be from square, parallel or meeting
_EXACT = 1e-6  # m and 1: what files round
_LINK_M = 0.05  # the shortest upper arm and forearm
_JOINTS = 6

Line = tuple[np.ndarray, np.ndarray]  # a point and a unit direction


def with_closed_form(robot: Robot) -> Robot:
    """The robot with the closed form that its arm has, in its own frames where these are DH's, and in others else."""
    if has_dh_frames(robot):
        return dataclasses.replace(robot, closed_form="ur", ur_frames=None)
    frames = find_ur_frames(robot)
    return dataclasses.replace(robot, closed_form=None if frames is None else "ur", ur_frames=frames)


def has_dh_frames(robot: Robot) -> bool:
    """Whether the joint frames are Universal Robots' DH frames, whatever the lengths: the closed form reads these."""
    one, quarter = np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # Rx(90 degrees)
    turns = (one, quarter, one, one, quarter, quarter.T, one)
    axes = ([], [2], [0], [0], [2], [2], [2])  # along which alone each frame, then the tool's, lies in the one before
    fits = robot.dof == len(turns) - 1 and not any(robot.prismatic)
    rotations = [*robot.joint_rotation, robot.tool_rotation]
    positions = [*robot.joint_position, robot.tool_position]
    for rotation, turn, position, axis in zip(rotations, turns, positions, axes, strict=False):
        offset = np.delete(position, axis)
        fits = fits and np.allclose(rotation, turn, atol=_EXACT) and np.allclose(offset, 0.0, atol=_EXACT)
    return fits


def find_ur_frames(robot: Robot) -> UrFrames | None:
    """The frames of a robot's arm in which the closed form holds, nearly at least; None where it has none."""
    if robot.dof != _JOINTS or any(robot.prismatic):
        return None
    frames = _frames_at_zero(robot)
    axes = [(frame[:3, 3], frame[:3, 2]) for frame in frames]
    z = [direction for _, direction in axes]
    square = [abs(z[a] @ z[b]) for a, b in ((0, 1), (3, 4), (4, 5))]
    skew = [np.linalg.norm(np.cross(z[1], z[k])) for k in (2, 3)]
    apart = [_nearest(axes[a], axes[b])[1] for a, b in ((0, 1), (3, 4), (4, 5))] if max(square) < 0.5 else [np.inf]
    if max(square) > _SQUARE or max(skew) > _SQUARE or max(apart) > _MEET_M:
        return None
    return _dh_frames(robot, axes, frames[-1])


def _dh_frames(robot: Robot, axes: list[Line], last: Float[np.ndarray, "4 4"]) -> UrFrames | None:
    """DH frames at zero: z along the model's axes, as square as DH's, and origins where axes meet."""
    z_0 = axes[0][1]
    m = _unit(axes[1][1] - (axes[1][1] @ z_0) * z_0)
    sense = [np.sign(axes[k][1] @ m) for k in (1, 2, 3)]
    shoulder, _ = _nearest(axes[0], axes[1])
    elbow, wrist_1 = (_beside(axes[k], shoulder, m) for k in (2, 3))
    z_4 = _unit(axes[4][1] - (axes[4][1] @ m) * m)
    z_5 = _unit(axes[5][1] - (axes[5][1] @ z_4) * z_4)
    meet_4, meet_5 = _nearest(axes[3], axes[4])[0], _nearest(axes[4], axes[5])[0]
    upper, fore = elbow - shoulder, wrist_1 - elbow
    a2, a3 = np.linalg.norm(upper), np.linalg.norm(fore)
    if min(a2, a3) < _LINK_M:
        return None
    x = [np.cross(z_0, m), upper / a2, fore / a3, np.cross(m, z_4), np.cross(z_5, z_4)]
    about = (m, m, m, z_4)
    angles = [0.0, *(_turn(a, b, axis) for a, b, axis in zip(x[:-1], x[1:], about, strict=True)), 0.0]
    end = np.eye(4)
    end[:3, :3], end[:3, 3] = np.stack([x[4], np.cross(z_5, x[4]), z_5], axis=1), meet_5
    flange = np.linalg.inv(last) @ end
    leaves: dict[str, Any] = {
        "lengths": np.array([0.0, a2, a3, (meet_4 - wrist_1) @ m, (meet_5 - meet_4) @ z_4, 0.0]),
        "base_rotation": np.stack([x[0], np.cross(z_0, x[0]), z_0], axis=1),
        "base_position": shoulder,
        "flange_rotation": flange[:3, :3],
        "flange_position": flange[:3, 3],
        "sense": np.array([1.0, *sense, 1.0, 1.0]),
        "offset": np.array(angles),
    }
    return UrFrames(**leaves)


def _frames_at_zero(robot: Robot) -> list[Float[np.ndarray, "4 4"]]:
    frames, at = [], np.eye(4)
    for rotation, position in zip(robot.joint_rotation, robot.joint_position, strict=True):
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = np.asarray(rotation), np.asarray(position)
        at = at @ step
        frames.append(at)
    return frames


def _beside(line: Line, point: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Where a line crosses the plane through a point; calibrated models have frames far out on their axes."""
    origin, direction = line
    return origin + ((point - origin) @ normal) / (direction @ normal) * direction


def _nearest(a: Line, b: Line) -> tuple[Float[np.ndarray, "3"], float]:
    """The middle between two lines that aren't parallel, where they are nearest, and how far apart they are there."""
    (p, u), (q, v) = a, b
    across = np.cross(u, v)
    square = across @ across
    on_a, on_b = (p + (np.cross(q - p, v) @ across) / square * u, q + (np.cross(q - p, u) @ across) / square * v)
    return 0.5 * (on_a + on_b), float(np.linalg.norm(on_a - on_b))


def _turn(a: np.ndarray, b: np.ndarray, axis: np.ndarray) -> float:
    """The angle from one direction to another about an axis that is square to both."""
    return float(np.arctan2(np.cross(a, b) @ axis, a @ b))


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
