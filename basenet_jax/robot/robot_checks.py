"""What a robot file must be beyond having the right fields."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from msgspec import UnsetType

from basenet_jax.documents.fields import describe, field_error
from basenet_jax.documents.text_files import inside
from basenet_jax.robot.fields import ALLOWED, CLOSED_FORMS, DRIVES, SHAPES, RobotFile
from basenet_jax.robot.model import Robot
from basenet_jax.robot.robot_mjcf import BASE_JOINTS

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_REACH_M = (0.2, 4.0)  # of the stretched arm
_MOST_RADIUS_M = 0.5
_ROUND_ANGLE, _ROUNDED = np.pi / 12, 2e-3  # rad: to how many digits people write them
_OVERHANG_M, _MOUNT_OVERHANG_M = 0.05, 0.2
_LIMIT_TOLERANCE = 1e-6  # rad or m: files round


def check_file(file: RobotFile, taken: Sequence[str]) -> None:
    """What can be said before the model is read.

    Args:
        file: its fields.
        taken: names that it must not have.

    Raises:
        DocumentError: the message names the field, what was found and what is allowed.
    """
    if not _NAME.fullmatch(file.name):
        raise field_error("name", describe(file.name), "are 1 to 64 letters, digits, _ and -")
    if file.name in taken:
        raise field_error("name", f"{describe(file.name)}, a packaged robot's", "is a name of its own")
    if file.closed_form not in (None, *CLOSED_FORMS):
        raise field_error("closed_form", describe(file.closed_form), ALLOWED["closed_form"])
    if file.shapes not in SHAPES:
        raise field_error("shapes", describe(file.shapes), ALLOWED["shapes"])
    for name, value in file.fixed.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= 720:
            raise field_error(f"fixed.{name}", describe(value), "is a number from -720 to 720 (degrees or m)")
        if name in file.joints:
            raise field_error(f"fixed.{name}", "a joint that joints lists too", "is each joint in one of the two")
    if file.drive not in DRIVES:
        raise field_error("drive", describe(file.drive), ALLOWED["drive"])
    for index, name in enumerate(file.joints):
        if file.joints.index(name) < index:
            raise field_error(f"joints[{index}]", f"{describe(name)} twice", "is each joint once")
        if not name or not name.isprintable() or name in BASE_JOINTS:
            raise field_error(f"joints[{index}]", describe(name), f"are printable names but {', '.join(BASE_JOINTS)}")
    for name in ("joint_speed", "joint_acceleration", "home_degrees", "stow_degrees"):
        if len(values := getattr(file, name)) != len(file.joints):
            raise field_error(name, f"{len(values)} values", f"is one for each of the {len(file.joints)} joints")
    _check_rotations(file)
    _check_places(file)


def _check_rotations(file: RobotFile) -> None:
    """That roll, pitch and yaw aren't in radians: multiples of 15 degrees are what people write."""
    for name, angles in (
        ("mount.rpy_degrees", file.mount.rpy_degrees),
        ("tool.rotation_rpy_degrees", file.tool.rotation_rpy_degrees),
    ):
        for index, angle in enumerate(() if isinstance(angles, UnsetType) else angles):
            steps = round(angle / _ROUND_ANGLE)
            if 0 < abs(steps) <= 24 and abs(angle - steps * _ROUND_ANGLE) < _ROUNDED:
                allowed = f"are degrees: {15 * steps:g}, if these are radians"
                raise field_error(f"{name}[{index}]", f"{angle:g}", allowed)


def _check_places(file: RobotFile) -> None:
    """That body, deck and arm are on the base: where the footprint is, nothing else is, for drives."""
    half = np.array(file.base.footprint) / 2

    def beyond(center: Sequence[float], size: Sequence[float]) -> float:
        return float(np.max(np.abs(center[:2]) + np.array(size[:2]) / 2 - half))

    allowed = "is within {:g} m of base.footprint, a rectangle about the base frame's origin"
    for name, place, most in (
        ("base.body", beyond(file.base.body.center, file.base.body.size), _OVERHANG_M),
        ("deck", beyond(file.deck.center, file.deck.size), _OVERHANG_M),
        ("mount.position", beyond(file.mount.position, (0.0, 0.0)), _MOUNT_OVERHANG_M),
    ):
        if place > most:
            raise field_error(name, f"a place {place:.2f} m beyond the base's footprint", allowed.format(most))


