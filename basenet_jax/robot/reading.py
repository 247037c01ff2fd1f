"""Reading robots: the robot file, and the MJCF or URDF that it names."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import functools
import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import jax
import mujoco
import numpy as np

from basenet_jax.documents.fields import DocumentError, convert
from basenet_jax.documents.text_files import read_json, read_yaml
from basenet_jax.robot.assembly import build_robot, fixed_joints
from basenet_jax.robot.capsule_fit import Fit
from basenet_jax.robot.fields import ALLOWED, FORMAT, RobotFile
from basenet_jax.robot.model import Robot
from basenet_jax.robot.model_arm import Arm, Capsule, between, compile_model, find_frame, read_arm, start_state
from basenet_jax.robot.model_joints import check_chain, check_joint_texts, joint_notes
from basenet_jax.robot.model_text import read_model_text
from basenet_jax.robot.robot_checks import check_file, check_model_path, check_robot
from basenet_jax.robot.robot_mjcf import write_mjcf
from basenet_jax.robot.set_up import set_up_faults
from basenet_jax.robot.tool import tool_place

DEFAULT_ROBOT = "ur5e_mobile"
SUFFIXES = (".yaml", ".yml", ".json")

Stamp = tuple[tuple[Path, int, int], ...]  # each file, when it was changed last, its size; zeros: it is gone


class RobotFileError(ValueError):
    """A file that holds no robot; the message names the file, the field, what was found and what is allowed."""


class Source(NamedTuple):
    """A robot with what it was read from, to compare the two."""

    robot: Robot
    file: RobotFile
    model: mujoco.MjModel  # the file's own, without inertias and looks
    files: tuple[Path, ...]  # all that was read, meshes too
    notes: tuple[str, ...] = ()  # what an owner may not have meant, though it can be used


@functools.cache
def packaged_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    assets = resources.files("basenet_jax.robot") / "assets"
    return tuple(sorted(entry.name[:-5] for entry in assets.iterdir() if entry.name.endswith(".yaml")))


def load_robot(reference: str = DEFAULT_ROBOT) -> Robot:
    """A packaged robot by its name, or one of your own by the path of its robot file; kept until a file of it changes.

    Raises:
        ValueError: there is no such robot, or (`RobotFileError`) its file is refused.
    """
    return _load(reference)[0]


def robot_stamp(reference: str) -> Stamp:
    """What differs once `load_robot` gives another robot for the same reference.

    Raises:
        ValueError: as for `load_robot`.
    """
    return _load(reference)[1]


def _load(reference: str) -> tuple[Robot, Stamp]:
    if reference in packaged_robots():
        return _load_packaged(reference), ()
    try:
        path = str(Path(reference).resolve())
    except (OSError, RuntimeError):  # links that lead in circles: reading says so
        path = reference
    kept = _kept.get(path)
    if kept is None or kept[1] != _stamp([file for file, *_ in kept[1]]):
        source = find_source(reference)
        kept = _kept[path] = (_usable(source, reference), _stamp(source.files))
    return kept


_kept: dict[str, tuple[Robot, Stamp]] = {}  # by the robot file's path


@functools.cache
def _load_packaged(name: str) -> Robot:
    return _usable(find_source(name), name)


def _usable(source: Source, reference: str | os.PathLike[str]) -> Robot:
    """The robot, if it can be used: its tool points down over the deck at stow, and its arm rests clear of its body."""
    for fault in set_up_faults(source.file, source.robot):
        raise RobotFileError(f"{reference}: {fault}")
    return source.robot


def _stamp(files: Iterable[Path]) -> Stamp:
    def of(path: Path) -> tuple[Path, int, int]:
        try:
            status = path.stat()
        except OSError:
            return path, 0, 0
        return path, status.st_mtime_ns, status.st_size

    return tuple(map(of, files))


def find_source(reference: str, packages: Mapping[str, Path] = MappingProxyType({})) -> Source:
    """What a robot is read from, anew each time, and the robot even if its home or stow is wrong.

    Args:
        reference: as for `load_robot`.
        packages: folders of description packages that lie elsewhere, by their names.

    Raises:
        ValueError: as for `load_robot`.
    """
    if reference in packaged_robots():
        with resources.as_file(resources.files("basenet_jax.robot") / "assets") as assets:
            return read_source(assets / f"{reference}.yaml", packaged=True)
    if not reference.lower().endswith(SUFFIXES):
        allowed = f"{', '.join(packaged_robots())}, or the path of a robot file ({', '.join(SUFFIXES)})"
        raise ValueError(f"robot: found {reference!r}, allowed are {allowed}")
    return read_source(reference, packages=packages)


def robot_digest(robot: Robot) -> str:
    """SHA-256 of a robot's numbers and what else counts, to tell whether it is still the same."""
    fixed = (robot.name, robot.joint_names, robot.prismatic, robot.capsule_link, robot.closed_form)
    fixed += ("omnidirectional",) if robot.omnidirectional else ()
    digest = hashlib.sha256(repr(fixed).encode())
    for path, leaf in jax.tree_util.tree_leaves_with_path(robot):
        values = np.asarray(leaf, "<f4")
        digest.update(f"{jax.tree_util.keystr(path)} {values.shape}".encode() + values.tobytes())
    return digest.hexdigest()


