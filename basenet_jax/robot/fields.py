"""The fields of the robot file, `basenet-robot/1`: everything about a mobile manipulator that its model can't say."""

from typing import Annotated, Any

from msgspec import UNSET, Meta, Struct, UnsetType, field

FORMAT = "basenet-robot/1"
MIN_JOINTS, MAX_JOINTS = 6, 8
MAX_CAPSULES = 64
GRASP_DEPTH_M = 0.25  # of the frame that objects' grasps are given for: so far before it fingers meet
CLOSED_FORMS = ("ur", "none")
SHAPES = ("collision", "visual")
DRIVES = ("differential", "omnidirectional")  # turn, drive, turn; or in any direction with the heading kept

# Bounds that any mobile manipulator keeps, and that a wrong unit breaks: millimetres, degrees per second.
_Position = Annotated[float, Meta(ge=-3, le=3)]
_Side = Annotated[float, Meta(ge=0.05, le=3)]
_Speed = Annotated[float, Meta(ge=0.01, le=20)]
_Acceleration = Annotated[float, Meta(ge=0.01, le=200)]
_BaseRate = Annotated[float, Meta(ge=0.01, le=10)]
_Degrees = Annotated[float, Meta(ge=-720, le=720)]
_Depth = Annotated[float, Meta(ge=0, le=0.6)]
_Tilt = Annotated[float, Meta(ge=0, le=180)]
_Radius = Annotated[float, Meta(ge=0.001, le=0.5)]
_Joints = Meta(min_length=MIN_JOINTS, max_length=MAX_JOINTS)
_Point = tuple[_Position, _Position, _Position]


class FramesFields(Struct, forbid_unknown_fields=True):
    """Names of sites or bodies (links) of the model."""

    arm_base: str
    tool: str | UnsetType = UNSET  # or tool.frame


class ToolFields(Struct, forbid_unknown_fields=True):
    """The tool frame from a frame of the model: its z has to point out of the gripper.

    It lies at `offset` (m, along the model's frame) and is turned by roll, pitch, yaw as in URDF. A rotation that is
    given, were it by nothing, is the owner's word for where the gripper points.
    """

    frame: str | UnsetType = UNSET  # or frames.tool
    rotation_rpy_degrees: tuple[_Degrees, _Degrees, _Degrees] | UnsetType = UNSET
    offset: _Point = (0.0, 0.0, 0.0)


class MountFields(Struct, forbid_unknown_fields=True):
    """The arm base frame in the base frame: m, and roll, pitch, yaw as in URDF."""

    position: _Point
    rpy_degrees: tuple[_Degrees, _Degrees, _Degrees] = (0.0, 0.0, 0.0)


class BoxFields(Struct, forbid_unknown_fields=True):
    """The box that the arm must not touch, in the base frame (m)."""

    center: _Point
    size: tuple[_Side, _Side, _Side]


class RateFields(Struct, forbid_unknown_fields=True):
    """Of the base: m/s and rad/s, or m/s^2 and rad/s^2."""

    linear: _BaseRate
    angular: _BaseRate


class BaseFields(Struct, forbid_unknown_fields=True):
    """The wheeled base: its frame is on the floor under the footprint's centre, x forward."""

    footprint: tuple[_Side, _Side]
    body: BoxFields
    speed: RateFields
    acceleration: RateFields


class DeckFields(Struct, forbid_unknown_fields=True):
    """Where picked objects go, a rectangle in the base frame (m)."""

    center: tuple[_Position, _Position]
    size: tuple[_Side, _Side]


class CapsuleFields(Struct, forbid_unknown_fields=True):
    """A capsule in the frame of a site or body of the model (m)."""

    frame: str
    start: _Point
    end: _Point
    radius: _Radius


class RobotFile(Struct, forbid_unknown_fields=True, kw_only=True):
    """The whole file."""

    format: str = FORMAT
    name: str
    model: str
    frames: FramesFields
    joints: Annotated[list[str], _Joints]
    closed_form: str | None = None
    drive: str = DRIVES[0]
    joint_speed: Annotated[list[_Speed], _Joints]
    joint_acceleration: Annotated[list[_Acceleration], _Joints]
    home_degrees: Annotated[list[_Degrees], _Joints]
    stow_degrees: Annotated[list[_Degrees], _Joints]
    stow_tilt_degrees: _Tilt = 0.0  # by how much the tool's z is off straight down at stow
    tool: ToolFields = field(default_factory=ToolFields)
    grasp_depth: _Depth = GRASP_DEPTH_M  # from the tool frame along its z to where the fingers meet
    mount: MountFields
    base: BaseFields
    deck: DeckFields
    fixed: dict[str, Any] = field(default_factory=dict)  # degrees or m, by joint
    shapes: str = SHAPES[0]  # which of the model's
    capsules: Annotated[list[CapsuleFields], Meta(max_length=MAX_CAPSULES)] = field(default_factory=list)


