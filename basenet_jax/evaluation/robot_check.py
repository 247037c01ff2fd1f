"""Is a robot what its owner thinks? Measured: kinematics beside MuJoCo's, inverse kinematics, and what it serves."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.config import WorldConfig
from basenet_jax.documents.fields import DocumentError
from basenet_jax.evaluation.servable import Served, serve
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.robot.assembly import fixed_joints
from basenet_jax.robot.fields import GRASP_DEPTH_M
from basenet_jax.robot.ik import solve_ik
from basenet_jax.robot.kinematics import forward_kinematics, geometric_jacobian
from basenet_jax.robot.model import Robot
from basenet_jax.robot.model_arm import find_frame, find_tool, start_state
from basenet_jax.robot.reading import Source
from basenet_jax.robot.rest import check_tables
from basenet_jax.robot.set_up import set_up_faults
from basenet_jax.robot.tool import axis_turns, tool_place
from basenet_jax.robot.ur_frames import with_closed_form
from basenet_jax.task.arm_solutions import lattice
from basenet_jax.world.boxes import Room, surface_top

LARGEST_DIFFERENCE = 1e-9  # m and 1: float64's rounding over an arm, with room
_STATES = 200
_IK_TARGETS, _IK_SEEDS = 64, 32
_FEWER_GRASPS, _EVERY = 16, 3  # for alternatives: grasps, and every so manieth base pose
_RISES_M = (0.2, -0.2, 0.4, -0.4, 0.6, -0.6, 0.8)


class Difference(NamedTuple):
    """Largest differences from MuJoCo over random states."""

    position_m: float
    rotation: float  # of the entries of matrices
    jacobian: float  # likewise

    @property
    def is_small(self) -> bool:
        """Whether they are rounding."""
        return max(self) <= LARGEST_DIFFERENCE


class Cause(NamedTuple):
    """A change of the robot that was tried because it serves little, and what that comes to."""

    what: str
    share: float  # of the grasps, served by the changed robot


def compare_with_mujoco(source: Source, seed: int = 0) -> Difference:
    """Forward kinematics and Jacobian, in float64, beside MuJoCo's on the robot's own model."""
    robot, file, model = source.robot, source.file, source.model
    joints = np.random.default_rng(seed).uniform(robot.joint_lower, robot.joint_upper, (_STATES, robot.dof))
    with jax.enable_x64(True):
        compute = jax.jit(lambda robot, q: (*forward_kinematics(robot, q), geometric_jacobian(robot, q)))
        found = [np.asarray(x) for x in compute(robot, jnp.asarray(joints))]
    data = start_state(model, fixed_joints(file, model))
    ids = [model.joint(name).id for name in file.joints]
    worst = np.zeros(3)
    for state, *own in zip(joints, *found, strict=True):
        data.qpos[model.jnt_qposadr[ids]] = state
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        _, (base_rotation, base_position) = find_frame(model, data, "frames.arm_base", file.frames.arm_base)
        body, (rotation, position) = find_tool(model, data, tool_place(file))
        linear, angular = np.zeros((2, 3, model.nv))
        mujoco.mj_jac(model, data, linear, angular, position, body)
        columns = model.jnt_dofadr[ids]
        jacobian = np.concatenate([base_rotation.T @ linear[:, columns], base_rotation.T @ angular[:, columns]])
        expected = (base_rotation.T @ (position - base_position), base_rotation.T @ rotation, jacobian)
        worst = np.maximum(worst, [np.max(np.abs(a - b)) for a, b in zip(own, expected, strict=True)])
    return Difference(*worst.tolist())


def solved_share(robot: Robot, seed: int = 0) -> float:
    """Of random poses that the arm reaches: those that damped least squares finds from one of the lattice's seeds."""
    joints = np.random.default_rng(seed).uniform(robot.joint_lower, robot.joint_upper, (_IK_TARGETS, robot.dof))
    return float(np.mean(_solved(robot, joints.astype(np.float32))))


