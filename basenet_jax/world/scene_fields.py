"""The fields of the scene file, `basenet-scene/1`."""

from typing import Annotated

import jax
import numpy as np
from msgspec import UNSET, Meta, Struct, UnsetType, field

from basenet_jax.config import TableConfig
from basenet_jax.world.boxes import Room
from basenet_jax.world.scene import MAX_OBJECTS, OBJECT_CLASSES, ObjectClass, Scene

FORMAT = "basenet-scene/1"
CLASSES = {kind.name: kind for kind in OBJECT_CLASSES}

# Bounds far beyond any real scene, within which float32 keeps tenths of a millimetre and milliradians.
_Position = Annotated[float, Meta(ge=-100, le=100)]
_Angle = Annotated[float, Meta(ge=-6.3, le=6.3)]  # a turn, which degrees go beyond
_ObjectSide = Annotated[float, Meta(ge=0.001, le=2)]
_TableSide = Annotated[float, Meta(ge=0.1, le=3)]  # farther sides leave the planning grid no room
_TableHeight = Annotated[float, Meta(ge=0.01, le=3)]
_GraspOffset = Annotated[float, Meta(ge=-2, le=2)]
_Pose = tuple[_Position, _Position, _Angle]


class TableFields(Struct, forbid_unknown_fields=True):
    """The table's sides along x and y, and the height of its top (m)."""

    size: tuple[_TableSide, _TableSide] = (TableConfig().length_m, TableConfig().width_m)
    height: _TableHeight = TableConfig().height_m


class RobotFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """The robot's name (none: the default one, or any that is asked for), and where it starts: x, y, heading in W."""

    model: str | UnsetType = UNSET
    start: _Pose


class GraspFields(Struct, forbid_unknown_fields=True):
    """tool0 in the object's frame at the grasp (m, rad)."""

    x: _GraspOffset
    z: _GraspOffset
    yaw: _Angle


class ObjectFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """One object: of a class, or with its own size (m) and grasp."""

    name: str
    class_: str | UnsetType = field(name="class", default=UNSET)
    pose: _Pose
    size: tuple[_ObjectSide, _ObjectSide, _ObjectSide] | UnsetType = UNSET
    grasp: GraspFields | UnsetType = UNSET


class SceneFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """The whole file."""

    format: str = FORMAT
    table: TableFields = field(default_factory=TableFields)
    robot: RobotFields
    objects: Annotated[list[ObjectFields], Meta(min_length=1, max_length=MAX_OBJECTS)]


# By path, for messages.
ALLOWED = {
    "format": "is 'basenet-scene/1' or 'basenet-scene/2'",
    "table": "is a mapping of size and height, or no such key",
    "table.size": "is [x, y], two numbers (m)",
    "table.size[]": "is a number from 0.1 to 3 (m)",
    "table.height": "is a number from 0.01 to 3 (m)",
    "robot": "is a mapping with start",
    "robot.model": "is a robot's name, or no such key",
    "robot.start": "is [x, y, heading], three numbers (m, m, rad)",
    "robot.start[]": "is a number from -100 to 100 (m), and the angle from -6.3 to 6.3 (rad; degrees?)",
    "objects": f"is a list of 1 to {MAX_OBJECTS} objects",
    "objects[]": "is a mapping with name, pose, and class or size and grasp",
    "objects[].name": "is a text",
    "objects[].class": "is a class's name, or no such key beside size and grasp",
    "objects[].pose": "is [x, y, yaw], three numbers (m, m, rad)",
    "objects[].pose[]": "is a number from -100 to 100 (m), and the angle from -6.3 to 6.3 (rad; degrees?)",
    "objects[].size": "is [x, y, z], three numbers (m)",
    "objects[].size[]": "is a number from 0.001 to 2 (m)",
    "objects[].grasp": "is a mapping of x, z (m) and yaw (rad)",
    "objects[].grasp.x": "is a number from -2 to 2 (m)",
    "objects[].grasp.z": "is a number from -2 to 2 (m)",
    "objects[].grasp.yaw": "is a number from -6.3 to 6.3 (rad; is it in degrees?)",
}


def size_of(item: ObjectFields) -> tuple[float, float, float]:
    """The size (m) of an object, its own or its class's."""
    return CLASSES[str(item.class_)].size if item.size is UNSET else item.size


def grasp_of(item: ObjectFields) -> tuple[float, float, float]:
    """tool0's x, z (m) and yaw (rad) in the object's frame, the object's own or its class's."""
    if isinstance(item.grasp, UnsetType):
        kind = CLASSES[str(item.class_)]
        return kind.grasp_x, kind.grasp_z, kind.grasp_yaw
    return item.grasp.x, item.grasp.z, item.grasp.yaw


def class_of(arrays: Scene, slot: int, *, sides: bool) -> ObjectClass | None:
    """The packaged class of an object; None: it has none, or its size or a grasp is another than its class's.

    Args:
        arrays: of the scene, on the host.
        slot: the object's.
        sides: whether classes have their side grasps.
    """
    kind = OBJECT_CLASSES[index] if (index := int(arrays.object_class[slot])) >= 0 else None
    if kind is None:
        return None
    size, own = np.asarray(arrays.object_size[slot]), arrays.object_grasps[slot]
    same = jax.tree.map(np.array_equal, own[np.asarray(own.there)], kind.grasps(sides=sides))
    return kind if np.array_equal(size, np.array(kind.size, np.float32)) and all(jax.tree.leaves(same)) else None


def make_room(table: TableFields) -> Room:
    """The table's room in float32, on the host."""
    return Room.of_table(np.array(table.size, np.float32) / 2, np.float32(table.height), np)
