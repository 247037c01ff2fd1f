"""The same arm in other packages, each used as its own documentation shows; imports a package only when asked for it.

EAIK and ur-analytic-ik are C++ with closed forms, mink is differential inverse kinematics: a quadratic program with
the joints' limits for each step, set up in Python. All compute in float64 on one core; the package's kernels compute
in float32 on all of them.
"""

# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
# (MuJoCo's compiled module comes without type stubs, and the peers need not be installed.)

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float

from basenet_jax.robot.kinematics import forward_kinematics
from basenet_jax.robot.model import Robot
from basenet_jax.task.arm_solutions import make_picks, tool_target
from basenet_jax.world.grasps import top_down

TOOL_SITE = "tool0"

Poses = Float[np.ndarray, "B 4 4"]  # of the tool frame in the arm's base frame, homogeneous, m


def tool_poses(robot: Robot, joints: Float[np.ndarray, "B dof"]) -> Poses:
    """The tool's poses at joints, in float64: the peers' own checks reject poses that are rotations in float32 only.

    Args:
        robot: with float64 leaves, as read from its files.
        joints: rad.
    """
    with jax.enable_x64(True):
        position, rotation = jax.jit(forward_kinematics)(robot, jnp.asarray(joints, float))
    return homogeneous(np.asarray(position), np.asarray(rotation))


def grasp_poses(robot: Robot, base_pose: Float[np.ndarray, "B 3"], grasp: Float[np.ndarray, "B 4"]) -> Poses:
    """The tool's poses at grasps, seen from base poses, in float64; the gripper not turned.

    Args:
        robot: likewise.
        base_pose: (x, y, heading) in W.
        grasp: tool0's (x, y, z, yaw) in W.
    """
    with jax.enable_x64(True):
        picks = make_picks(jnp.asarray(base_pose, float), top_down(jnp.asarray(grasp, float)))
        target = jax.jit(tool_target)(robot, picks.by(jnp.zeros(len(grasp), int)), 0.0, 0.0)
        position = jnp.stack(target.origin, axis=-1)
        columns = [jnp.broadcast_to(jnp.stack(jnp.broadcast_arrays(*axis), -1), position.shape) for axis in target[:3]]
        return homogeneous(np.asarray(position), np.asarray(jnp.stack(columns, axis=-1)))


def homogeneous(position: Float[np.ndarray, "B 3"], rotation: Float[np.ndarray, "B 3 3"]) -> Poses:
    """Poses as matrices."""
    poses = np.tile(np.eye(4), (len(position), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotation, position
    return poses


def eaik_arm(robot: Robot) -> Any:
    """EAIK's robot from the arm's DH parameters: link i's frame is Rz(q) Tz(d) Tx(a) Rx(alpha) of the one before.

    Raises:
        ModuleNotFoundError: EAIK isn't installed.
    """
    from eaik.IK_DH import DhRobot

    position, rotation = np.asarray(robot.joint_position)[1:], np.asarray(robot.joint_rotation)[1:]
    alpha = np.append(np.arctan2(rotation[:, 2, 1], rotation[:, 1, 1]), 0.0)
    ends = np.concatenate([position, np.asarray(robot.tool_position)[None]])
    return DhRobot(alpha, ends[:, 0].copy(), ends[:, 2].copy())


def solve_by_eaik(arm: Any, poses: Poses, threads: int = 1) -> Any:
    """All solutions of each pose, by EAIK's call for batches; by that for one pose if there is only one."""
    return arm.IK(poses[0]) if len(poses) == 1 else arm.IK_batched(poses, threads)


def solve_by_ur_analytic_ik(poses: Poses) -> list[Any]:
    """All solutions of each pose; ur-analytic-ik takes one at a time and has Universal Robots' own DH parameters.

    Raises:
        ModuleNotFoundError: ur-analytic-ik isn't installed.
    """
    from ur_analytic_ik import ur5e

    return [ur5e.inverse_kinematics(pose) for pose in poses]


class MinkSolution(NamedTuple):
    """What mink came to on a batch."""

    converged: np.ndarray
    iterations: int  # all poses together


def mink_solver(
    robot: Robot, *, iterations: int, position_tolerance_m: float, orientation_tolerance_rad: float
) -> Callable[[Poses, Float[np.ndarray, "B dof"]], MinkSolution]:
    """Inverse kinematics by mink: a `FrameTask` for the tool, the joints' limits, QPs by DAQP, until it has converged.

    With mink's default gain of 1 a step is to remove the whole error, so that the time step plays no part. The damping
    is the one of 1e-6, 1e-3, 0.1 and 1 with which most poses converged.

    Raises:
        ModuleNotFoundError: mink isn't installed.
    """
    import mink

    model = arm_model(robot)
    configuration = mink.Configuration(model)
    task = mink.FrameTask(TOOL_SITE, "site", position_cost=1.0, orientation_cost=1.0, lm_damping=0.1)
    limits = [mink.ConfigurationLimit(model)]
    mount = homogeneous(np.asarray(robot.mount_position)[None], np.asarray(robot.mount_rotation)[None])[0]
    dt = 1.0

    def solve(poses: Poses, seeds: Float[np.ndarray, "B dof"]) -> MinkSolution:
        converged, steps = np.zeros(len(poses), bool), 0
        for index, (pose, seed) in enumerate(zip(mount @ poses, seeds, strict=True)):
            task.set_target(mink.SE3.from_matrix(pose))
            configuration.update(seed)
            for _ in range(iterations):
                velocity = mink.solve_ik(configuration, [task], dt, "daqp", limits=limits)
                configuration.integrate_inplace(velocity, dt)
                steps += 1
                error = task.compute_error(configuration)
                near = np.linalg.norm(error[:3]) <= position_tolerance_m
                if near and np.linalg.norm(error[3:]) <= orientation_tolerance_rad:
                    converged[index] = True
                    break
        return MinkSolution(converged, steps)

    return solve


def arm_model(robot: Robot) -> mujoco.MjModel:
    """The robot's MJCF with its base standing at W's origin for good: the arm's joints are all that is left."""
    spec = mujoco.MjSpec.from_string(robot.model_xml)
    for joint in list(spec.joints):
        if joint.name not in robot.joint_names:
            spec.delete(joint)
    return spec.compile()
