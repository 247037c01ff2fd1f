"""Reading robots: the robot file, and the MJCF or URDF that it names."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import functools
import hashlib
import math
import os
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import jax
import mujoco
import numpy as np

from basenet_jax.documents.fields import DocumentError, convert
from basenet_jax.documents.text_files import read_json, read_yaml
from basenet_jax.robot.capsule_fit import Fit
from basenet_jax.robot.fields import ALLOWED, FORMAT, RobotFile
from basenet_jax.robot.model import Robot
from basenet_jax.robot.model_arm import Arm, Capsule, between, compile_model, find_frame, read_arm
from basenet_jax.robot.model_text import read_model_text
from basenet_jax.robot.robot_checks import check_file, check_model_path, check_robot
from basenet_jax.robot.robot_mjcf import write_mjcf

DEFAULT_ROBOT = "ur5e_mobile"
SUFFIXES = (".yaml", ".yml", ".json")
_WHOLE_TURN = 2.0 * math.pi  # either way, for a turning joint without limits


class RobotFileError(ValueError):
    """A file that holds no robot; the message names the file, the field, what was found and what is allowed."""


class Source(NamedTuple):
    """A robot with what it was read from, to compare the two."""

    robot: Robot
    file: RobotFile
    model: mujoco.MjModel  # the file's own, without inertias and looks


def packaged_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    assets = resources.files("basenet_jax.robot") / "assets"
    return tuple(sorted(entry.name[:-5] for entry in assets.iterdir() if entry.name.endswith(".yaml")))


@functools.cache
def load_robot(reference: str = DEFAULT_ROBOT) -> Robot:
    """A packaged robot by its name, or one of your own by the path of its robot file; read once and kept.

    Raises:
        ValueError: there is no such robot, or (`RobotFileError`) its file is refused.
    """
    return find_source(reference).robot


def find_source(reference: str) -> Source:
    """`load_robot` with what the robot was read from, anew each time."""
    if reference in packaged_robots():
        with resources.as_file(resources.files("basenet_jax.robot") / "assets") as assets:
            return read_source(assets / f"{reference}.yaml", packaged=True)
    if not reference.lower().endswith(SUFFIXES):
        allowed = f"{', '.join(packaged_robots())}, or the path of a robot file ({', '.join(SUFFIXES)})"
        raise ValueError(f"robot: found {reference!r}, allowed are {allowed}")
    return read_source(reference)


def robot_digest(robot: Robot) -> str:
    """SHA-256 of a robot's numbers and what else counts, to tell whether it is still the same."""
    fixed = (robot.name, robot.joint_names, robot.prismatic, robot.capsule_link, robot.closed_form)
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
        RobotFileError: the file or the model doesn't describe a mobile manipulator.
    """
    return read_source(path).robot


def read_source(path: str | os.PathLike[str], *, packaged: bool = False) -> Source:
    """`read_robot`, with the model as MuJoCo sees it."""
    path = Path(path)
    try:
        document = read_json(path) if path.suffix.lower() == ".json" else read_yaml(path)
        file = convert(document, RobotFile, format_name=FORMAT, allowed=ALLOWED)
        check_file(file, () if packaged else packaged_robots())
        folder = path.resolve().parent
        text = read_model_text(check_model_path(file.model, folder), folder)
        model = compile_model(text, with_shapes=not file.capsules)
        arm = read_arm(model, joints=file.joints, arm_base=file.frames.arm_base, tool=file.frames.tool)
        if file.capsules:
            arm = arm._replace(capsules=_own_capsules(file, model, arm))
        robot = _build(file, model, arm)
        check_robot(file, robot)
    except DocumentError as error:
        raise RobotFileError(f"{path}: {error}") from None
    stays = [(capsule.link, capsule.fit) for capsule in arm.capsules if capsule.link == 0]
    return Source(robot.replace(model_xml=write_mjcf(robot, stays)), file, model)


def _own_capsules(file: RobotFile, model: mujoco.MjModel, arm: Arm) -> list[Capsule]:
    """The robot file's capsules, in their links."""
    data = mujoco.MjData(model)
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


def _build(file: RobotFile, model: mujoco.MjModel, arm: Arm) -> Robot:
    speed, acceleration, body = file.base.speed, file.base.acceleration, file.base.body
    sliding = tuple(bool(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE) for j in arm.joint_ids)
    tested = [capsule for capsule in arm.capsules if capsule.link > 0]  # the arm's base never moves against its own
    leaves: dict[str, Any] = {
        **_arm_leaves(arm, model, tested),
        **_joint_leaves(file, sliding),
        "mount_rotation": _from_rpy(np.radians(file.mount.rpy_degrees)),
        "mount_position": np.array(file.mount.position),
        "body_center": np.array(body.center),
        "body_half_size": np.array(body.size) / 2,
        "footprint_half_size": np.array(file.base.footprint) / 2,
        "base_speed": np.array([speed.linear, speed.angular]),
        "base_acceleration": np.array([acceleration.linear, acceleration.angular]),
        "deck": np.array([*file.deck.center, *file.deck.size]),
    }
    return Robot(
        **leaves,
        name=file.name,
        model_xml="",
        joint_names=tuple(file.joints),
        prismatic=sliding,
        capsule_link=tuple(capsule.link for capsule in tested),
        closed_form=file.closed_form,
    )


def _arm_leaves(arm: Arm, model: mujoco.MjModel, capsules: list[Capsule]) -> dict[str, np.ndarray]:
    limited = model.jnt_limited[arm.joint_ids].astype(bool)[:, None]
    limits = np.where(limited, model.jnt_range[arm.joint_ids], [-_WHOLE_TURN, _WHOLE_TURN])
    return {
        "joint_rotation": np.stack([rotation for rotation, _ in arm.steps]),
        "joint_position": np.stack([position for _, position in arm.steps]),
        "tool_rotation": arm.tool[0],
        "tool_position": arm.tool[1],
        "joint_lower": limits[:, 0].copy(),
        "joint_upper": limits[:, 1].copy(),
        "capsule_start": np.array([capsule.fit.start for capsule in capsules]).reshape(-1, 3),
        "capsule_end": np.array([capsule.fit.end for capsule in capsules]).reshape(-1, 3),
        "capsule_radius": np.array([capsule.fit.radius for capsule in capsules]),
    }


def _joint_leaves(file: RobotFile, sliding: tuple[bool, ...]) -> dict[str, np.ndarray]:
    unit = np.where(sliding, 1.0, math.pi / 180.0)
    return {
        "joint_speed": np.array(file.joint_speed),
        "joint_acceleration": np.array(file.joint_acceleration),
        "home": np.array(file.home_degrees) * unit,
        "stow": np.array(file.stow_degrees) * unit,
    }


def _from_rpy(angles: np.ndarray) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll), exact where an angle is 0."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]]) @ pitch @ roll
