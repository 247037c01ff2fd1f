"""The tool frame: a frame of the model, shifted and turned as the robot file says; and the 24 turns by right angles.

Objects' grasps are the same for every robot: they say where a frame is whose z points out of the gripper and whose
fingers meet `GRASP_DEPTH_M` along it. A robot whose own tool frame has them nearer or farther plans with a frame so
much behind or before its own.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from msgspec import UnsetType

from basenet_jax.documents.fields import field_error
from basenet_jax.robot.fields import GRASP_DEPTH_M, RobotFile

Turn = tuple[int, int, int]  # roll, pitch, yaw in degrees


class ToolPlace(NamedTuple):
    """How the frame that grasps are given for lies in a frame of the model."""

    field: str  # of the robot file, for messages
    frame: str  # a site or body
    rotation: Float[np.ndarray, "3 3"]
    position: Float[np.ndarray, "3"]  # m


def tool_place(file: RobotFile) -> ToolPlace:
    """The tool frame of a robot file.

    Raises:
        DocumentError: it names no frame, or two.
    """
    named = [
        (field, frame)
        for field, frame in (("frames.tool", file.frames.tool), ("tool.frame", file.tool.frame))
        if not isinstance(frame, UnsetType)
    ]
    if len(named) != 1:
        found = "nothing, and no tool.frame" if not named else "tool.frame beside it"
        raise field_error("frames.tool", found, "is the name of a site or body (link) of the model, in one of the two")
    turn = file.tool.rotation_rpy_degrees
    rotation = np.eye(3) if isinstance(turn, UnsetType) else from_rpy_degrees(turn)
    offset = np.array(file.tool.offset) + (file.grasp_depth - GRASP_DEPTH_M) * rotation[:, 2]
    return ToolPlace(*named[0], rotation, offset)


def from_rpy_degrees(angles: tuple[float, float, float]) -> Float[np.ndarray, "3 3"]:
    """Rz(yaw) Ry(pitch) Rx(roll), exact where an angle is 0."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(np.radians(angles)), np.cos(np.radians(angles))
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]]) @ pitch @ roll


def axis_turns() -> dict[Turn, Float[np.ndarray, "3 3"]]:
    """The 24 turns that put axes on axes, each by its simplest roll, pitch and yaw, simple ones first."""
    right = (0, 90, -90, 180)
    angles: list[Turn] = list(itertools.product(right, right, right))
    turns: dict[Turn, np.ndarray] = {}
    for each in sorted(angles, key=lambda each: (sum(map(abs, each)), np.count_nonzero(each))):
        rotation = np.round(from_rpy_degrees(each))
        if not any(np.array_equal(rotation, other) for other in turns.values()):
            turns[each] = rotation
    return turns


def nearest_turn(frame: Float[np.ndarray, "3 3"], direction: Float[np.ndarray, "3"]) -> tuple[Turn, float]:
    """The simplest turn of a frame that brings its z nearest to a direction, and how far off it then is (degrees)."""
    off = {turn: angle_degrees(frame @ rotation[:, 2], direction) for turn, rotation in axis_turns().items()}
    best = min(off, key=lambda turn: round(off[turn], 6))
    return best, off[best]


def angle_degrees(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> float:
    """Between two directions."""
    cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
