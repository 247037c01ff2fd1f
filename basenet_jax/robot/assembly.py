"""A robot's arrays, from its file and from what its model says of the arm."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import math
from typing import Any

import mujoco
import numpy as np

from basenet_jax.robot import seven
from basenet_jax.robot.arm_shapes import self_pairs
from basenet_jax.robot.fields import RobotFile
from basenet_jax.robot.model import Robot
from basenet_jax.robot.model_arm import Arm, Capsule
from basenet_jax.robot.tool import from_rpy_degrees
from basenet_jax.robot.ur_frames import with_closed_form

_WHOLE_TURN = 2.0 * math.pi  # either way, for a turning joint without limits


def build_robot(file: RobotFile, model: mujoco.MjModel, arm: Arm) -> Robot:
    """The robot, in SI units, without the MJCF of its own (`Robot.model_xml`).

    Args:
        file: the robot file.
        model: the file's model, compiled.
        arm: read from it.
    """
    speed, acceleration, body = file.base.speed, file.base.acceleration, file.base.body
    sliding = tuple(bool(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE) for j in arm.joint_ids)
    tested = [capsule for capsule in arm.capsules if capsule.link > 0]  # the arm's base never moves against its own
    leaves: dict[str, Any] = {
        **_arm_leaves(arm, model, tested),
        **_joint_leaves(file, sliding),
        "mount_rotation": from_rpy_degrees(file.mount.rpy_degrees),
        "mount_position": np.array(file.mount.position),
        "body_center": np.array(body.center),
        "body_half_size": np.array(body.size) / 2,
        "footprint_half_size": np.array(file.base.footprint) / 2,
        "base_speed": np.array([speed.linear, speed.angular]),
        "base_acceleration": np.array([acceleration.linear, acceleration.angular]),
        "deck": np.array([*file.deck.center, *file.deck.size]),
    }
    robot = Robot(
        **leaves,
        name=file.name,
        model_xml="",
        joint_names=tuple(file.joints),
        prismatic=sliding,
        capsule_link=tuple(capsule.link for capsule in tested),
        closed_form=None,
        omnidirectional=file.drive == "omnidirectional",
    )
    robot = robot.replace(self_pairs=self_pairs(robot))
    if file.closed_form == "none":
        return robot
    if seven.is_spherical_shouldered(robot):
        return robot.replace(closed_form=seven.NAME)
    return with_closed_form(robot)


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


def fixed_joints(file: RobotFile, model: mujoco.MjModel) -> dict[str, float]:
    """Where the robot file's fixed joints stay (rad or m); names that the model hasn't are left as they are."""

    def in_si(name: str, value: float) -> float:
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        slides = joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        return float(value) if slides else math.radians(value)

    return {name: in_si(name, value) for name, value in file.fixed.items()}


def _joint_leaves(file: RobotFile, sliding: tuple[bool, ...]) -> dict[str, np.ndarray]:
    unit = np.where(sliding, 1.0, math.pi / 180.0)
    return {
        "joint_speed": np.array(file.joint_speed),
        "joint_acceleration": np.array(file.joint_acceleration),
        "home": np.array(file.home_degrees) * unit,
        "stow": np.array(file.stow_degrees) * unit,
    }
