"""What a room must be beyond having the right fields."""

import itertools

import numpy as np
from jaxtyping import Float, Int
from msgspec import UNSET, UnsetType

from basenet_jax.config import PickConfig
from basenet_jax.documents.fields import describe, field_error, shortest
from basenet_jax.robot.model import Robot
from basenet_jax.world.boxes import Boxes, Room, blocks
from basenet_jax.world.footprints import extent, rectangle_gaps, within
from basenet_jax.world.furniture import MAX_BOXES, Furniture, WallFields, written_boxes
from basenet_jax.world.grasp_fields import size_of
from basenet_jax.world.room_fields import ALLOWED, DRIVES, RoomFields
from basenet_jax.world.scene_checks import check_apart, check_kind, check_names
from basenet_jax.world.spacing import Footprints

_TOLERANCE_M = 1e-3  # what is written may overlap by so much
_ROUNDING_M = 1e-5  # float32 at some tens of metres
_SHORTEST_PIECE_M = 1e-3  # of a wall


def check_furniture(room: RoomFields) -> None:
    """What types and bounds can't say of all that stands still: names, numbers, and that surfaces are clear.

    Raises:
        DocumentError: the message names the field, what was found and what is allowed.
    """
    kinds = ("surfaces", "obstacles", "walls", "keep_out", "objects")
    check_names([(f"{kind}[{i}]", each.name) for kind in kinds for i, each in enumerate(getattr(room, kind))])
    if room.drives not in DRIVES:
        raise field_error("drives", describe(room.drives), ALLOWED["drives"])
    if not isinstance(room.floor, UnsetType) and not (room.floor[0] < room.floor[2] and room.floor[1] < room.floor[3]):
        raise field_error("floor", describe(list(room.floor)), "is [x_min, y_min, x_max, y_max], the lesser ones first")
    for index, wall in enumerate(room.walls):
        _check_wall(wall, f"walls[{index}]")
    pieces = sum(len(wall.points) - 1 for wall in room.walls)
    count = len(room.surfaces) + len(room.obstacles) + pieces + len(room.keep_out)
    if count > MAX_BOXES:
        found = f"{count} boxes in surfaces, obstacles, walls' pieces and keep_out"
        raise field_error("", found, f"are up to {MAX_BOXES} in all")
    alone = count == 1 and room.map is UNSET and room.floor is UNSET and room.surfaces[0].pose == (0.0, 0.0, 0.0)
    if room.drives == "point" and not (alone and room.surfaces[0].thickness is UNSET):
        allowed = "is docked; point only goes round one solid table about W's origin, with nothing else there"
        raise field_error("drives", "'point' in a room", allowed)
    _check_surfaces(room)


def surfaces_under(room: RoomFields) -> Int[np.ndarray, " N"]:
    """The surface that each object stands on, by its index.

    Raises:
        DocumentError: an object stands on none, or doesn't say on which of several.
    """
    return np.array([_surface_under(room, index) for index in range(len(room.objects))])


def check_objects(room: RoomFields) -> None:
    """That objects are of one kind, each stands on one surface, and all are apart, from boxes too.

    Raises:
        DocumentError: the message names the field, what was found and what is allowed.
    """
    objects = room.objects
    for index, item in enumerate(objects):
        check_kind(item.class_, {"size": item.size, "grasps": item.grasps}, f"objects[{index}]")
        if item.class_ is not UNSET and item.tool_frame is not UNSET:
            raise field_error(f"objects[{index}].tool_frame", "it beside class", "is a frame of grasps of one's own")
    pose, size = np.array([item.pose for item in objects]), np.array([size_of(item) for item in objects])
    bottom = np.array([room.surfaces[index].height for index in surfaces_under(room)])
    top = bottom + size[:, 2]
    beside = (bottom[:, None] < top) & (bottom < top[:, None])
    own_size = np.array([item.class_ is UNSET for item in objects])
    check_apart([item.name for item in objects], Footprints(pose, size, own_size, crowded=True), beside)
    boxes, names = written_boxes(room)
    if inside := object_inside(pose, bottom, top, boxes):
        index, box = inside
        found = f"{describe(list(objects[index].pose))}, inside {describe(names[box])}"
        raise field_error(f"objects[{index}].pose", found, "are poses outside of other boxes")


def check_start(start: Float[np.ndarray, "3"], robot: Robot, room: Room, names: tuple[str, ...]) -> None:
    """That the base stands clear of all that blocks it, and on the floor.

    Args:
        start: x, y (m) and heading (rad) of the base in W.
        robot: whose base it is.
        room: unbatched, on the host.
        names: of its boxes.

    Raises:
        DocumentError: the message names the box.
    """
    if not stays_on_floor(start, robot, room):
        found = f"{start.tolist()}, where the base of {robot.name} leaves the floor"
        raise field_error("robot.start", found, f"are poses with all of it inside {shortest(room.floor)}")
    rule = PickConfig()
    for box in boxes_at_base(start, robot, room, rule)[:1]:
        found = f"{start.tolist()}, where the base of {robot.name} touches {describe(names[box])} or its margin"
        raise field_error("robot.start", found, f"are poses more than {rule.base_clearance_m} m clear of it")


def stays_on_floor(base_pose: Float[np.ndarray, "3"], robot: Robot, room: Room) -> bool:
    """Whether the footprint of a base at (x, y, heading) in W is within the floor's bounds."""
    reach = extent(base_pose, np.asarray(robot.footprint_half_size, float))
    return bool(np.all(reach[:2] >= room.floor[:2] - _ROUNDING_M) and np.all(reach[2:] <= room.floor[2:] + _ROUNDING_M))


