"""What a scene must be beyond having the right fields."""

import numpy as np
from msgspec import UNSET, UnsetType

from basenet_jax.config import PickConfig
from basenet_jax.documents.fields import describe, field_error
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import DEFAULT_ROBOT, load_robot, packaged_robots
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import compiled_base_collides
from basenet_jax.world.scene_fields import CLASSES, ObjectFields, RobotFields, SceneFields, make_room, size_of
from basenet_jax.world.spacing import Footprints, gaps, needed_distance

_SIZE_AND_GRASP = "are size and grasp, both and without class"


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
    _check_names([item.name for item in scene.objects])
    for index, item in enumerate(scene.objects):
        _check_kind(item, f"objects[{index}]")
        for axis, side in enumerate(scene.table.size):
            if abs(item.pose[axis]) > side / 2:
                found = f"{item.pose[axis]}, off the table"
                raise field_error(f"objects[{index}].pose[{axis}]", found, f"is {-side / 2} to {side / 2}")
    _check_apart(scene.objects)
    reference = _choose_robot(scene.robot, robot)
    _check_start(load_robot(reference), scene.robot, make_room(scene.table))
    return reference


def _check_names(names: list[str]) -> None:
    for index, name in enumerate(names):
        path = f"objects[{index}].name"
        if not 1 <= len(name) <= 64 or not name.isprintable() or name != name.strip():
            raise field_error(path, describe(name), "are 1 to 64 printable characters, with no space at the ends")
        if (first := names.index(name)) < index:
            raise field_error(path, f"{describe(name)}, the name of objects[{first}] too", "is a name of its own")


def _check_kind(item: ObjectFields, path: str) -> None:
    own = {"size": item.size, "grasp": item.grasp}
    given = [key for key, value in own.items() if value is not UNSET]
    if item.class_ is UNSET:
        for key in own:
            if key not in given:
                found = "nothing" if given else "neither class nor size and grasp"
                allowed = "are a class, or size and grasp" if not given else _SIZE_AND_GRASP
                raise field_error(f"{path}.{key if given else 'class'}", found, allowed)
    elif given:
        raise field_error(f"{path}.{given[0]}", "it beside class", _SIZE_AND_GRASP)
    elif item.class_ not in CLASSES:
        allowed = f"are {', '.join(CLASSES)} (or size and grasp without class)"
        raise field_error(f"{path}.class", describe(item.class_), allowed)


def _check_apart(objects: list[ObjectFields]) -> None:
    pose = np.array([item.pose for item in objects])
    size = np.array([size_of(item) for item in objects])
    footprints = Footprints(pose, size, np.array([item.class_ is UNSET for item in objects]))
    for second, first in np.argwhere(np.tril(gaps(footprints, footprints) < 0, k=-1))[:1]:
        distance = np.linalg.norm(pose[second, :2] - pose[first, :2])
        needed = needed_distance(footprints, footprints)[second, first]
        other = f"objects[{first}] ({describe(objects[first].name)})"
        found, allowed = f"{distance:.4f} m to the centre of {other}", f"are {needed:.4f} m and more"
        if distance >= needed:
            found, allowed = (
                f"{pose[second].tolist()}, where its rectangle overlaps that of {other}",
                "are poses clear of it",
            )
        raise field_error(f"objects[{second}].pose", found, allowed)


def _choose_robot(fields: RobotFields, robot: str | None) -> str:
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
