"""A plan as motion: where base, arm and objects are at any time of its execution."""

import dataclasses
import enum
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from basenet_jax.config import WorldConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.time_law import TimeLaw, joint_move_law
from basenet_jax.task.drives import OwnDrives, make_drives
from basenet_jax.task.manoeuvre import Leg, Manoeuvre
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.scene import Scene

_LEAST_DRIVE_S = 1e-3  # where a table says 0


class Doing(enum.StrEnum):
    """What the robot does in one part of a motion."""

    TURN = "turn"
    DRIVE = "drive"
    REACH = "home to pre-grasp"
    DESCEND = "pre-grasp to grasp"
    CLOSE = "close gripper"
    LIFT = "grasp to pre-grasp"
    CARRY = "pre-grasp to stow"
    OPEN = "open gripper"
    RETURN = "stow to home"


class Part(NamedTuple):
    """What happens between two key states."""

    doing: Doing
    step: int  # of the plan
    law: TimeLaw
    leg: Leg | None = None  # of a drive


class Motion(NamedTuple):
    """K key states in order of time; between two of them everything moves in a straight line, from rest to rest."""

    time: Float[np.ndarray, " K"]  # s
    base_pose: Float[np.ndarray, "K 3"]  # (x, y, heading) in W, headings without jumps
    joints: Float[np.ndarray, "K dof"]  # rad
    held: Int[np.ndarray, " K"]  # slot of the object in the gripper from here on; -1: none
    done: Int[np.ndarray, " K"]  # number of objects put down so far
    parts: tuple[Part, ...]  # K - 1

    def at(self, time: float) -> tuple[np.ndarray, np.ndarray, int, int]:
        """Base pose, joints, the slot held (-1: none) and the number of objects put down at a time (s)."""
        key = max(int(np.searchsorted(self.time, time, side="right")) - 1, 0)
        held, done = int(self.held[key]), int(self.done[key])
        if key == len(self.parts):
            return self.base_pose[-1], self.joints[-1], held, done
        share = float(self.parts[key].law.at(time - self.time[key]).share)
        pose, joints = (x[key] + share * (x[key + 1] - x[key]) for x in (self.base_pose, self.joints))
        return pose, joints, held, done


def plan_motion(
    robot: Robot,
    scene: Scene,
    plan: Plan,
    outcome: Outcome,
    config: WorldConfig = WorldConfig(),
    *,
    smoothing_s: float = 0.0,
    given_times: bool = False,
) -> Motion:
    """The motion of executing a plan, every part as fast as the robot's limits allow; it ends where execution does.

    Drives take the time that the judge says. Arm moves are straight lines in joint space: they take a little longer
    than the judge's closed form where one joint is held up by its speed and another by its acceleration.

    Args:
        robot: the robot.
        scene: one scene, not a batch.
        plan: of that scene.
        outcome: of executing it; only steps with `is_step` are gone through.
        config: of drives and the pick cycle.
        smoothing_s: of arm moves, see `TimeLaw`.
        given_times: the judge's drive times are somebody else's (`DriveTimes`), and the robot's own drives are slowed
            down or sped up to them.

    Raises:
        ValueError: a drive that the judge was given is none that the robot's own rules allow.
    """
    scene, plan, outcome = jax.device_get((scene, plan, outcome))
    drives = make_drives(robot, scene.room, config.navigation)
    keys = _Keys(robot, np.asarray(scene.robot_start, float), smoothing_s)
    executed = outcome.is_step & plan.served & (outcome.feasible | (outcome.navigation_time > 0))
    for step in np.flatnonzero(executed).tolist():
        keys.step = step
        lasts_s = float(outcome.navigation_time[step]) if given_times else None
        keys.drive(drives, np.asarray(plan.base_pose[step], float), config.navigation.same_pose, lasts_s)
        if outcome.feasible[step]:
            waypoints = np.asarray(outcome.joints[step], float)
            keys.pick(waypoints[0], waypoints[-1], int(plan.object_index[step]), config)
    columns = (keys.time, keys.base_pose, keys.joints, keys.held, keys.done)
    return Motion(*(np.array(column) for column in columns), parts=tuple(keys.parts))


class _Keys:
    """Key states as they are added."""

    def __init__(self, robot: Robot, base_pose: np.ndarray, smoothing_s: float):
        self._robot, self._smoothing_s = robot, smoothing_s
        self.step = 0
        self.time, self.base_pose, self.joints = [0.0], [base_pose], [np.asarray(robot.home, float)]
        self.held, self.done = [-1], [0]
        self.parts: list[Part] = []

    def drive(self, drives: OwnDrives, goal: np.ndarray, same_pose: float, lasts_s: float | None) -> None:
        """The legs of the drive to a base pose, unless the robot is there; in so many seconds, if these are given."""
        start = self.base_pose[-1]
        turn = (goal[2] - start[2] + np.pi) % (2.0 * np.pi) - np.pi
        if np.hypot(*(goal - start)[:2]) <= same_pose and abs(turn) <= same_pose:
            return
        manoeuvre = drives.manoeuvre(self._robot, start, goal)
        for leg in (manoeuvre if lasts_s is None else _lasting(manoeuvre, lasts_s)).legs:
            self._add(Doing.TURN if leg.turn else Doing.DRIVE, leg.law, leg=leg)

    def pick(self, above: np.ndarray, grasp: np.ndarray, slot: int, config: WorldConfig) -> None:
        """The pick cycle over two joint states."""
        self._move(Doing.REACH, above)
        self._move(Doing.DESCEND, grasp)
        self._add(Doing.CLOSE, _pause(config.pick.close_s), held=slot)
        self._move(Doing.LIFT, above)
        self._move(Doing.CARRY, np.asarray(self._robot.stow, float))
        self._add(Doing.OPEN, _pause(config.pick.open_s), held=-1, done=1)
        self._move(Doing.RETURN, np.asarray(self._robot.home, float))

    def _move(self, doing: Doing, joints: np.ndarray) -> None:
        if law := joint_move_law(self._robot, self.joints[-1], joints, self._smoothing_s):
            self._add(doing, law, joints=joints)

    def _add(
        self,
        doing: Doing,
        law: TimeLaw,
        *,
        leg: Leg | None = None,
        joints: np.ndarray | None = None,
        held: int | None = None,
        done: int = 0,
    ) -> None:
        """The next key state; what isn't given stays as it is."""
        self.parts.append(Part(doing, self.step, law, leg))
        self.time.append(self.time[-1] + law.duration_s)
        self.base_pose.append(leg.after if leg else self.base_pose[-1])
        self.joints.append(self.joints[-1] if joints is None else joints)
        self.held.append(self.held[-1] if held is None else held)
        self.done.append(self.done[-1] + done)


def _lasting(manoeuvre: Manoeuvre, time_s: float) -> Manoeuvre:
    """A drive slowed down or sped up."""
    factor = max(time_s, _LEAST_DRIVE_S) / manoeuvre.time_s
    return Manoeuvre(tuple(dataclasses.replace(leg, law=leg.law.times(factor)) for leg in manoeuvre.legs))


def _pause(duration_s: float) -> TimeLaw:
    """A law for what doesn't move."""
    return TimeLaw(ramp_s=duration_s / 2.0, cruise_s=0.0)
