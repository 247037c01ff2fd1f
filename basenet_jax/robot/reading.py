"""Reading robots: the robot file, and the MJCF that it names."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import functools
import math
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import mujoco
import numpy as np

from basenet_jax.robot.mjcf import Arm, read_arm, read_box
from basenet_jax.robot.model import Robot

Positive = Annotated[float, msgspec.Meta(gt=0)]


class _Frames(msgspec.Struct, forbid_unknown_fields=True):
    arm_base: str
    tool: str


class _BaseLimits(msgspec.Struct, forbid_unknown_fields=True):
    linear: Positive
    angular: Positive


class _Base(msgspec.Struct, forbid_unknown_fields=True):
    footprint: tuple[Positive, Positive]
    body: str
    speed: _BaseLimits
    acceleration: _BaseLimits


class _Deck(msgspec.Struct, forbid_unknown_fields=True):
    center: tuple[float, float]
    size: tuple[Positive, Positive]


class RobotFile(msgspec.Struct, forbid_unknown_fields=True):
    """The robot file (`basenet-robot/1`): everything about a mobile manipulator that its MJCF can't say."""

    format: Literal["basenet-robot/1"]
    name: str
    model: str
    frames: _Frames
    joints: list[str]
    joint_speed: list[Positive]
    joint_acceleration: list[Positive]
    home_degrees: list[float]
    stow_degrees: list[float]
    base: _Base
    deck: _Deck
    arm_geoms: str
    closed_form: Literal["ur"] | None = None


def packaged_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    assets = resources.files("basenet_jax.robot") / "assets"
    return tuple(sorted(entry.name[:-5] for entry in assets.iterdir() if entry.name.endswith(".yaml")))


@functools.cache
def load_robot(name: str = "ur5e_mobile") -> Robot:
    """A packaged robot by its name.

    Raises:
        ValueError: there is no such robot.
    """
    if name not in packaged_robots():
        raise ValueError(f"robot: found {name!r}, allowed are {', '.join(packaged_robots())}")
    with resources.as_file(resources.files("basenet_jax.robot") / "assets") as assets:
        return read_robot(assets / f"{name}.yaml")


def read_robot(path: Path) -> Robot:
    """Reads a robot file and the MJCF that it names.

    Raises:
        ValueError: the file or the model doesn't describe a mobile manipulator; the message names the field.
    """
    try:
        file = msgspec.yaml.decode(path.read_bytes(), type=RobotFile)
    except (OSError, msgspec.MsgspecError) as error:
        raise ValueError(f"{path}: {error}") from error
    model_path = path.parent / file.model
    try:
        model = mujoco.MjModel.from_xml_path(str(model_path))
    except ValueError as error:
        raise ValueError(f"{path}: model: {model_path} can't be read: {error}") from error
    try:
        return _build(file, model, str(model_path))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _build(file: RobotFile, model: mujoco.MjModel, model_path: str) -> Robot:
    frames = file.frames
    arm = read_arm(model, joints=file.joints, arm_base=frames.arm_base, tool=frames.tool, arm_geoms=file.arm_geoms)
    body_center, body_half_size = read_box(model, file.base.body)
    speed, acceleration = file.base.speed, file.base.acceleration
    sliding = tuple(bool(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE) for j in arm.joint_ids)
    leaves: dict[str, Any] = {
        **_arm_leaves(arm, model),
        **_joint_leaves(file, sliding),
        "body_center": body_center,
        "body_half_size": body_half_size,
        "footprint_half_size": np.array(file.base.footprint) / 2,
        "base_speed": np.array([speed.linear, speed.angular]),
        "base_acceleration": np.array([acceleration.linear, acceleration.angular]),
        "deck": np.array([*file.deck.center, *file.deck.size]),
    }
    return Robot(
        **leaves,
        name=file.name,
        model_path=model_path,
        joint_names=tuple(file.joints),
        prismatic=sliding,
        capsule_link=tuple(capsule.link for capsule in arm.capsules),
        capsule_geoms=tuple(capsule.name for capsule in arm.capsules),
        body_geom=file.base.body,
        closed_form=file.closed_form,
    )


def _arm_leaves(arm: Arm, model: mujoco.MjModel) -> dict[str, np.ndarray]:
    return {
        "joint_rotation": np.stack([rotation for rotation, _ in arm.steps]),
        "joint_position": np.stack([position for _, position in arm.steps]),
        "tool_rotation": arm.tool[0],
        "tool_position": arm.tool[1],
        "mount_rotation": arm.mount[0],
        "mount_position": arm.mount[1],
        "joint_lower": model.jnt_range[arm.joint_ids, 0].copy(),
        "joint_upper": model.jnt_range[arm.joint_ids, 1].copy(),
        "capsule_start": np.stack([capsule.start for capsule in arm.capsules]),
        "capsule_end": np.stack([capsule.end for capsule in arm.capsules]),
        "capsule_radius": np.array([capsule.radius for capsule in arm.capsules]),
    }


def _joint_leaves(file: RobotFile, sliding: tuple[bool, ...]) -> dict[str, np.ndarray]:
    unit = np.where(sliding, 1.0, math.pi / 180.0)
    per_joint = {
        "joint_speed": file.joint_speed,
        "joint_acceleration": file.joint_acceleration,
        "home_degrees": file.home_degrees,
        "stow_degrees": file.stow_degrees,
    }
    for field, values in per_joint.items():
        if len(values) != len(file.joints):
            raise ValueError(f"{field}: found {len(values)} values, needs one for each of {len(file.joints)} joints")
    return {
        "joint_speed": np.array(file.joint_speed),
        "joint_acceleration": np.array(file.joint_acceleration),
        "home": np.array(file.home_degrees) * unit,
        "stow": np.array(file.stow_degrees) * unit,
    }
