"""Picks built so that each rule rejects them, and at the rules' thresholds."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import PickConfig
from basenet_jax.task import pick_search
from tests.oracles import arm
from tests.oracles import picking as oracle
from tests.task.pick_cases import Cases, cases, check_against_oracle, expect, judge, reasons

FAR = (2.5, 1.5, 0.3)  # a base pose away from the table
OVER_DECK = 1.3  # m: a height at which the arm reaches over its own deck


def in_base(x, y, z, yaw=0.0, base_pose=FAR):
    """A grasp given in the base's frame."""
    sine, cosine = math.sin(base_pose[2]), math.cos(base_pose[2])
    return (base_pose[0] + cosine * x - sine * y, base_pose[1] + sine * x + cosine * y, z, base_pose[2] + yaw)


def beside_shoulder(radial):
    """A grasp straight down past the shoulder: the elbow's end passes it at this distance (m), at 0.05 above."""
    distance = math.hypot(arm.D[3], arm.D[4] + radial)
    x, y = arm.MOUNT[0] + distance * math.cos(0.6), arm.MOUNT[1] + distance * math.sin(0.6)
    return in_base(x, y, arm.MOUNT[2] + arm.D[0] - arm.D[5] - 0.05)


def one_branch(robot):
    """The robot with limits that leave one shoulder and one wrist at `beside_shoulder`, and the oracle's world."""
    lower, upper = arm.LOWER.copy(), arm.UPPER.copy()
    lower[0], upper[0] = 0.5, 2.0
    lower[4], upper[4] = 0.5, 2.5
    return robot.replace(joint_lower=lower, joint_upper=upper), {"lower": lower, "upper": upper}


def verdict(robot, picks: Cases, **world):
    """The reasons, once package and oracle agree on everything."""
    result = judge(robot, picks)
    check_against_oracle(picks, result, expect(picks, **world), doubtful=0.0, **world)
    return reasons(result)


def test_base_collides_first(robot):
    # Over the table nothing else is asked, whether in reach or not.
    poses = [(0.0, 0.0, 0.3), (0.0, -0.74, 0.0), (1.3, 0.1, 1.0), (1.2, 0.6, 0.8)]
    assert verdict(robot, cases(poses, (0.2, -0.2, 1.1, 0.0))) == ["base_collides"] * 4
    assert verdict(robot, cases(poses, (9.0, 9.0, 1.1, 0.0))) == ["base_collides"] * 4


@pytest.mark.parametrize("side", [(0.0, 0.75, 0.0), (0.0, 0.9, math.pi / 2), (1.5, 0.0, 0.0), (1.35, 0.0, math.pi / 2)])
def test_touching_is_collision_up_to_a_hundredth_of_a_millimetre(robot, side):
    # Flush with the table grown by 0.10: clearances of 0, 5e-6 and 2e-5 m.
    away = np.array(side) / np.hypot(*side[:2]) * [1, 1, 0]
    poses = np.array(side) + np.outer([-1e-6, 0.0, 5e-6, 2e-5], away)
    found = verdict(robot, cases(poses, (9.0, 9.0, 1.1, 0.0)))
    assert found == ["base_collides"] * 3 + ["out_of_reach"]


def test_corner_to_corner(robot):
    # A corner of the base, turned by 45 degrees to the table's diagonal, points at a corner of the grown table.
    bearing = math.radians(45)
    out = math.hypot(0.4, 0.25)
    heading = bearing + math.pi - math.atan2(0.25, 0.4)
    poses = [
        (1.1 + (out + gap) * math.cos(bearing), 0.5 + (out + gap) * math.sin(bearing), heading) for gap in (-1e-3, 1e-3)
    ]
    assert verdict(robot, cases(poses, (9.0, 9.0, 1.1, 0.0))) == ["base_collides", "out_of_reach"]


def test_out_of_reach(robot):
    far, low, on_axis = in_base(1.5, 0.0, 1.1), in_base(0.3, 0.6, 0.1), in_base(*arm.MOUNT[:2], 1.3)
    # The upper ends of the reach: only the grasp, or neither.
    tops = [in_base(0.0, 0.2, z) for z in (1.60, 1.62, 1.64, 1.66, 1.7, 1.8, 1.9)]
    found = verdict(robot, cases(FAR, [far, low, on_axis, *tops]))
    assert found[:3] == ["out_of_reach"] * 3
    assert found[-1] == "out_of_reach"
    assert found[3] is None


