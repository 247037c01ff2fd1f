"""Rooms' scene files, `basenet-scene/2`, as scenes and back."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import jax
import msgspec
import numpy as np
from msgspec import UnsetType

from basenet_jax.documents.fields import convert, describe, shortest
from basenet_jax.robot.reading import load_robot, robot_name
from basenet_jax.world.boxes import Room
from basenet_jax.world.footprints import within
from basenet_jax.world.furniture import MAP, Furniture, SurfaceFields, furnish
from basenet_jax.world.grasp_fields import grasp_document, read_grasps, size_of
from basenet_jax.world.grasps import of_objects
from basenet_jax.world.occupancy_map import OccupancyMap, check_on_map, map_boxes, read_map
from basenet_jax.world.room_checks import check_furniture, check_objects, check_start, surfaces_under
from basenet_jax.world.room_fields import ALLOWED, ROOM_FORMAT, RoomFields, RoomObjectFields
from basenet_jax.world.scene import NamedScene, Scene
from basenet_jax.world.scene_checks import choose_robot
from basenet_jax.world.scene_fields import CLASSES, RobotFields, class_of

NO_MAPS: Mapping[str, OccupancyMap] = MappingProxyType({})


def read_room(
    document: Any, folder: Path, robot: str | None = None, maps: Mapping[str, OccupancyMap] = NO_MAPS
) -> NamedScene:
    """A room's document as a scene, with every check that planning needs.

    Args:
        document: of `read_yaml` or `read_json`.
        folder: of the file, in which its map is.
        robot: as for `load_scene`.
        maps: as for `load_scene`.

    Raises:
        DocumentError: it isn't a valid room.
        ValueError: there is no such robot, or (`RobotFileError`) its file is refused.
    """
    fields = convert(document, RoomFields, format_name=ROOM_FORMAT, allowed=ALLOWED)
    check_furniture(fields)
    check_objects(fields)
    occupancy, start = None, fields.robot.start
    if not isinstance(fields.map, UnsetType):
        occupancy = maps[fields.map] if fields.map in maps else read_map(fields.map, folder)
    room, names = furnish(fields, None if occupancy is None else map_boxes(occupancy))
    reference = choose_robot(fields.robot, robot)
    if occupancy is not None:
        check_on_map(np.array(start), occupancy)
    check_start(np.array(start), load_robot(reference), room, names)
    return dataclasses.replace(room_scene(fields, room, names, reference, folder), map=occupancy)


def room_scene(
    fields: RoomFields, room: Room, box_names: tuple[str, ...], robot: str, folder: Path = Path()
) -> NamedScene:
    """The scene of checked fields in float32.

    Args:
        fields: of the whole room.
        room: of `furnish`.
        box_names: likewise.
        robot: to use, as for `load_robot`.
        folder: of the room's file, in which files of grasps are.

    Raises:
        DocumentError: a file of grasps is refused.
    """
    classes = {name: index for index, name in enumerate(CLASSES)}
    surface, objects = surfaces_under(fields), fields.objects
    read = [read_grasps(item, folder, f"objects[{index}]", sides=fields.clutter) for index, item in enumerate(objects)]
    arrays: dict[str, Any] = {  # made on the host: each operation of JAX's own would be compiled
        "object_pose": np.array([item.pose for item in objects], np.float32),
        "object_size": np.array([size_of(item) for item in objects], np.float32),
        "object_grasps": of_objects([grasps for grasps, _ in read]),
        "object_class": np.array([classes.get(str(item.class_), -1) for item in objects], np.int32),
        "mask": np.ones(len(objects), bool),
        "surface_height": np.array([fields.surfaces[index].height for index in surface], np.float32),
        "robot_start": np.array(fields.robot.start, np.float32),
    }
    named = None if isinstance(fields.robot.model, UnsetType) else fields.robot.model
    furniture = Furniture(**{name: getattr(fields, name) for name in Furniture.__struct_fields__})
    return NamedScene(
        jax.device_put(Scene(**arrays, room=room)),
        tuple(item.name for item in objects),
        robot,
        named if named != robot_name(robot) else None,
        box_names,
        furniture,
        tuple(tuple(index.tolist()) for _, index in read),
    )


def room_document(scene: NamedScene) -> dict[str, Any]:
    """What the file of a room holds; read again it is the same to the last bit of float32.

    Raises:
        ValueError: the scene's boxes are not those of its furniture, or an object stands on no surface.
    """
    furniture, arrays = scene.furniture, jax.device_get(scene.arrays)
    assert furniture is not None
    count = len(scene.names)
    if list(np.flatnonzero(arrays.mask)) != list(range(count)):
        raise ValueError(f"objects: found {count} names for the slots {np.flatnonzero(arrays.mask).tolist()}")
    _check_same(arrays.room, furniture, scene.box_names)
    robot = RobotFields(model=robot_name(scene.robot), start=tuple(shortest(arrays.robot_start)))
    objects = [_object_fields(arrays, slot, name, furniture) for slot, name in enumerate(scene.names)]
    own = {name: getattr(furniture, name) for name in Furniture.__struct_fields__}
    data = msgspec.to_builtins(RoomFields(format=ROOM_FORMAT, robot=robot, objects=objects, **own))
    order = ("format", *Furniture.__struct_fields__, "robot", "objects")
    return {name: data[name] for name in order if name in data and data[name] != []}


def _check_same(room: Room, furniture: Furniture, names: tuple[str, ...]) -> None:
    written, written_names = furnish(furniture)
    count = len(written_names)
    own, wanted = (jax.tree.map(lambda x: x[:count], each.boxes) for each in (room, written))
    same = names[:count] == written_names and set(names[count:]) <= {MAP}
    leaves = (jax.tree.leaves((boxes, floor)) for boxes, floor in ((own, room.floor), (wanted, written.floor)))
    if not same or not all(map(np.array_equal, *leaves)):
        raise ValueError("room: found boxes or a floor changed in the arrays, allowed are those of its furniture")


def _object_fields(arrays: Scene, slot: int, name: str, furniture: Furniture) -> RoomObjectFields:
    pose, height = arrays.object_pose[slot], arrays.surface_height[slot]
    tops = [np.array([getattr(each, field) for each in furniture.surfaces]) for field in ("pose", "size", "height")]
    under = within(pose[None, :2], tops[0], tops[1] / 2, 1e-5)[0] & (tops[2].astype(np.float32) == height)
    if not np.any(under):
        found = f"{describe(shortest(pose))} at a height of {height} m"
        raise ValueError(f"objects[{slot}].pose: found {found}, allowed are poses on a surface")
    own = {"name": name, "on": furniture.surfaces[int(np.argmax(under))].name, "pose": tuple(shortest(pose))}
    kind = class_of(arrays, slot, sides=furniture.clutter)
    if kind is not None:
        return RoomObjectFields(class_=kind.name, **own)
    size, grasps = shortest(arrays.object_size[slot]), grasp_document(arrays.object_grasps[slot])
    return RoomObjectFields(size=tuple(size), grasps=grasps, **own)


def as_room(scene: NamedScene) -> NamedScene:
    """The paper's world, of a `basenet-scene/1` file or drawn, as a room: one table, drives of a point, no clutter.

    Raises:
        ValueError: the scene is a room.
    """
    if scene.furniture is not None:
        raise ValueError("format: found a room, allowed are scenes with one table")
    room = jax.device_get(scene.arrays.room)
    name = next(name for name in ("table", *(f"table_{i}" for i in range(len(scene.names)))) if name not in scene.names)
    size, height = shortest(2 * room.table_half_size), shortest(room.table_height)
    table = SurfaceFields(name=name, pose=(0.0, 0.0, 0.0), size=tuple(size), height=height)
    furniture = Furniture(surfaces=[table], drives="point", clutter=False)
    return dataclasses.replace(scene, box_names=(name,), furniture=furniture)