def boxes_at_base(
    base_pose: Float[np.ndarray, "3"], robot: Robot, room: Room, rule: PickConfig = PickConfig()
) -> Int[np.ndarray, " K"]:
    """The boxes that a base touches, or whose margin it does, at (x, y, heading) in W; of a room on the host."""
    boxes, footprint = room.boxes, np.asarray(robot.footprint_half_size, float)
    gap = rectangle_gaps(base_pose[None], footprint[None], boxes.pose, boxes.half_size + rule.base_clearance_m)[0]
    body_top = float(robot.body_center[2] + robot.body_half_size[2])
    return np.flatnonzero(blocks(boxes, body_top) & (gap <= rule.touching_m))


def object_inside(
    pose: Float[np.ndarray, "N 3"], bottom: Float[np.ndarray, " N"], top: Float[np.ndarray, " N"], boxes: Boxes
) -> tuple[int, int] | None:
    """An object and a box that it stands inside of, or None.

    Args:
        pose: of the objects, (x, y, yaw) in W.
        bottom: height (m) of what they stand on, and
        top: of their upper sides.
        boxes: B of them, on the host.
    """
    meets = boxes.blocks_arm & (boxes.low < top[:, None] - _TOLERANCE_M) & (boxes.high > bottom[:, None] + _TOLERANCE_M)
    inside = np.argwhere(meets & within(pose[:, :2], boxes.pose, boxes.half_size, -_TOLERANCE_M))
    return (int(inside[0, 0]), int(inside[0, 1])) if len(inside) else None


def surface_overlap(furniture: Furniture) -> tuple[int, int] | None:
    """A surface and another one, or a piece of a wall, that overlap: their numbers among `written_boxes`; or None."""
    boxes, names = written_boxes(furniture)
    surfaces, behind_walls = len(furniture.surfaces), len(names) - len(furniture.keep_out)
    walls = np.arange(surfaces + len(furniture.obstacles), behind_walls)
    others = np.concatenate([np.arange(surfaces), walls])  # obstacles may stand on surfaces, or in them
    gap = rectangle_gaps(boxes.pose[:surfaces], boxes.half_size[:surfaces], boxes.pose[others], boxes.half_size[others])
    level = np.minimum(boxes.high[:surfaces, None], boxes.high[others])
    level -= np.maximum(boxes.low[:surfaces, None], boxes.low[others])
    overlap = (gap < -_TOLERANCE_M) & (level > _TOLERANCE_M) & ~np.tri(surfaces, len(others), dtype=bool)
    found = np.argwhere(overlap)
    return (int(found[0, 0]), int(others[found[0, 1]])) if len(found) else None


def _check_wall(wall: WallFields, path: str) -> None:
    for index, ends in enumerate(itertools.pairwise(wall.points)):
        if np.hypot(*np.subtract(*ends)) < _SHORTEST_PIECE_M:
            found = f"{list(ends[1])}, where the point before is"
            raise field_error(f"{path}.points[{index + 1}]", found, f"are points {_SHORTEST_PIECE_M} m and more apart")


def _check_surfaces(room: RoomFields) -> None:
    for index, surface in enumerate(room.surfaces):
        if not isinstance(surface.thickness, UnsetType) and surface.thickness > surface.height:
            found = f"{surface.thickness}, so that its underside is below the floor"
            allowed = f"is up to its height, {surface.height} m, or no such key where it is solid to the floor"
            raise field_error(f"surfaces[{index}].thickness", found, allowed)
    if overlap := surface_overlap(room):
        index, other = overlap
        name = describe(written_boxes(room)[1][other])
        second = f"surfaces[{other}] ({name})" if other < len(room.surfaces) else f"a wall ({name})"
        found = f"{describe(list(room.surfaces[index].pose))}, where it overlaps {second}"
        raise field_error(f"surfaces[{index}].pose", found, "are poses clear of other surfaces and of walls")


def _surface_under(room: RoomFields, index: int) -> int:
    """The surface that an object stands on."""
    item, path = room.objects[index], f"objects[{index}]"
    pose, size = (np.array([getattr(each, name) for each in room.surfaces]) for name in ("pose", "size"))
    under = within(np.array([item.pose[:2]]), pose, size / 2, _ROUNDING_M)[0]
    names = [surface.name for surface in room.surfaces]
    if isinstance(item.on, UnsetType):
        found = np.flatnonzero(under)
        if len(found) == 1:
            return int(found[0])
        if not len(found):
            allowed = "are poses whose x, y are on the top of a surface"
            raise field_error(f"{path}.pose", f"{describe(list(item.pose))}, off every surface", allowed)
        several = ", ".join(describe(names[each]) for each in found[:8])
        raise field_error(
            f"{path}.on", f"nothing, where several are under the object: {several}", "is one of their names"
        )
    if item.on not in names:
        some = ", ".join(describe(name) for name in names[:8])
        raise field_error(f"{path}.on", describe(item.on), f"are names of surfaces: {some}{', ...' * (len(names) > 8)}")
    chosen = names.index(item.on)
    if not under[chosen]:
        found = f"{describe(list(item.pose))}, off {describe(item.on)}"
        sides = " x ".join(f"{side:g}" for side in room.surfaces[chosen].size)
        raise field_error(f"{path}.pose", found, f"are poses whose x, y are on its top, {sides} m")
    return chosen
