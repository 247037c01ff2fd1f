"""The pick cycle by enumeration: every branch and grasp yaw goes through the rules in order."""

import math
from dataclasses import dataclass, field

import numpy as np

from tests.oracles import arm
from tests.oracles.clearance import base_clearance, capsule_clearance
from tests.oracles.timing import joint_move

HEIGHTS = (0.10, 0.075, 0.05, 0.025, 0.0)  # m above the grasp, pre-grasp first
RULES = ("base_collides", "out_of_reach", "no_straight_descent", "arm_collides")


@dataclass(frozen=True)
class World:
    """What a pick depends on besides the base pose and the grasp; `slack` moves every threshold.

    Positive slack accepts a little more than the definitions and negative slack a little less. Where both come to
    the same result, rounding can't change it either.
    """

    table: tuple[float, float] = (2.0, 0.8)  # m
    table_height: float = 0.75  # m
    symmetric: bool = True
    lower: np.ndarray = field(default_factory=lambda: arm.LOWER)
    upper: np.ndarray = field(default_factory=lambda: arm.UPPER)
    max_step: float = 0.5  # rad
    slack: int = 0  # -1, 0 or 1

    @property
    def position_tolerance(self):
        """1 mm. Generously 2.5 mm: 0.5 degrees of orientation error add that much reach."""
        return {-1: 0.99e-3, 0: 1e-3, 1: 2.5e-3}[self.slack]


@dataclass(frozen=True)
class Solution:
    """One branch and grasp yaw."""

    rule: str | None  # the first it breaks
    time: float = math.inf  # s; of solutions that pass rules 2 and 3
    joints: np.ndarray | None = None  # (5, 6)


@dataclass(frozen=True)
class Outcome:
    """Of a pick."""

    reason: str | None
    time: float  # s; 0 where infeasible
    solutions: tuple[Solution, ...] = ()


def pick(base_pose, grasp, world: World = World()) -> Outcome:
    """Whether and how fast tool0's grasp (x, y, z, yaw) in W can be served from a base pose (x, y, heading)."""
    if base_clearance(base_pose, world.table) <= 1e-5 - world.slack * 9e-6:
        return Outcome("base_collides", 0.0)
    turns = (0.0, math.pi) if world.symmetric else (0.0,)
    solutions = tuple(judge(base_pose, grasp, turn, branch, world) for turn in turns for branch in arm.BRANCHES)
    feasible = [solution.time for solution in solutions if solution.rule is None]
    if feasible:
        return Outcome(None, min(feasible), solutions)
    left = list(solutions)
    for rule in RULES[1:]:
        left = [solution for solution in left if solution.rule != rule]
        if not left:
            return Outcome(rule, 0.0, solutions)
    raise AssertionError("a solution without a rule is feasible")


def tool_target(base_pose, grasp, height, turn=0.0):
    """tool0's frame `height` above the grasp, in the arm's base frame: R_W_tool0 = Rz(yaw) Rx(pi)."""
    arm_base = arm.pose(base_pose[0], base_pose[1], 0.0, base_pose[2]) @ arm.pose(*arm.MOUNT, 0.0)
    tool = arm.pose(grasp[0], grasp[1], grasp[2] + height, grasp[3] + turn) @ arm.rotation_x(math.pi)
    return np.linalg.inv(arm_base) @ tool


def judge(base_pose, grasp, turn, branch, world: World) -> Solution:
    """Takes one solution through rules 2, 3 and 4."""
    targets = [tool_target(base_pose, grasp, height, turn) for height in HEIGHTS]
    above = _solution(targets[0], branch, arm.HOME + 1e-4 * world.slack, world)
    if above is None or _solution(targets[-1], branch, above, world) is None:
        return Solution("out_of_reach")
    joints = [above]
    for target in targets[1:]:
        found = _solution(target, branch, joints[-1], world)
        if found is None:
            return Solution("no_straight_descent")
        joints.append(found)
    rows = np.array(joints)
    if np.abs(np.diff(rows, axis=0)).max() > world.max_step + 1e-3 * world.slack:
        return Solution("no_straight_descent")
    touches = least_clearance(base_pose, checked_states(rows), world) <= -1e-4 * world.slack
    return Solution("arm_collides" if touches else None, cycle_time(rows[0], rows[-1]), rows)


def checked_states(joints):
    """The waypoints, and seven points inside home -> pre-grasp and pre-grasp -> stow."""
    inside = [k / 8 for k in range(1, 8)]
    coming = [arm.HOME + f * (joints[0] - arm.HOME) for f in inside]
    going = [joints[0] + f * (arm.STOW - joints[0]) for f in inside]
    return [*joints, *coming, *going]


def cycle_time(pregrasp, grasp):
    """Duration (s) of home, pre-grasp, grasp, close, pre-grasp, stow, open, home."""
    moves = [(arm.HOME, pregrasp), (pregrasp, grasp), (grasp, pregrasp), (pregrasp, arm.STOW), (arm.STOW, arm.HOME)]
    return sum(joint_move(a, b) for a, b in moves) + 1.0 + 1.0


def _nearest_equivalent(joints, reference, world: World):
    """Per joint the equivalent inside the limits nearest to the reference; None if a joint has none."""
    chosen = []
    for q, near, lower, upper in zip(joints, reference, world.lower, world.upper, strict=True):
        margin = 1e-5 * world.slack
        options = [q + 2 * math.pi * k for k in range(-3, 4)]
        options = [x for x in options if lower - margin <= x <= upper + margin]
        if not options:
            return None
        chosen.append(min(options, key=lambda x: abs(x - near)))
    return np.array(chosen)


def _solution(target, branch, reference, world: World):
    """The branch's joints at a target, the equivalents nearest to the reference; None without such a solution."""
    joints = _nearest_equivalent(arm.inverse_kinematics(target, branch), reference, world)
    if joints is None:
        return None
    position_error, orientation_error = arm.pose_error(joints, target)
    reached = position_error <= world.position_tolerance and orientation_error <= math.radians(0.5)
    return joints if reached else None


def least_clearance(base_pose, states, world: World):
    """Least clearance (m) of any capsule from table and body over some joint states; negative where one touches."""
    segments = np.array([arm.capsules(joints, base_pose) for joints in states])
    distances = capsule_clearance(segments, base_pose, world.table, world.table_height)
    return float(np.min(distances - arm.RADII))
