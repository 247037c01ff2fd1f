"""Pick times one pair of base pose and object at a time, as planners compute them that are written with ordinary tools.

EAIK solves one tool pose per call, MuJoCo in C tests one joint state per call, NumPy does the rest. The definitions are
the package's (see `task.picking`): rules 2 to 4, both grasp yaws, all branches, the fastest feasible solution. It
saves work where such a planner would: pairs out of the arm's sphere cost a distance only (if asked for), heights
without a solution end a descent, durations come before collisions, and the fastest solution that is free of them ends
the search.
"""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from basenet_jax.config import PickConfig
from basenet_jax.planners.candidates import REACH_MARGIN
from basenet_jax.robot.kinematics import reach_sphere
from basenet_jax.robot.model import Robot
from basenet_jax.task.arm_solutions import heights, turns
from basenet_jax.task.pick_search import checked_fractions
from basenet_jax.world.boxes import Room
from basenet_jax.world.mujoco_scene import MujocoChecker
from benchmarks.peer_arms import eaik_arm

Joints = Float[np.ndarray, "6"]
Waypoints = Float[np.ndarray, "waypoints 6"]
_TURN = 2 * np.pi


class OneAtATime:
    """Costs one pair after another.

    Args:
        robot: with float64 leaves, as read from its files.
        table: one table.
        config: of the picks.
        sphere: whether pairs that are out of the arm's sphere are told by their distance, instead of by EAIK.

    Raises:
        ModuleNotFoundError: EAIK isn't installed.
    """

    def __init__(self, robot: Robot, room: Room, config: PickConfig = PickConfig(), *, sphere: bool = True):
        """Makes EAIK's robot and MuJoCo's model."""
        self._arm, self._checker, self._config = eaik_arm(robot), MujocoChecker(robot, room, config), config
        self._robot = dataclasses.replace(
            robot, **{name: np.asarray(getattr(robot, name)) for name in ("home", "stow", "joint_lower", "joint_upper")}
        )
        center, radius = reach_sphere(robot)
        self._in_base = np.asarray(robot.mount_position + robot.mount_rotation @ center)
        self._reach = float(radius) + REACH_MARGIN if sphere else np.inf
        self._mount = np.eye(4)
        self._mount[:3, :3], self._mount[:3, 3] = robot.mount_rotation, robot.mount_position

    def pick_time(self, base_pose: Float[np.ndarray, "3"], grasp: Float[np.ndarray, "4"]) -> float:
        """Duration (s) of the fastest pick of a grasp (tool0's x, y, z, yaw in W) from a base pose; else infinite."""
        base = _transform(base_pose[0], base_pose[1], 0.0, base_pose[2])
        center = base[:3, :3] @ self._in_base + base[:3, 3]
        if np.linalg.norm(grasp[:3] - center) > self._reach:
            return np.inf
        to_arm = np.linalg.inv(base @ self._mount)
        found = [each for turn in range(turns(self._config)) for each in self._descents(to_arm, grasp, turn * np.pi)]
        for time, joints in sorted(found, key=lambda each: each[0]):
            states = self._checked_states(joints)
            if not self._checker.arm_touches(np.broadcast_to(base_pose, (len(states), 3)), states).any():
                return time
        return np.inf

    def _descents(self, to_arm: np.ndarray, grasp: np.ndarray, turn: float) -> list[tuple[float, Waypoints]]:
        """Durations and waypoints of every branch that goes down to the grasp without a jump."""
        solutions = []
        for height in heights(self._config):
            target = to_arm @ _transform(grasp[0], grasp[1], grasp[2] + height, grasp[3] + turn) @ _POINTING_DOWN
            solutions.append(_exact(self._arm.IK(target)))
            if not len(solutions[-1]):
                return []
        waypoints = [self._nearest_equivalents(solutions[0], np.asarray(self._robot.home))]
        for below in solutions[1:]:
            candidates = self._nearest_equivalents(below[None], waypoints[-1][:, None])
            apart = np.abs(candidates - waypoints[-1][:, None]).max(axis=-1)
            waypoints.append(candidates[np.arange(len(apart)), apart.argmin(axis=1)])
        joints = np.stack(waypoints, axis=1)
        inside = ((joints >= self._robot.joint_lower) & (joints <= self._robot.joint_upper)).all(axis=(1, 2))
        smooth = (np.abs(np.diff(joints, axis=1)) <= self._config.max_descent_step_rad).all(axis=(1, 2))
        return [(self._cycle_time(each[0], each[-1]), each) for each in joints[inside & smooth]]

    def _nearest_equivalents(self, joints: np.ndarray, to: np.ndarray) -> np.ndarray:
        """The equivalents, whole turns apart and inside the limits where there are any, nearest to other joints."""
        nearest = joints + _TURN * np.round((to - joints) / _TURN)
        nearest = np.where(nearest > self._robot.joint_upper, nearest - _TURN, nearest)
        return np.where(nearest < self._robot.joint_lower, nearest + _TURN, nearest)

    def _cycle_time(self, pregrasp: Joints, grasp: Joints) -> float:
        home, stow = self._robot.home, self._robot.stow
        moves = [(home, pregrasp), (pregrasp, grasp), (grasp, pregrasp), (pregrasp, stow), (stow, home)]
        return sum(self._move_time(*move) for move in moves) + self._config.close_s + self._config.open_s

    def _move_time(self, start: Joints, goal: Joints) -> float:
        """Duration (s) of the slowest joint's trapezoidal profile."""
        distance, speed = np.abs(goal - start), np.asarray(self._robot.joint_speed)
        acceleration = np.asarray(self._robot.joint_acceleration)
        long = distance / speed + speed / acceleration
        return float(np.max(np.where(distance * acceleration < speed**2, 2 * np.sqrt(distance / acceleration), long)))

    def _checked_states(self, joints: Waypoints) -> Float[np.ndarray, "states 6"]:
        """Rule 4's: the waypoints, and points inside the moves from home to pre-grasp and from there to stow."""
        share = checked_fractions(self._config)[:, None]
        coming = self._robot.home + share * (joints[0] - self._robot.home)
        going = joints[0] + share * (self._robot.stow - joints[0])
        return np.concatenate([joints, coming, going])


_POINTING_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def _transform(x: float, y: float, z: float, yaw: float) -> np.ndarray:
    sine, cosine = np.sin(yaw), np.cos(yaw)
    return np.array([[cosine, -sine, 0, x], [sine, cosine, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def _exact(solutions: Any) -> Float[np.ndarray, "S 6"]:
    """EAIK's solutions without those that only come near."""
    return np.asarray(solutions.Q).reshape(-1, 6)[~np.asarray(solutions.is_LS, bool)]