def check_model_path(model: str, folder: Path) -> Path:
    """The model's file, links followed.

    Raises:
        DocumentError: it isn't in the robot file's folder or below.
    """
    found = None if Path(model).is_absolute() or "\0" in model else inside(folder / model, folder)
    if found is None:
        where, target = "", folder / model
        if "\0" not in model:
            where = ", which lies elsewhere" if target.exists() else ", which isn't there"
            where = f", a link to {target.resolve()}" if target.is_symlink() and target.exists() else where
        allowed = "are paths of files in the robot file's folder or below (the robot file may stand in a folder above)"
        raise field_error("model", f"{describe(model)}{where}", allowed)
    return found


def check_robot(file: RobotFile, robot: Robot) -> None:
    """That the arrays make sense: finite, of a robot's size, home and stow inside the limits, the closed form's frames.

    Raises:
        DocumentError: the message names the field, what was found and what is allowed.
    """
    _check_size(robot)
    _check_limits(file, robot)
    if len(robot.capsule_radius) == 0:
        allowed = "are shapes that collide in the model, shapes: visual (those that are seen), or capsules of one's own"
        raise field_error("capsules", "none, and no moving link of the model has a shape that collides", allowed)
    widest = int(np.argmax(robot.capsule_radius))
    if not robot.capsule_radius[widest] <= _MOST_RADIUS_M:
        found = f"a shape of link {robot.capsule_link[widest]} with a radius of {robot.capsule_radius[widest]:.3g} m"
        raise field_error("model", found, f"are up to {_MOST_RADIUS_M} m (are its meshes in mm?)")
    if file.closed_form == "ur" and robot.closed_form is None:
        allowed = "is ur only where axes 2 to 4 are parallel and meet 1's squarely, as 5's meets 4's and 6's"
        raise field_error("closed_form", "'ur' for another kind of arm", allowed)


def _check_size(robot: Robot) -> None:
    arrays = (robot.joint_rotation, robot.joint_position, robot.tool_position, robot.joint_lower, robot.joint_upper)
    shapes = (robot.capsule_start, robot.capsule_end, robot.capsule_radius)
    if not all(np.all(np.isfinite(array)) for array in (*arrays, *shapes)):
        raise field_error("model", "a frame, limit or shape that is infinite or no number", "are finite numbers")
    lengths = np.linalg.norm(np.vstack([robot.joint_position[1:], robot.tool_position]), axis=1)
    slides = np.maximum(np.abs(robot.joint_lower), np.abs(robot.joint_upper))[list(robot.prismatic)]
    reach = float(lengths.sum() + slides.sum())
    if not _REACH_M[0] <= reach <= _REACH_M[1]:
        hint = "are its lengths in mm?" if reach > _REACH_M[1] else "are its lengths in km, or is a scale wrong?"
        found = f"an arm that is {reach:.3g} m long from joint 1 to the tool"
        raise field_error("model", found, f"is {_REACH_M[0]} to {_REACH_M[1]} m ({hint})")


def _check_limits(file: RobotFile, robot: Robot) -> None:
    for name, values in (("home", robot.home), ("stow", robot.stow)):
        outside = (values < robot.joint_lower - _LIMIT_TOLERANCE) | (values > robot.joint_upper + _LIMIT_TOLERANCE)
        for index in np.flatnonzero(outside)[:1]:
            unit = (1.0, "m") if robot.prismatic[index] else (180.0 / np.pi, "degrees")
            low, high = robot.joint_lower[index] * unit[0], robot.joint_upper[index] * unit[0]
            field = f"{name}_degrees"
            found = f"{getattr(file, field)[index]:g}"
            raise field_error(f"{field}[{index}]", found, f"is {low:.6g} to {high:.6g} {unit[1]}, the joint's limits")
