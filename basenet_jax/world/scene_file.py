"""Scene files: what a user writes, `basenet-scene/1` here and rooms in `room_file`, with every check planning needs."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import msgspec
import numpy as np

from basenet_jax.atomic import write_atomically
from basenet_jax.documents.fields import DocumentError, convert, shortest
from basenet_jax.documents.text_files import read_json, read_yaml, to_json
from basenet_jax.documents.yaml_text import to_yaml
from basenet_jax.robot.reading import robot_name
from basenet_jax.world.grasps import Grasps, of_class
from basenet_jax.world.occupancy_map import OccupancyMap
from basenet_jax.world.room_fields import ROOM_FORMAT
from basenet_jax.world.room_file import NO_MAPS, read_room, room_document
from basenet_jax.world.scene import NamedScene, Scene
from basenet_jax.world.scene_checks import check_scene
from basenet_jax.world.scene_fields import (
    ALLOWED,
    CLASSES,
    FORMAT,
    GraspFields,
    ObjectFields,
    RobotFields,
    SceneFields,
    TableFields,
    class_of,
    grasp_of,
    make_room,
    size_of,
)


class SceneFileError(ValueError):
    """A file that holds no valid scene; the message names the file, the field, what was found and what is allowed."""


def load_scene(
    path: str | os.PathLike[str], *, robot: str | None = None, maps: Mapping[str, OccupancyMap] = NO_MAPS
) -> NamedScene:
    """Reads a scene file, YAML or (by the name's end `.json`) JSON, of at most 64 KiB or 1 MiB.

    Args:
        path: of the file.
        robot: to use instead of the one that the file names: a packaged one's name, or the path of a robot file. Its
            base has to be clear of the table at the scene's start.
        maps: that needn't lie beside the file, by the names that it may give them.

    Returns:
        The scene in float32, with as many slots as objects, in the file's order.

    Raises:
        SceneFileError: the file can't be read or isn't a valid scene.
        ValueError: there is no such robot, or (`RobotFileError`) its file is refused.
    """
    try:
        document = read_json(path) if _is_json(path) else read_yaml(path)
        if isinstance(document, dict) and document.get("format") == ROOM_FORMAT:
            return read_room(document, Path(path).parent, robot, maps)
        fields = convert(document, SceneFields, format_name=FORMAT, allowed=ALLOWED)
        reference = check_scene(fields, robot)
    except DocumentError as error:
        raise SceneFileError(f"{path}: {error}") from None
    return _from_fields(fields, reference)


def save_scene(path: str | os.PathLike[str], scene: NamedScene, *, maps: Mapping[str, OccupancyMap] = NO_MAPS) -> None:
    """Writes a scene file that `load_scene` reads back to the same float32 values; whole or not at all.

    YAML, or JSON where the name ends in `.json`. An object whose size or grasp differs from its class's is written
    with its own size and grasp, without class.

    Args:
        path: of the file.
        scene: to write.
        maps: as for `load_scene`; any other has to lie beside the file.

    Raises:
        SceneFileError: the scene isn't a valid one (say, objects overlap); nothing is written.
        OSError: the file can't be written.
    """
    try:
        if scene.furniture is None:
            data = msgspec.to_builtins(_to_fields(scene))
            check_scene(convert(data, SceneFields, format_name=FORMAT, allowed=ALLOWED), scene.robot)
        else:
            data = room_document(scene)
            read_room(data, Path(path).parent, scene.robot, maps)
    except ValueError as error:
        raise SceneFileError(f"{path}: {error}") from None
    write_atomically(path, to_json(data) if _is_json(path) else to_yaml(data))


def _is_json(path: str | os.PathLike[str]) -> bool:
    return Path(path).suffix.lower() == ".json"


def _from_fields(fields: SceneFields, robot: str) -> NamedScene:
    classes = {name: index for index, name in enumerate(CLASSES)}
    objects = fields.objects
    arrays: dict[str, Any] = {  # made on the host: each operation of JAX's own would be compiled
        "object_pose": np.array([item.pose for item in objects], np.float32),
        "object_size": np.array([size_of(item) for item in objects], np.float32),
        "object_grasps": of_class(np.array([grasp_of(item) for item in objects], np.float32), np),
        "object_class": np.array([classes.get(str(item.class_), -1) for item in objects], np.int32),
        "mask": np.ones(len(objects), bool),
        "surface_height": np.full(len(objects), fields.table.height, np.float32),
        "robot_start": np.array(fields.robot.start, np.float32),
    }
    scene = jax.device_put(Scene(**arrays, room=make_room(fields.table)))
    named = None if isinstance(fields.robot.model, msgspec.UnsetType) else fields.robot.model
    other = named if named != robot_name(robot) else None
    return NamedScene(scene, tuple(item.name for item in fields.objects), robot, other)


def _to_fields(scene: NamedScene) -> SceneFields:
    arrays: Scene = jax.device_get(scene.arrays)
    count = len(scene.names)
    if list(np.flatnonzero(arrays.mask)) != list(range(count)):
        raise ValueError(f"objects: found {count} names for the slots {np.flatnonzero(arrays.mask).tolist()}")
    table = TableFields(tuple(shortest(2 * arrays.room.table_half_size)), shortest(arrays.room.table_height))
    alone = jax.tree.leaves(make_room(table))
    if not all(map(np.array_equal, jax.tree.leaves(arrays.room), alone)):
        boxes = arrays.room.boxes
        found = f"a room of {np.sum(boxes.blocks_base | boxes.blocks_arm)} boxes without its furniture"
        raise ValueError(f"room: found {found}, allowed is one table about W's origin")
    robot = RobotFields(model=robot_name(scene.robot), start=tuple(shortest(arrays.robot_start)))
    objects = [_object_fields(arrays, slot, name) for slot, name in enumerate(scene.names)]
    return SceneFields(table=table, robot=robot, objects=objects)


def _object_fields(arrays: Scene, slot: int, name: str) -> ObjectFields:
    pose, size = (shortest(x[slot]) for x in (arrays.object_pose, arrays.object_size))
    kind = class_of(arrays, slot, sides=False)
    if kind is not None:
        return ObjectFields(name=name, class_=kind.name, pose=tuple(pose))
    grasp = _grasp_fields(arrays.object_grasps[slot], slot)
    return ObjectFields(name=name, pose=tuple(pose), size=tuple(size), grasp=grasp)


def _grasp_fields(grasps: Grasps, slot: int) -> GraspFields:
    """Those of the one top-down grasp."""
    own = grasps[np.asarray(grasps.there)]
    x, _, z, *_, yaw = pose = own.pose[0]
    if not all(jax.tree.leaves(jax.tree.map(np.array_equal, own, of_class(pose[[0, 2, 5]], np)))):
        found = "grasps of another kind, or several"
        raise ValueError(f"objects[{slot}].grasp: found {found}, allowed is one top-down grasp in {FORMAT}")
    return GraspFields(*shortest(np.array([x, z, yaw])))
