"""What the robot is told is the plan: its base poses in the map, its waypoints, in its order, within its limits."""

import itertools

import numpy as np
import pytest

from basenet_jax.exports import make_schedule
from basenet_jax.exports.schedule import NANOSECONDS, in_map
from basenet_jax.robot.reading import load_robot
from tests import judged
from tests.exports.conftest import TABLE_POSE

CYCLE = [
    "home to pre-grasp",
    "pre-grasp to grasp",
    "close gripper",
    "grasp to pre-grasp",
    "pre-grasp to stow",
    "open gripper",
    "stow to home",
]


def moves(schedule):
    return [command for command in schedule.commands if command.trajectory]


def first_drive(schedule):
    (drive, *_) = (command.drive for command in schedule.commands if command.drive)
    return drive


def test_commands_follow_one_another_without_a_gap(schedule):
    assert [command.doing for command in schedule.commands] == ["drive", *CYCLE, *CYCLE]
    assert [command.object for command in schedule.commands] == ["mug_1"] * 8 + ["mug_2"] * 7
    assert [command.gripper for command in schedule.commands if command.gripper] == ["close", "open"] * 2
    assert schedule.commands[0].time_ns == 0
    for before, after in itertools.pairwise(schedule.commands):
        assert before.time_ns + before.duration_ns == after.time_ns
    last = schedule.commands[-1]
    assert (last.time_ns + last.duration_ns) / NANOSECONDS == pytest.approx(schedule.duration_s, abs=1e-8)


def test_it_takes_as_long_as_the_judge_says_and_its_smoothing(schedule, outcome):
    smoothing = 10 * 0.01
    assert float(outcome.execution) + smoothing <= schedule.duration_s + 1e-3
    assert schedule.duration_s <= 1.01 * float(outcome.execution) + smoothing


def test_the_base_goal_is_the_plans_pose_in_the_map(schedule, plan):
    x, y, yaw = (complex(*TABLE_POSE[:2]), complex(*plan.base_pose[0][:2]), TABLE_POSE[2])
    expected = x + y * np.exp(1j * yaw)  # a turn and a shift of the plane, in complex numbers
    goal = first_drive(schedule).goal
    assert complex(*goal[:2]) == pytest.approx(expected, abs=1e-6)
    assert np.exp(1j * goal[2]) == pytest.approx(np.exp(1j * (plan.base_pose[0][2] + yaw)), abs=1e-6)


def test_by_default_the_table_is_the_map(robot, scene, plan, outcome):
    schedule = make_schedule(robot, scene, plan, outcome)
    assert first_drive(schedule).goal == pytest.approx(judged.GOOD.tolist(), abs=1e-6)
    assert schedule.map_frame == "map"


def test_yaws_are_wrapped():
    poses = in_map(np.array([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]]), (0.0, 0.0, 3.0))
    np.testing.assert_allclose(poses[:, 2], [6.0 - 2 * np.pi, 0.0], atol=1e-12)


def test_arm_moves_lead_over_the_judges_waypoints(schedule, robot, outcome):
    for step in range(2):
        above, grasp = np.asarray(outcome.joints[step][[0, -1]], float)
        stops = [robot.home, above, grasp, above, robot.stow, robot.home]
        for command, start, goal in zip(moves(schedule)[5 * step :], stops, stops[1:], strict=False):
            np.testing.assert_allclose(command.trajectory.positions[0], start, atol=1e-9)
            np.testing.assert_allclose(command.trajectory.positions[-1], goal, atol=1e-9)


@pytest.mark.parametrize("name", ["ur5e_mobile", pytest.param("panda_mobile", marks=pytest.mark.slow)])
def test_real_plans_keep_every_limit_at_every_sample(name, request):
    robot = load_robot(name)
    schedule = request.getfixturevalue("schedule" if name == "ur5e_mobile" else "panda_schedule")
    assert len(moves(schedule)) == 10
    for command in moves(schedule):
        each = command.trajectory
        time = np.array(each.time_ns) / NANOSECONDS
        assert each.positions.shape == (len(time), robot.dof)
        assert each.time_ns[0] == 0
        assert each.time_ns[-1] == pytest.approx(command.duration_ns, abs=2)
        assert np.all(np.diff(time) > 0)
        assert np.diff(time).max() <= 0.024
        assert np.all(np.abs(each.velocities) <= robot.joint_speed + 1e-9)
        assert np.all(np.abs(each.accelerations) <= robot.joint_acceleration + 1e-6)
        assert np.all((each.positions >= robot.joint_lower) & (each.positions <= robot.joint_upper))
        assert np.all(each.velocities[[0, -1]] == 0.0)
        # Positions change as the speeds say, and these as the accelerations do, which are linear in between.
        step = np.diff(time)[:, None]
        mean = (each.accelerations[1:] + each.accelerations[:-1]) / 2
        np.testing.assert_allclose(np.diff(each.velocities, axis=0), mean * step, atol=1e-6)
        change = (each.accelerations[1:] - each.accelerations[:-1]) * step**2 / 12
        moved = (each.velocities[1:] + each.velocities[:-1]) / 2 * step - change
        np.testing.assert_allclose(np.diff(each.positions, axis=0), moved, atol=1e-7)


def test_what_fails_is_left_out_with_its_drive(robot, scene, plan, outcome):
    """The first pick fails, at another place: the robot goes straight to the second."""
    elsewhere = plan.base_pose.copy()
    elsewhere[0] = (-0.6, -0.9, 0.05)
    plan = plan.replace(base_pose=elsewhere)
    failed = judged.with_failure(outcome, 0)
    schedule = make_schedule(robot, scene, plan, failed)
    assert [command.doing for command in schedule.commands] == ["drive", *CYCLE]
    assert {command.object for command in schedule.commands} == {"mug_2"}
    assert first_drive(schedule).goal == pytest.approx(judged.GOOD.tolist(), abs=1e-6)