def test_out_of_limits_is_out_of_reach(robot):
    limited = robot.replace(joint_lower=arm.LOWER * 0.05, joint_upper=arm.UPPER * 0.05)
    world = {"lower": arm.LOWER * 0.05, "upper": arm.UPPER * 0.05}
    assert verdict(limited, cases(FAR, in_base(0.15, 0.05, OVER_DECK)), **world) == ["out_of_reach"]
    assert verdict(robot, cases(FAR, in_base(0.15, 0.05, OVER_DECK))) == [None]


def test_no_straight_descent(robot):
    # Past the shoulder the two-link arm can't fold short enough (below 0.033 m), or has to swing round (0.04 m).
    limited, world = one_branch(robot)
    found = verdict(limited, cases(FAR, [beside_shoulder(radial) for radial in (0.0, 0.02, 0.04)]), **world)
    assert found == ["no_straight_descent"] * 3


def test_steps_up_to_the_limit_are_straight(robot):
    # The steps fall from 0.77 rad at 0.04 m to 0.45 rad at 0.06 m; then the next rule is asked.
    limited, world = one_branch(robot)
    radial = np.linspace(0.04, 0.06, 20)
    found = verdict(limited, cases(FAR, [beside_shoulder(value) for value in radial]), **world)
    change = found.index("arm_collides")
    assert 1 <= change < 20
    assert found == ["no_straight_descent"] * change + ["arm_collides"] * (20 - change)
    branch = arm.Branch(0, 1, 1)
    for near, beyond in ((change - 1, True), (change, False)):
        grasp = beside_shoulder(radial[near])
        joints = [arm.inverse_kinematics(oracle.tool_target(FAR, grasp, h), branch) for h in oracle.HEIGHTS]
        assert (np.abs(np.diff(np.unwrap(joints, axis=0), axis=0)).max() > 0.5) == beyond


def test_the_rule_reached_farthest_is_the_reason(robot):
    # Without the limits other branches pass rule 3 and touch the robot's own body.
    assert verdict(robot, cases(FAR, beside_shoulder(0.0))) == ["arm_collides"]


def test_arm_collides(robot):
    # The gripper's tip is 0.25 below tool0: through the table's top, or through the deck.
    beside = (0.1, -0.9, 0.0)
    into_table = [(0.0, -0.3, 0.75 + above, 0.0) for above in (0.05, 0.15, 0.24)]
    assert verdict(robot, cases(beside, into_table)) == ["arm_collides"] * 3
    assert verdict(robot, cases(beside, (0.0, -0.3, 0.75 + 0.32, 0.0))) == [None]
    assert verdict(robot, cases(FAR, in_base(0.15, 0.05, 0.95))) == ["arm_collides"]
    # Over a low table the same heights above its top are feasible or not for other reasons, which agree.
    low = cases(beside, [(x, -0.3, 0.3 + 0.3, 0.0) for x in np.linspace(-0.5, 0.5, 15)], 0.3)
    assert len(set(verdict(robot, low))) >= 2


def test_gripper_just_above_the_table(robot):
    # The gripper's axis is upright at the grasp: it clears the top by z - 0.25 exactly.
    heights = [0.75 + 0.25 + gap for gap in (-1e-5, 1e-5)]
    found = verdict(robot, cases((0.1, -0.9, 0.0), [(0.0, -0.25, z, 0.0) for z in heights]))
    assert found == ["arm_collides", None]


def test_the_checked_states_are_the_oracles(robot):
    waypoints = np.random.default_rng(4).uniform(-2.0, 2.0, (len(oracle.HEIGHTS), 6)).astype(np.float32)
    found = pick_search._checked_states(robot, jnp.asarray(waypoints.T)[:, :, None], PickConfig())
    np.testing.assert_allclose(found[:, :, 0].T, oracle.checked_states(waypoints.astype(float)), atol=1e-6)  # float32
