"""Whether a robot file means what its owner thinks: the gripper points down over the deck where objects are put down.

A wrong tool frame, a stow pose beside the deck or angles in another unit all make plans, of a robot that nobody has.
"""

import numpy as np
from msgspec import UnsetType

from basenet_jax.config import PickConfig
from basenet_jax.documents.fields import DocumentError, field_error
from basenet_jax.robot.fields import GRASP_DEPTH_M, RobotFile
from basenet_jax.robot.model import Robot
from basenet_jax.robot.posture import link_frames
from basenet_jax.robot.rest import check_body
from basenet_jax.robot.tool import Turn, angle_degrees, from_rpy_degrees, nearest_turn

_DOWN = np.array([0.0, 0.0, -1.0])
_RADIANS = 6.4  # degrees: a little more than a whole turn in radians
_TILT = 5.0  # degrees that stow's tool may be off what the file says
_GRIPPER_M = 0.02  # a tool frame nearer to the last joint doesn't say where the gripper points
_ALONG, _ON_AXIS = 60.0, 30.0  # degrees between the tool's z and the way to it, or the last joint's axis
_BESIDE_M = 0.02  # that the fingers may be beside the deck
_SUNK_M = 0.1  # that they may be inside the body or below its top: many grippers are shorter than objects' grasps say
_FALL_M = 0.6  # that an object may fall at stow, gripper and object being of very different lengths


def set_up_faults(file: RobotFile, robot: Robot, config: PickConfig = PickConfig()) -> list[str]:
    """What is wrong with tool frame, home and stow, a line each: the field, what was found, what is allowed."""
    faults = []
    for check in (
        lambda: _check_units(file, robot),
        lambda: check_body(robot, config),
        lambda: _check_gripper(file, robot),
        lambda: _check_tilt(file, robot),
        lambda: _check_fingers(file, robot),
    ):
        try:
            check()
        except DocumentError as error:
            faults.append(str(error))
    return faults


def tool_tilt_degrees(robot: Robot) -> float:
    """Angle (degrees) between the tool's z at stow and straight down: 180 where it points up."""
    return angle_degrees(link_frames(robot, np.asarray(robot.stow))[-1, :3, 2], _DOWN)


def _check_units(file: RobotFile, robot: Robot) -> None:
    turning = ~np.array(robot.prismatic)
    for name in ("home_degrees", "stow_degrees"):
        values = np.abs(np.array(getattr(file, name))[turning])
        if np.any(values) and np.all(values <= _RADIANS):
            found = f"{getattr(file, name)}, no joint beyond {_RADIANS}°"
            raise field_error(name, found, "are degrees (are these radians? if not, turn some joint farther)")


def _check_gripper(file: RobotFile, robot: Robot) -> None:
    """That the tool's z runs along the gripper, as far as the model shows where that is, or the file says that it does.

    Nearly every arm's last joint turns the gripper about its own axis; else the gripper points away from that joint.
    """
    if not isinstance(file.tool.rotation_rpy_degrees, UnsetType):
        return
    rotation = np.asarray(robot.tool_rotation)
    away = np.asarray(robot.tool_position) - (file.grasp_depth - GRASP_DEPTH_M) * rotation[:, 2]
    axis = np.array([0.0, 0.0, 1.0])
    off = angle_degrees(rotation[:, 2], axis)
    if robot.prismatic[-1] or min(off, 180.0 - off) <= _ON_AXIS:
        return
    if np.linalg.norm(away) >= _GRIPPER_M:
        if angle_degrees(rotation[:, 2], away) <= _ALONG:
            return
        axis = away
    turn, _ = nearest_turn(rotation, axis)
    allowed = (
        f"is a frame whose z points out of the gripper. Write {_turned(file, turn)} if that is along the frame's "
        f"{_axis_name(turn)}, or tool: {{rotation_rpy_degrees: [0, 0, 0]}} if it is along its z"
    )
    found = f"a frame whose z lies {off:.0f}° off the last joint's axis and not along the way from that joint"
    raise field_error(_tool_field(file), found, allowed)


def _check_tilt(file: RobotFile, robot: Robot) -> None:
    tilt = tool_tilt_degrees(robot)
    if abs(tilt - file.stow_tilt_degrees) <= _TILT:
        return
    found = f"a tool frame whose z is {tilt:.0f}° off straight down at stow"
    said = file.stow_tilt_degrees
    allowed = f"is {said:g}° (to {_TILT:g}°), the tool's z pointing out of the gripper."
    present = file.tool.rotation_rpy_degrees
    own = np.eye(3) if isinstance(present, UnsetType) else from_rpy_degrees(present)
    at_stow = link_frames(robot, np.asarray(robot.stow))[-1, :3, :3] @ own.T
    turn, left = nearest_turn(at_stow, _DOWN)
    if left <= _TILT:
        allowed += f" Write {_turned(file, turn)} if the gripper points along the frame's {_axis_name(turn)}."
    allowed += f" Else change stow_degrees, or say that it is meant: stow_tilt_degrees: {tilt:.0f}"
    raise field_error(_tool_field(file), found, allowed)


def _check_fingers(file: RobotFile, robot: Robot) -> None:
    """At home and stow the fingers are outside of the body; at stow they are above the deck, and not far above."""
    center, half = np.asarray(robot.body_center), np.asarray(robot.body_half_size)
    top = center[2] + half[2]
    for name, joints in (("home", robot.home), ("stow", robot.stow)):
        frame = link_frames(robot, np.asarray(joints))[-1]
        fingers = frame[:3, 3] + GRASP_DEPTH_M * frame[:3, 2]
        where = f"fingers at ({fingers[0]:.2f}, {fingers[1]:.2f}, {fingers[2]:.2f}) in the base frame"
        if np.all(np.abs(fingers - center) < half - _SUNK_M):
            raise field_error(f"{name}_degrees", f"{where}, in the robot's body", "are joints with them outside of it")
        if name == "home":
            continue
        beside = np.max(np.abs(fingers[:2] - robot.deck[:2]) - np.asarray(robot.deck[2:]) / 2)
        if beside > _BESIDE_M:
            found = f"{where}, {beside:.2f} m beside the deck"
            raise field_error("stow_degrees", found, "are joints with them over the deck (or see deck, mount and tool)")
        if not -_SUNK_M <= fingers[2] - top <= _FALL_M:
            found = f"{where}, {abs(fingers[2] - top):.2f} m {'above' if fingers[2] > top else 'below'} the body's top"
            raise field_error("stow_degrees", found, f"are joints with them up to {_FALL_M} m above it")


def _tool_field(file: RobotFile) -> str:
    return "frames.tool" if isinstance(file.tool.frame, UnsetType) else "tool"


def _turned(file: RobotFile, turn: Turn) -> str:
    name = file.frames.tool if isinstance(file.tool.frame, UnsetType) else file.tool.frame
    return f"tool: {{frame: {name}, rotation_rpy_degrees: {list(turn)}}}"


def _axis_name(turn: Turn) -> str:
    """Which axis of the frame the turn makes its z."""
    z = np.round(from_rpy_degrees(turn)[:, 2])
    index = int(np.argmax(np.abs(z)))
    return f"{'-' if z[index] < 0 else ''}{'xyz'[index]}"