def robot_name(reference: str) -> str:
    """The name of a robot that is given as for `load_robot`."""
    return reference if reference in packaged_robots() else load_robot(reference).name


def read_robot(path: str | os.PathLike[str]) -> Robot:
    """Reads a robot file and the model that it names, anew each time.

    Raises:
        RobotFileError: the file or the model doesn't describe a mobile manipulator, or its arm rests in its body.
    """
    return _usable(read_source(path), path)


def read_source(
    path: str | os.PathLike[str], *, packaged: bool = False, packages: Mapping[str, Path] = MappingProxyType({})
) -> Source:
    """The robot of a file, with the model as MuJoCo sees it; whether its arm rests in its body isn't checked.

    Args:
        path: of the robot file.
        packaged: whether it comes with basenet_jax.
        packages: folders of description packages that lie elsewhere, by their names.

    Raises:
        RobotFileError: the file or the model is refused.
    """
    path = Path(path)
    try:
        document = read_json(path) if path.suffix.lower() == ".json" else read_yaml(path)
        file = convert(document, RobotFile, format_name=FORMAT, allowed=ALLOWED)
        return read_fields(file, path, taken=() if packaged else packaged_robots(), packages=packages)
    except DocumentError as error:
        raise RobotFileError(f"{path}: {error}") from None


def read_fields(
    file: RobotFile, path: Path, *, taken: Sequence[str] = (), packages: Mapping[str, Path] = MappingProxyType({})
) -> Source:
    """The robot of a robot file's fields.

    Args:
        file: the fields.
        path: where the file stands, or will.
        taken: names that it must not have.
        packages: folders of description packages that lie elsewhere, by their names.

    Raises:
        DocumentError: the fields or the model are refused.
    """
    check_file(file, taken)
    folder = path.resolve().parent
    model_path = check_model_path(file.model, folder)
    text = read_model_text(model_path, folder, visual=file.shapes == "visual", packages=packages)
    tool, arm_base = tool_place(file), file.frames.arm_base
    check_joint_texts(file.joints, text.joints)
    check_chain(tool.field, arm_base, tool.frame, text.joints)
    shapes = None if file.capsules else file.shapes
    model = compile_model(text, joints=file.joints, arm_base=arm_base, shapes=shapes)
    arm = read_arm(model, joints=file.joints, arm_base=arm_base, tool=tool, fixed=fixed_joints(file, model))
    if file.capsules:
        arm = arm._replace(capsules=_own_capsules(file, model, arm))
    robot = build_robot(file, model, arm)
    check_robot(file, robot)
    stays = [(capsule.link, capsule.fit) for capsule in arm.capsules if capsule.link == 0]
    notes = joint_notes(file.joints, file.joint_speed, ~model.jnt_limited[arm.joint_ids].astype(bool), text.joints)
    own = robot.replace(model_xml=write_mjcf(robot, stays))
    return Source(own, file, model, (path.resolve(), *text.files), tuple(notes))


def _own_capsules(file: RobotFile, model: mujoco.MjModel, arm: Arm) -> list[Capsule]:
    """The robot file's capsules, in their links."""
    data = start_state(model, fixed_joints(file, model))
    data.qpos[model.jnt_qposadr[arm.joint_ids]] = 0.0
    mujoco.mj_kinematics(model, data)
    link_frames = [find_frame(model, data, "frames.arm_base", file.frames.arm_base)[1]]
    for rotation, position in arm.steps:
        above = link_frames[-1]
        link_frames.append((above[0] @ rotation, above[0] @ position + above[1]))
    link_of_body = {int(model.jnt_bodyid[joint]): link for link, joint in enumerate(arm.joint_ids, start=1)}
    capsules = []
    for index, own in enumerate(file.capsules):
        body, frame = find_frame(model, data, f"capsules[{index}].frame", own.frame)
        while body and body not in link_of_body:
            body = int(model.body_parentid[body])
        link = link_of_body.get(body, 0)
        rotation, position = between(link_frames[link], frame)
        start, end = (rotation @ np.array(point) + position for point in (own.start, own.end))
        capsules.append(Capsule(link, own.frame, Fit(start, end, own.radius)))
    return sorted(capsules, key=lambda capsule: capsule.link)
