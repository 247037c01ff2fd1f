"""The fields of a room's scene file, `basenet-scene/2`."""

from typing import Annotated

from msgspec import UNSET, Meta, Struct, UnsetType, field

from basenet_jax.config import MAX_OBJECTS
from basenet_jax.world.furniture import MAX_BOXES, Furniture, Pose
from basenet_jax.world.scene_fields import RobotFields

ROOM_FORMAT = "basenet-scene/2"
DRIVES = ("docked", "point")
MAX_GRASPS = 200  # of an object

_Offset = Annotated[float, Meta(ge=-2, le=2)]
_Degrees = Annotated[float, Meta(ge=-6000, le=6000)]
_ObjectSide = Annotated[float, Meta(ge=0.001, le=2)]


class GraspPoseFields(Struct, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """The tool in the object's frame (m, degrees), how it comes there and may be turned, and how good the grasp is."""

    position: tuple[_Offset, _Offset, _Offset]
    rpy_degrees: tuple[_Degrees, _Degrees, _Degrees]  # R = Rz(yaw) Ry(pitch) Rx(roll)
    approach: Annotated[float, Meta(ge=0.001, le=1)] | UnsetType = UNSET
    symmetric: bool = True
    score: float | UnsetType = UNSET


class ToolFrameFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """The frame that grasps are given of, in tool0 (m, degrees)."""

    position: tuple[_Offset, _Offset, _Offset]
    rpy_degrees: tuple[_Degrees, _Degrees, _Degrees]


class RoomObjectFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """One object: of a class, or with its own size (m) and grasps."""

    name: str
    class_: str | UnsetType = field(name="class", default=UNSET)
    on: str | UnsetType = UNSET  # the surface's name
    pose: Pose
    size: tuple[_ObjectSide, _ObjectSide, _ObjectSide] | UnsetType = UNSET
    grasps: Annotated[list[GraspPoseFields], Meta(min_length=1, max_length=MAX_GRASPS)] | str | UnsetType = UNSET
    tool_frame: ToolFrameFields | UnsetType = UNSET


class RoomFields(Furniture, forbid_unknown_fields=True, kw_only=True):
    """The whole file."""

    format: str
    robot: RobotFields
    objects: Annotated[list[RoomObjectFields], Meta(min_length=1, max_length=MAX_OBJECTS)]


_POSE = "is [x, y, yaw], three numbers (m, m, rad)"
_POSE_NUMBER = "is a number from -100 to 100 (m), and the angle from -6.3 to 6.3 (rad; degrees?)"

# By path, for messages.
ALLOWED = {
    "format": f"is {ROOM_FORMAT!r}",
    "floor": "is [x_min, y_min, x_max, y_max], four numbers (m), or no such key",
    "floor[]": "is a number from -100 to 100 (m)",
    "map": "is the name of a map_server file, or no such key",
    "surfaces": f"is a list of 1 to {MAX_BOXES} surfaces",
    "surfaces[]": "is a mapping with name, pose, size and height",
    "surfaces[].name": "is a text",
    "surfaces[].pose": _POSE,
    "surfaces[].pose[]": _POSE_NUMBER,
    "surfaces[].size": "is [x, y], two numbers (m)",
    "surfaces[].size[]": "is a number from 0.1 to 20 (m)",
    "surfaces[].height": "is a number from 0.01 to 3 (m)",
    "surfaces[].thickness": "is a number from 0.001 to 3 (m), or no such key",
    "obstacles": f"is a list of up to {MAX_BOXES} boxes, or no such key",
    "obstacles[]": "is a mapping with name, pose and size",
    "obstacles[].name": "is a text",
    "obstacles[].pose": _POSE,
    "obstacles[].pose[]": _POSE_NUMBER,
    "obstacles[].size": "is [x, y, z], three numbers (m)",
    "obstacles[].size[]": "is a number from 0.01 to 100 (m)",
    "obstacles[].z": "is a number from 0 to 10 (m), or no such key",
    "walls": f"is a list of up to {MAX_BOXES} walls, or no such key",
    "walls[]": "is a mapping with name, points, thickness and height",
    "walls[].name": "is a text",
    "walls[].points": f"is a list of 2 to {MAX_BOXES + 1} points",
    "walls[].points[]": "is [x, y], two numbers (m)",
    "walls[].points[][]": "is a number from -100 to 100 (m)",
    "walls[].thickness": "is a number from 0.001 to 3 (m)",
    "walls[].height": "is a number from 0.01 to 100 (m)",
    "keep_out": f"is a list of up to {MAX_BOXES} rectangles, or no such key",
    "keep_out[]": "is a mapping with name, pose and size",
    "keep_out[].name": "is a text",
    "keep_out[].pose": _POSE,
    "keep_out[].pose[]": _POSE_NUMBER,
    "keep_out[].size": "is [x, y], two numbers (m)",
    "keep_out[].size[]": "is a number from 0.01 to 100 (m)",
    "robot": "is a mapping with start",
    "robot.model": "is a robot's name, or no such key",
    "robot.start": "is [x, y, heading], three numbers (m, m, rad)",
    "robot.start[]": _POSE_NUMBER,
    "drives": f"is {' or '.join(DRIVES)}, or no such key",
    "clutter": "is true or false, or no such key",
    "objects": f"is a list of 1 to {MAX_OBJECTS} objects",
    "objects[]": "is a mapping with name, pose, and class or size and grasps",
    "objects[].name": "is a text",
    "objects[].class": "is a class's name, or no such key beside size and grasps",
    "objects[].on": "is the name of a surface, or no such key where one alone is under the object",
    "objects[].pose": _POSE,
    "objects[].pose[]": _POSE_NUMBER,
    "objects[].size": "is [x, y, z], three numbers (m)",
    "objects[].size[]": "is a number from 0.001 to 2 (m)",
    "objects[].grasps": f"is a list of 1 to {MAX_GRASPS} grasps, or the name of a file",
    "objects[].grasps[]": "is a mapping with position and rpy_degrees",
    "objects[].grasps[].position": "is [x, y, z], three numbers (m)",
    "objects[].grasps[].position[]": "is a number from -2 to 2 (m)",
    "objects[].grasps[].rpy_degrees": "is [roll, pitch, yaw], three numbers (degrees)",
    "objects[].grasps[].rpy_degrees[]": "is a number from -6000 to 6000 (degrees)",
    "objects[].grasps[].approach": "is a number from 0.001 to 1 (m), or no such key",
    "objects[].grasps[].symmetric": "is true or false, or no such key",
    "objects[].grasps[].score": "is a number, the more the better, or no such key",
    "objects[].tool_frame": "is a mapping with position and rpy_degrees, or no such key",
    "objects[].tool_frame.position": "is [x, y, z], three numbers (m)",
    "objects[].tool_frame.position[]": "is a number from -2 to 2 (m)",
    "objects[].tool_frame.rpy_degrees": "is [roll, pitch, yaw], three numbers (degrees)",
    "objects[].tool_frame.rpy_degrees[]": "is a number from -6000 to 6000 (degrees)",
}