_COUNT = f"{MIN_JOINTS} to {MAX_JOINTS}"
_POINT = "is [x, y, z], three numbers (m)"
_LENGTH, _SIDE = "is a number from -3 to 3 (m)", "is a number from 0.05 to 3 (m)"
_ANGLE = "is a number from -720 to 720 (degrees, or m of a sliding joint)"
_RATE = "is a number from 0.01 to 10"

# By path, for messages.
ALLOWED = {
    "format": f"is {FORMAT!r}",
    "name": "is a text",
    "model": "is the path of an MJCF or URDF file in the robot file's folder",
    "frames": "is a mapping of arm_base and tool (or tool.frame)",
    "frames.arm_base": "is the name of a site or body (link) of the model",
    "frames.tool": "is the name of a site or body (link) of the model",
    "joints": f"is a list of {_COUNT} joint names, from arm base to tool (with fewer a gripper can't be held straight "
    "down, turned in any way, at any place; of more, freeze some under fixed)",
    "joints[]": "is a joint's name",
    "closed_form": "is ur or none, or no such key: arms that have one are recognised",
    "drive": f"is {' or '.join(DRIVES)}, or no such key",
    "joint_speed": f"is a list of {_COUNT} numbers, one for each joint (rad/s, or m/s)",
    "joint_speed[]": "is a number from 0.01 to 20 (rad/s, or m/s of a sliding joint)",
    "joint_acceleration": f"is a list of {_COUNT} numbers, one for each joint (rad/s^2, or m/s^2)",
    "joint_acceleration[]": "is a number from 0.01 to 200 (rad/s^2, or m/s^2 of a sliding joint)",
    "home_degrees": f"is a list of {_COUNT} numbers, one for each joint",
    "home_degrees[]": _ANGLE,
    "stow_degrees": f"is a list of {_COUNT} numbers, one for each joint",
    "stow_degrees[]": _ANGLE,
    "stow_tilt_degrees": "is a number from 0 to 180: how far the tool's z is from straight down at stow",
    "tool": "is a mapping of frame, rotation_rpy_degrees and offset, or no such key",
    "tool.frame": "is the name of a site or body (link) of the model, or no such key beside frames.tool",
    "tool.rotation_rpy_degrees": "is [roll, pitch, yaw], three numbers (degrees)",
    "tool.rotation_rpy_degrees[]": "is a number from -720 to 720 (degrees)",
    "tool.offset": _POINT,
    "tool.offset[]": _LENGTH,
    "grasp_depth": "is a number from 0 to 0.6 (m): from the tool frame to where the fingers meet",
    "mount": "is a mapping of position and, if turned, rpy_degrees",
    "mount.position": _POINT,
    "mount.position[]": _LENGTH,
    "mount.rpy_degrees": "is [roll, pitch, yaw], three numbers (degrees)",
    "mount.rpy_degrees[]": "is a number from -720 to 720 (degrees)",
    "base": "is a mapping of footprint, body, speed and acceleration",
    "base.footprint": "is [x, y], two numbers (m)",
    "base.footprint[]": _SIDE,
    "base.body": "is a mapping of center and size",
    "base.body.center": _POINT,
    "base.body.center[]": _LENGTH,
    "base.body.size": _POINT,
    "base.body.size[]": _SIDE,
    "base.speed": "is a mapping of linear (m/s) and angular (rad/s)",
    "base.speed.linear": f"{_RATE} (m/s)",
    "base.speed.angular": f"{_RATE} (rad/s)",
    "base.acceleration": "is a mapping of linear (m/s^2) and angular (rad/s^2)",
    "base.acceleration.linear": f"{_RATE} (m/s^2)",
    "base.acceleration.angular": f"{_RATE} (rad/s^2)",
    "deck": "is a mapping of center and size",
    "deck.center": "is [x, y], two numbers (m)",
    "deck.center[]": _LENGTH,
    "deck.size": "is [x, y], two numbers (m)",
    "deck.size[]": _SIDE,
    "fixed": "is a mapping of joints' names and where they stay (degrees, or m of a sliding joint), or no such key",
    "shapes": f"is {' or '.join(SHAPES)}, or no such key",
    "capsules": f"is a list of up to {MAX_CAPSULES} capsules, or no such key",
    "capsules[]": "is a mapping of frame, start, end and radius",
    "capsules[].frame": "is the name of a site or body (link) of the model",
    "capsules[].start": _POINT,
    "capsules[].start[]": _LENGTH,
    "capsules[].end": _POINT,
    "capsules[].end[]": _LENGTH,
    "capsules[].radius": "is a number from 0.001 to 0.5 (m)",
}
