"""What stands in a room, as its file says it, and as boxes."""

import math
from typing import Annotated, Any

import jax
import numpy as np
from msgspec import UNSET, Meta, Struct, UnsetType

from basenet_jax.world.boxes import UNBOUNDED, Boxes, Room, pad

MAX_BOXES = 256  # that are written; a map's come on top
_FEWEST = 16  # boxes, with those that pad; more are padded to powers of two, so that rooms share programs
MAP = "map"  # what all boxes of a map are called
FLAT_M = 0.01  # height of boxes that say nothing of heights: on the floor, any box blocks the base

# Bounds far beyond any real room, within which float32 keeps tenths of a millimetre and milliradians.
Position = Annotated[float, Meta(ge=-100, le=100)]
Angle = Annotated[float, Meta(ge=-6.3, le=6.3)]  # a turn, which degrees go beyond
Pose = tuple[Position, Position, Angle]
_Side = Annotated[float, Meta(ge=0.01, le=100)]
_Thin = Annotated[float, Meta(ge=0.001, le=3)]
_SurfaceSide = Annotated[float, Meta(ge=0.1, le=20)]
_SurfaceHeight = Annotated[float, Meta(ge=0.01, le=3)]
_Underside = Annotated[float, Meta(ge=0, le=10)]


class SurfaceFields(Struct, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """What bears objects: its pose in W, sides, and height of its top; solid to the floor without a thickness (m)."""

    name: str
    pose: Pose
    size: tuple[_SurfaceSide, _SurfaceSide]
    height: _SurfaceHeight
    thickness: _Thin | UnsetType = UNSET


class ObstacleFields(Struct, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """Any other box; `z` is the height of its underside (m)."""

    name: str
    pose: Pose
    size: tuple[_Side, _Side, _Side]
    z: _Underside = 0.0


class WallFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """A wall along the centre line through some points (x, y in W)."""

    name: str
    points: Annotated[list[tuple[Position, Position]], Meta(min_length=2, max_length=MAX_BOXES + 1)]
    thickness: _Thin
    height: _Side


class KeepOutFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """A rectangle of the floor that isn't to be driven on."""

    name: str
    pose: Pose
    size: tuple[_Side, _Side]


class Furniture(Struct, forbid_unknown_fields=True, kw_only=True):
    """A room without its objects and where the robot starts, and by which rules one drives and picks in it."""

    floor: tuple[Position, Position, Position, Position] | UnsetType = UNSET  # x_min, y_min, x_max, y_max
    map: str | UnsetType = UNSET
    surfaces: Annotated[list[SurfaceFields], Meta(min_length=1, max_length=MAX_BOXES)]
    obstacles: Annotated[list[ObstacleFields], Meta(max_length=MAX_BOXES)] = []
    walls: Annotated[list[WallFields], Meta(max_length=MAX_BOXES)] = []
    keep_out: Annotated[list[KeepOutFields], Meta(max_length=MAX_BOXES)] = []
    drives: str = "docked"
    clutter: bool = True


def furnish(furniture: Furniture, map_boxes: Boxes | None = None) -> tuple[Room, tuple[str, ...]]:
    """The room in float32, on the host, and its boxes' names.

    Surfaces come first and in their order, then obstacles, pieces of walls (`north[0]`, `north[1]`, ... of `north`),
    rectangles to keep out of, and those of the map, which are all called `map`. More boxes, without names, pad: the
    paper's world alone, in which drives are of a point, is a room of one box.
    """
    boxes, names = written_boxes(furniture)
    if map_boxes is not None:
        boxes = jax.tree.map(lambda *parts: np.concatenate(parts), boxes, map_boxes)
        names += [MAP] * len(map_boxes.low)
    if furniture.drives != "point" or len(names) > 1:
        boxes = pad(boxes, max(_FEWEST, 1 << (len(names) - 1).bit_length()))
    floor = UNBOUNDED if isinstance(furniture.floor, UnsetType) else furniture.floor
    bounds: Any = np.array(floor, np.float32)
    return Room(boxes, bounds, furniture.clutter), tuple(names)


def written_boxes(furniture: Furniture) -> tuple[Boxes, list[str]]:
    """The boxes of `furnish` without a map's, and their names."""
    rows, names = [], []
    for each in furniture.surfaces:
        low = 0.0 if isinstance(each.thickness, UnsetType) else each.height - each.thickness
        rows.append((*each.pose, *each.size, low, each.height, True, True))
        names.append(each.name)
    for each in furniture.obstacles:
        rows.append((*each.pose, *each.size[:2], each.z, each.z + each.size[2], True, False))
        names.append(each.name)
    for wall in furniture.walls:
        pieces = [_piece(wall, index) for index in range(len(wall.points) - 1)]
        rows += pieces
        names += [wall.name] if len(pieces) == 1 else [f"{wall.name}[{index}]" for index in range(len(pieces))]
    for each in furniture.keep_out:
        rows.append((*each.pose, *each.size, 0.0, FLAT_M, False, False))
        names.append(each.name)
    numbers = np.array(rows, np.float32)
    leaves: dict[str, Any] = {
        "pose": numbers[:, :3],
        "half_size": numbers[:, 3:5] / 2,
        "low": numbers[:, 5],
        "high": numbers[:, 6],
        "blocks_base": np.ones(len(rows), bool),
        "blocks_arm": numbers[:, 7] > 0,
        "bears_objects": numbers[:, 8] > 0,
    }
    return Boxes(**leaves), names


def _piece(wall: WallFields, index: int) -> tuple[float, ...]:
    """Pose, sides, low, high of the piece from one point to the next, that it blocks the arm and bears nothing."""
    (x, y), (next_x, next_y) = wall.points[index : index + 2]
    length, yaw = math.hypot(next_x - x, next_y - y), math.atan2(next_y - y, next_x - x)
    return ((x + next_x) / 2, (y + next_y) / 2, yaw, length, wall.thickness, 0.0, wall.height, True, False)