@jax.jit
def _solved(robot: Robot, joints: Float[Array, "N dof"]) -> Bool[Array, " N"]:
    position, rotation = forward_kinematics(robot, joints)
    seeds = jnp.asarray(lattice(robot, _IK_SEEDS), joints.dtype)
    return jnp.any(solve_ik(robot, position[:, None], rotation[:, None], seeds).converged, axis=1)


def rest_faults(source: Source, room: Room, world: WorldConfig = WorldConfig()) -> list[str]:
    """What is wrong with the tool frame, and what home, stow and the move between them make the arm touch."""
    faults = set_up_faults(source.file, source.robot, world.pick)
    try:
        check_tables(source.robot, surface_top(room), world.pick)
    except DocumentError as error:
        faults.append(str(error))
    return faults


def check_service(
    robot: Robot, grasps: Float[np.ndarray, "N 4"], room: Room, world: WorldConfig = WorldConfig()
) -> tuple[Served, float]:
    """What is served from stops in line with the table, and how many pick evaluations a second that took, warm."""
    poses = aligned_poses(robot, room, pick=world.pick)
    serve(robot, grasps[:1], poses[:1], room, world)  # compiles
    served = serve(robot, grasps, poses, room, world)
    return served, served.evaluations / served.evaluating_s


def find_causes(
    robot: Robot, grasps: Float[np.ndarray, "N 4"], room: Room, world: WorldConfig = WorldConfig()
) -> list[Cause]:
    """Why a robot serves little: the single changes that make it serve more, the most helpful first.

    Each is tried on a few grasps and base poses, in the program that is compiled already.
    """
    poses = aligned_poses(robot, room, pick=world.pick)[::_EVERY]

    def share(robot: Robot) -> float:
        return serve(robot, grasps[:_FEWER_GRASPS], poses, room, world).share

    present = share(robot)
    tried = [Cause(what, share(changed)) for what, changed in _alternatives(robot)]
    return sorted((cause for cause in tried if cause.share > present), key=lambda cause: -cause.share)


def _planned(robot: Robot) -> Robot:
    """The changed robot with the closed form for its new tool frame, where it has one."""
    return jax.device_put(with_closed_form(jax.device_get(robot))) if robot.closed_form else robot


def _alternatives(robot: Robot) -> Iterator[tuple[str, Robot]]:
    """The robot changed in one way each, and the change in words."""
    rotation, position = np.asarray(robot.tool_rotation), np.asarray(robot.tool_position)
    tried = [np.eye(3)]
    for turn, change in axis_turns().items():
        # A gripper that is turned by pi about its z is the same.
        if not any(
            np.array_equal(np.abs(change.T @ other), np.eye(3)) and change[:, 2] @ other[:, 2] > 0 for other in tried
        ):
            tried.append(change)
            yield (
                f"tool frame: turned by rotation_rpy_degrees: {list(turn)} (its z has to point out of the gripper)",
                _planned(robot.replace(tool_rotation=rotation @ change)),
            )
    yield (
        "tool frame: with grasp_depth: 0 (the tool frame is where the fingers meet)",
        _planned(robot.replace(tool_position=position - GRASP_DEPTH_M * rotation[:, 2])),
    )
    for rise in _RISES_M:
        position = np.asarray(robot.mount_position) + np.array([0.0, 0.0, rise])
        yield (
            f"mount height: {abs(rise):g} m {'higher' if rise > 0 else 'lower'}",
            robot.replace(mount_position=position),
        )
    free = np.where(np.array(robot.prismatic), 1.0, 2.0 * np.pi)
    lower, upper = np.minimum(robot.joint_lower, -free), np.maximum(robot.joint_upper, free)
    yield (
        "joint limits: with a whole turn either way (1 m of slides)",
        robot.replace(joint_lower=lower, joint_upper=upper),
    )
    never = np.full_like(np.asarray(robot.capsule_radius), -1.0)
    yield (
        "shapes: with an arm that touches nothing (are its shapes too wide, or home or stow in the body?)",
        robot.replace(capsule_radius=never),
    )
