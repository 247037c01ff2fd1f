"""The second opinion: executed picks replayed in MuJoCo, in float64 and with MuJoCo's own kinematics and contacts.

The judge (`task.plan.execute`) is compiled kernels in float32. Here every pick that it found feasible is tried again
by other means; a pick that MuJoCo finds impossible is a disagreement, and counts as not grasped.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import dataclasses
from collections.abc import Hashable

import jax
import mujoco
import numpy as np
from jaxtyping import Float, Int

from basenet_jax.config import PickConfig, WorldConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.robot_mjcf import TOOL_SITE
from basenet_jax.task.arm_solutions import heights
from basenet_jax.task.picking import Reason, checked_fractions
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.boxes import Room, fingerprint
from basenet_jax.world.mujoco_scene import ROBOT, MujocoChecker, state_addresses
from basenet_jax.world.scene import Scene

# tool0 at yaw 0 of a top-down grasp, Rx(pi): x along W's x, z down.
_POINTING_DOWN = np.diag([1.0, -1.0, -1.0])


class PickReplay:
    """Replays picks in one room: rules 1, 4 and 2 as MuJoCo sees them.

    Args:
        robot: the robot.
        room: one concrete room.
        config: heights, clearances and tolerances of the pick cycle.
    """

    def __init__(self, robot: Robot, room: Room, config: PickConfig = PickConfig()):
        self._checker = MujocoChecker(robot, room, config)
        self._config = config
        self._home, self._stow = np.asarray(robot.home, float), np.asarray(robot.stow, float)
        self._addresses = state_addresses(robot, self._checker.model)
        self._site = self._checker.model.site(ROBOT + TOOL_SITE).id

    def broken_rule(
        self,
        base_pose: Float[np.ndarray, "3"],
        joints: Float[np.ndarray, "waypoints dof"],
        grasp: Float[np.ndarray, "4"],
    ) -> Reason:
        """The first rule that a pick breaks in MuJoCo; `Reason.NONE` where it breaks none.

        Args:
            base_pose: of the base, (x, y, heading) in W.
            joints: rad, at pre-grasp, the heights in between from top to bottom, and grasp.
            grasp: of tool0, (x, y, z, yaw) in W.
        """
        joints = np.asarray(joints, float)
        if self._checker.base_touches(np.asarray(base_pose, float)[None])[0]:
            return Reason.BASE_COLLIDES
        if not self._reaches(base_pose, joints, np.asarray(grasp, float)):
            return Reason.OUT_OF_REACH
        states = self._swept_states(joints)
        poses = np.broadcast_to(np.asarray(base_pose, float), (len(states), 3))
        return Reason.ARM_COLLIDES if self._checker.arm_touches(poses, states).any() else Reason.NONE

    def _reaches(self, base_pose: np.ndarray, joints: np.ndarray, grasp: np.ndarray) -> bool:
        """Whether tool0 is where it should be at every waypoint, with one of the allowed gripper yaws throughout."""
        position, rotation = self._tool_poses(base_pose, joints)
        target = grasp[:3] + np.outer(heights(self._config), [0.0, 0.0, 1.0])
        near = np.linalg.norm(position - target, axis=1) <= self._config.position_tolerance_m
        turns = (0.0, np.pi) if self._config.gripper_symmetric else (0.0,)
        turned = [_angles(rotation, grasp[3] + turn).max() <= self._config.orientation_tolerance_rad for turn in turns]
        return bool(near.all() and any(turned))

    def _tool_poses(self, base_pose: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """tool0's positions (m) and rotation matrices in W."""
        model, data = self._checker.model, self._checker.data
        position, rotation = np.empty((len(joints), 3)), np.empty((len(joints), 3, 3))
        for index, state in enumerate(joints):
            data.qpos[self._addresses] = [*base_pose, *state]
            mujoco.mj_kinematics(model, data)
            position[index] = data.site_xpos[self._site]
            rotation[index] = data.site_xmat[self._site].reshape(3, 3)
        return position, rotation

    def _swept_states(self, joints: np.ndarray) -> np.ndarray:
        """Rule 4's joint states: the waypoints and the points inside the moves home to pre-grasp to stow."""
        fractions = checked_fractions(self._config)[:, None]
        coming = self._home + fractions * (joints[0] - self._home)
        going = joints[0] + fractions * (self._stow - joints[0])
        return np.concatenate([joints, coming, going])


def replay(
    robot: Robot, scenes: Scene, plans: Plan, outcomes: Outcome, config: WorldConfig = WorldConfig()
) -> Int[np.ndarray, "B M"]:
    """Replays every executed, feasible pick of a batch of plans; about 0.5 ms each.

    Args:
        robot: the robot.
        scenes: a batch of B scenes.
        plans: of these scenes.
        outcomes: of executing the plans.
        config: of the pick cycle.

    Returns:
        For every step a `Reason`: the first rule that MuJoCo finds broken where the judge found none; else `NONE`.
    """
    scenes, plans, outcomes = jax.device_get((scenes, plans, outcomes))
    grasps = np.asarray(scenes.grasps)
    replays: dict[Hashable, PickReplay] = {}
    broken = np.full(outcomes.feasible.shape, Reason.NONE, np.int32)
    for row, step in np.argwhere(outcomes.feasible):
        room = jax.tree.map(lambda x, row=row: x[row], scenes.room)
        key = fingerprint(room)
        if key not in replays:
            replays[key] = PickReplay(robot, room, config.pick)
        grasp = grasps[row, plans.object_index[row, step]]
        pose, joints = np.asarray(plans.base_pose[row, step]), np.asarray(outcomes.joints[row, step])
        broken[row, step] = replays[key].broken_rule(pose, joints, grasp)
    return broken


def confirmed(outcomes: Outcome, broken: Int[np.ndarray, "B M"]) -> Outcome:
    """The outcomes with every pick that `replay` found impossible counted as not grasped; its pick time is 0."""
    agreed, least = np.asarray(broken) == Reason.NONE, outcomes.least_singular_value
    return dataclasses.replace(
        outcomes,
        feasible=outcomes.feasible & agreed,
        reason=np.where(agreed, outcomes.reason, broken),
        pick_time=np.where(agreed, outcomes.pick_time, 0.0),
        least_singular_value=None if least is None else np.where(agreed, least, 0.0),
    )


def _angles(rotation: Float[np.ndarray, "N 3 3"], yaw: float) -> Float[np.ndarray, " N"]:
    """Angles (rad) between rotations and the top-down grasp of a yaw."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    target = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ _POINTING_DOWN
    # |A - B|_F = 2 sqrt(2) sin(angle / 2), which unlike the trace keeps its digits at small angles.
    chord = np.linalg.norm(rotation - target, axis=(1, 2)) / (2 * np.sqrt(2))
    return 2 * np.arcsin(np.minimum(chord, 1.0))
