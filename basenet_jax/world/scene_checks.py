"""What a scene must be beyond having the right fields."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool
from msgspec import UNSET, UnsetType

from basenet_jax.config import PickConfig
from basenet_jax.documents.fields import describe, field_error
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import DEFAULT_ROBOT, load_robot, packaged_robots
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import compiled_base_collides
from basenet_jax.world.scene_fields import CLASSES, ObjectFields, RobotFields, SceneFields, make_room, size_of
from basenet_jax.world.spacing import Footprints, gaps, needed_distance


def check_scene(scene: SceneFields, robot: str | None = None) -> str:
    """What types and bounds can't say: names, classes, objects on the table and apart, the robot clear of it.

    Args:
        scene: its fields.
        robot: to use instead of the scene's, as for `load_robot`.

    Returns:
        The robot to use, as for `load_robot`.

    Raises:
        DocumentError: the message names the field, what was found and what is allowed.
    """
    check_names([(f"objects[{index}]", item.name) for index, item in enumerate(scene.objects)])
    for index, item in enumerate(scene.objects):
        check_kind(item.class_, {"size": item.size, "grasp": item.grasp}, f"objects[{index}]")
        for axis, side in enumerate(scene.table.size):
            if abs(item.pose[axis]) > side / 2:
                found = f"{item.pose[axis]}, off the table"
                raise field_error(f"objects[{index}].pose[{axis}]", found, f"is {-side / 2} to {side / 2}")
    check_apart([item.name for item in scene.objects], footprints_of(scene.objects))
    reference = choose_robot(scene.robot, robot)
    _check_start(load_robot(reference), scene.robot, make_room(scene.table))
    return reference


def footprints_of(objects: Sequence[ObjectFields]) -> Footprints:
    """What a file's objects cover."""
    pose = np.array([item.pose for item in objects])
    size = np.array([size_of(item) for item in objects])
    return Footprints(pose, size, np.array([item.class_ is UNSET for item in objects]))


def check_names(names: Sequence[tuple[str, str]]) -> None:
    """That names can be printed, and none is there twice.

    Args:
        names: each thing's path, such as `objects[3]`, and its name.

    Raises:
        DocumentError: the message names the field, what was found and what is allowed.
    """
    seen: dict[str, str] = {}
    for path, name in names:
        if not 1 <= len(name) <= 64 or not name.isprintable() or name != name.strip():
            allowed = "are 1 to 64 printable characters, with no space at the ends"
            raise field_error(f"{path}.name", describe(name), allowed)
        if name in seen:
            raise field_error(f"{path}.name", f"{describe(name)}, the name of {seen[name]} too", "is a name of its own")
        seen[name] = path


def check_kind(class_: str | UnsetType, own: Mapping[str, Any], path: str) -> None:
    """That an object is of a class or has all of its own, and not both.

    Args:
        class_: its class's name, or UNSET.
        own: by key what else it may have: its size and what grasps it, or UNSET.
        path: of the object, for messages.

    Raises:
        DocumentError: the message names the field, what was found and what is allowed.
    """
    given, both = [key for key, value in own.items() if value is not UNSET], " and ".join(own)
    if class_ is UNSET:
        for key in own:
            if key not in given:
                found = "nothing" if given else f"neither class nor {both}"
                allowed = f"are a class, or {both}" if not given else f"are {both}, both and without class"
                raise field_error(f"{path}.{key if given else 'class'}", found, allowed)
    elif given:
        raise field_error(f"{path}.{given[0]}", "it beside class", f"are {both}, both and without class")
    elif class_ not in CLASSES:
        raise field_error(f"{path}.class", describe(class_), f"are {', '.join(CLASSES)} (or {both} without class)")


def check_apart(names: Sequence[str], footprints: Footprints, beside: Bool[np.ndarray, "N N"] | None = None) -> None:
    """That objects don't overlap.

    Args:
        names: of the objects.
        footprints: likewise.
        beside: which of them could meet at all; None: all.

    Raises:
        DocumentError: the message names the objects, what was found and what is allowed.
    """
    overlap = (gaps(footprints, footprints) < 0) & (True if beside is None else beside)
    pose = footprints.pose
    for second, first in np.argwhere(np.tril(overlap, k=-1))[:1]:
        distance = np.linalg.norm(pose[second, :2] - pose[first, :2])
        needed = needed_distance(footprints, footprints)[second, first]
        other = f"objects[{first}] ({describe(names[first])})"
        found, allowed = f"{distance:.4f} m to the centre of {other}", f"are {needed:.4f} m and more"
        if distance >= needed or footprints.crowded:
            found, allowed = (
                f"{pose[second].tolist()}, where its rectangle overlaps that of {other}",
                "are poses clear of it",
            )
        raise field_error(f"objects[{second}].pose", found, allowed)


def choose_robot(fields: RobotFields, robot: str | None) -> str:
    """The robot that was asked for, else the file's; a scene can name packaged ones alone."""
    if robot is not None:
        return robot
    if isinstance(fields.model, UnsetType):
        return DEFAULT_ROBOT
    if fields.model not in packaged_robots():
        allowed = f"are {', '.join(packaged_robots())}; a robot of your own is given by its file as --robot"
        raise field_error("robot.model", describe(fields.model), allowed)
    return fields.model


def _check_start(robot: Robot, fields: RobotFields, room: Room) -> None:
    rule = PickConfig()
    start = np.array(fields.start, np.float32)
    if compiled_base_collides(robot, start, room, rule.base_clearance_m, rule.touching_m):
        found = f"{list(fields.start)}, where the base of {robot.name} touches the table or its margin"
        raise field_error("robot.start", found, f"are poses more than {rule.base_clearance_m} m clear of the table")
