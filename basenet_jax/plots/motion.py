"""A plan as motion: where base, arm and objects are at any time of its execution."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from basenet_jax.config import PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import joint_move_duration
from basenet_jax.task.navigation import navigation_path
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.scene import Scene


class Motion(NamedTuple):
    """K key states in order of time; in between, everything moves in straight lines."""

    time: Float[np.ndarray, " K"]  # s
    base_pose: Float[np.ndarray, "K 3"]  # (x, y, heading) in W, headings without jumps
    joints: Float[np.ndarray, "K dof"]  # rad
    held: Int[np.ndarray, " K"]  # slot of the object in the gripper from here on; -1: none
    done: Int[np.ndarray, " K"]  # number of objects put down so far

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray, int, int]:
        """Base pose, joints, the slot held (-1: none) and the number of objects put down at a time (s)."""
        pose = np.array([np.interp(time, self.time, column) for column in self.base_pose.T])
        joints = np.array([np.interp(time, self.time, column) for column in self.joints.T])
        key = max(int(np.searchsorted(self.time, time, side="right")) - 1, 0)
        return pose, joints, int(self.held[key]), int(self.done[key])


def plan_motion(robot: Robot, scene: Scene, plan: Plan, outcome: Outcome, config: PickConfig = PickConfig()) -> Motion:
    """The motion of executing a plan; it ends where execution does. Speeds within a drive or move are even.

    Args:
        robot: the robot.
        scene: one scene, not a batch.
        plan: of that scene.
        outcome: of executing it.
        config: of the pick cycle.
    """
    scene, plan, outcome = jax.device_get((scene, plan, outcome))
    keys = _Keys(np.asarray(scene.robot_start, float), np.asarray(robot.home, float))
    durations = np.asarray(_move_durations(robot, outcome.joints), float)
    for step in np.flatnonzero(outcome.is_step & plan.served):
        drive = float(outcome.navigation_time[step])
        if drive > 0:
            path = navigation_path(robot, keys.base_pose[-1], plan.base_pose[step], scene.table)
            keys.drive(_base_poses(path, keys.base_pose[-1], plan.base_pose[step]), drive)
        if outcome.feasible[step]:
            waypoints, slot = np.asarray(outcome.joints[step], float), int(plan.object_index[step])
            _pick(keys, robot, waypoints, durations[step].tolist(), slot, config)
    columns = (keys.time, keys.base_pose, keys.joints, keys.held, keys.done)
    return Motion(*(np.array(column) for column in columns))


class _Keys:
    """Key states as they are added."""

    def __init__(self, base_pose: np.ndarray, joints: np.ndarray):
        self.time, self.base_pose, self.joints, self.held, self.done = [0.0], [base_pose], [joints], [-1], [0]

    def add(self, duration: float, *, base_pose=None, joints=None, held: int | None = None, done: int = 0) -> None:
        """The next key state; what isn't given stays as it is."""
        self.time.append(self.time[-1] + duration)
        self.base_pose.append(self.base_pose[-1] if base_pose is None else base_pose)
        self.joints.append(self.joints[-1] if joints is None else joints)
        self.held.append(self.held[-1] if held is None else held)
        self.done.append(self.done[-1] + done)

    def drive(self, poses: np.ndarray, duration: float) -> None:
        """Over several base poses, the duration shared out by how far it is (1 rad counts as 0.5 m)."""
        moves = np.diff(poses, axis=0)
        shares = np.hypot(moves[:, 0], moves[:, 1]) + 0.5 * np.abs(moves[:, 2])
        for pose, share in zip(poses[1:], shares / shares.sum(), strict=True):
            self.add(float(share) * duration, base_pose=pose)


def _base_poses(path: np.ndarray, start: ArrayLike, goal: ArrayLike) -> np.ndarray:
    """Turn, drive, turn along a polyline, all forward or all in reverse, whichever turns less."""
    start, goal = np.asarray(start, float), np.asarray(goal, float)
    legs = np.diff(path, axis=0)
    legs = legs[np.hypot(legs[:, 0], legs[:, 1]) > 0]
    candidates = []
    for gear in (0.0, np.pi):
        headings = np.unwrap([start[2], *(np.arctan2(legs[:, 1], legs[:, 0]) + gear), goal[2]])
        poses, place = [start], start[:2]
        for leg, heading in zip(legs, headings[1:], strict=False):
            poses.append(np.array([*place, heading]))
            place = place + leg
            poses.append(np.array([*place, heading]))
        poses.append(np.array([*goal[:2], headings[-1]]))
        candidates.append((np.abs(np.diff(headings)).sum(), np.array(poses)))
    return min(candidates, key=lambda candidate: candidate[0])[1]


def _pick(
    keys: _Keys, robot: Robot, waypoints: np.ndarray, durations: list[float], slot: int, config: PickConfig
) -> None:
    to_above, to_grasp, to_stow, to_home = durations
    above, grasp = waypoints[0], waypoints[-1]
    keys.add(to_above, joints=above)
    keys.add(to_grasp, joints=grasp)
    keys.add(config.close_s, held=slot)
    keys.add(to_grasp, joints=above)
    keys.add(to_stow, joints=np.asarray(robot.stow, float))
    keys.add(config.open_s, held=-1, done=1)
    keys.add(to_home, joints=np.asarray(robot.home, float))


@jax.jit
def _move_durations(robot: Robot, joints: Float[Array, "M waypoints dof"]) -> Float[Array, "M 4"]:
    """Durations (s) of each step's moves: home to pre-grasp, on to the grasp, pre-grasp to stow, stow to home."""
    above, grasp = joints[:, 0], joints[:, -1]
    home, stow = (jnp.broadcast_to(jnp.asarray(state), above.shape) for state in (robot.home, robot.stow))
    starts, goals = jnp.stack([home, above, above, stow], axis=1), jnp.stack([above, grasp, stow, home], axis=1)
    return joint_move_duration(robot, starts, goals)
