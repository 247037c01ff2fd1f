"""The motion of a plan is the one that the judge costs."""

import itertools

import numpy as np
import pytest

from basenet_jax.config import NavigationConfig, WorldConfig
from basenet_jax.task.motion import Doing, plan_motion
from tests import judged
from tests.oracles import navigation as drives
from tests.oracles import timing as moves
from tests.task import navigation_pairs

CYCLE = [Doing.REACH, Doing.DESCEND, Doing.CLOSE, Doing.LIFT, Doing.CARRY, Doing.OPEN, Doing.RETURN]
BASE = (Doing.TURN, Doing.DRIVE)


@pytest.fixture(scope="module")
def scene():
    return judged.first(judged.scenes())


@pytest.fixture(scope="module")
def plan():
    return judged.first(judged.plans())


@pytest.fixture(scope="module")
def outcome():
    return judged.first(judged.outcomes())


@pytest.fixture(scope="module")
def motion(robot, scene, plan, outcome):
    return plan_motion(robot, scene, plan, outcome)


def test_it_takes_as_long_as_the_plan_says(motion, outcome):
    driven = sum(part.law.duration_s for part in motion.parts if part.doing in BASE)
    assert driven == pytest.approx(float(outcome.navigation), abs=1e-3)
    picked = motion.time[-1] - driven
    assert float(outcome.picking) - 1e-3 <= picked <= 1.01 * float(outcome.picking)
    np.testing.assert_allclose(np.diff(motion.time), [part.law.duration_s for part in motion.parts])


def test_its_parts_are_drives_and_pick_cycles(motion):
    base = list(itertools.takewhile(lambda part: part.doing in BASE, motion.parts))
    assert {part.doing for part in base} == {*BASE}
    assert [part.doing for part in motion.parts[len(base) :]] == 2 * CYCLE
    assert [part.step for part in motion.parts] == [0] * (len(base) + len(CYCLE)) + [1] * len(CYCLE)


def test_arm_moves_take_what_their_slowest_joint_needs(motion):
    for key, part in enumerate(motion.parts):
        if part.doing not in (*BASE, Doing.CLOSE, Doing.OPEN):
            least = moves.joint_move(motion.joints[key], motion.joints[key + 1])
            assert least * (1 - 1e-9) <= part.law.duration_s <= 1.05 * least


def test_it_starts_and_ends_where_it_should(motion, robot, scene):
    pose, joints, held, done = motion.at(0.0)
    np.testing.assert_allclose(pose, scene.robot_start, atol=1e-6)
    np.testing.assert_allclose(joints, robot.home)
    assert (held, done) == (-1, 0)
    pose, joints, held, done = motion.at(1e9)
    np.testing.assert_allclose(pose[:2], judged.GOOD[:2], atol=1e-6)
    assert np.cos(pose[2] - judged.GOOD[2]) == pytest.approx(1.0)
    assert (held, done) == (-1, 2)


def test_the_base_never_drives_into_the_table_nor_sideways(motion):
    for before, after in itertools.pairwise(motion.base_pose):
        move = after[:2] - before[:2]
        if np.linalg.norm(move) > 1e-6:
            assert after[2] == pytest.approx(before[2]), "it turns on the spot only"
            sideways = move @ [-np.sin(after[2]), np.cos(after[2])]
            assert abs(sideways) < 1e-6
        points = np.linspace(before, after, 50)
        assert not np.any((np.abs(points[:, 0]) < 1.24) & (np.abs(points[:, 1]) < 0.64))


def test_each_object_is_held_once_in_the_order_of_the_plan(motion, plan, outcome):
    held = [slot for slot, _ in itertools.groupby(motion.held.tolist()) if slot >= 0]
    assert held == plan.object_index.tolist()
    taken = int(np.flatnonzero(motion.held >= 0)[0])
    np.testing.assert_allclose(motion.joints[taken], outcome.joints[0, -1], atol=1e-6)


def test_a_failed_pick_is_driven_to_and_not_made(robot, scene, plan, outcome):
    motion = plan_motion(robot, scene, plan, judged.with_failure(outcome, 0))
    assert plan.object_index[0] not in motion.held
    assert motion.time[-1] == pytest.approx(float(outcome.navigation) + float(outcome.pick_time[1]), abs=1e-3)


def drive(robot, scene, plan, outcome, start, goal, **config):
    """The motion of driving from one pose to another and picking nothing."""
    scene = scene.replace(robot_start=start)
    plan = plan.replace(base_pose=np.stack([goal, goal]))
    outcome = outcome.replace(is_step=np.array([True, False]), feasible=np.zeros(2, bool), navigation_time=np.ones(2))
    return plan_motion(robot, scene, plan, outcome, WorldConfig(navigation=NavigationConfig(**config)))


@pytest.mark.parametrize("pair", range(0, navigation_pairs.PAIRS, 160))
def test_drives_take_the_fastest_way_in_the_fastest_gear(robot, scene, plan, outcome, pair):
    start, goal = (poses[pair] for poses in navigation_pairs.sample_pairs())
    motion = drive(robot, scene, plan, outcome, start, goal)
    # Which way is taken is decided in float32.
    assert motion.time[-1] == pytest.approx(drives.navigate(start, goal).time, abs=navigation_pairs.FLOAT32_BOUND)
    np.testing.assert_allclose(motion.base_pose[-1][:2], goal[:2], atol=1e-6)
    assert np.cos(motion.base_pose[-1][2] - goal[2]) == pytest.approx(1.0)
    assert np.all(motion.joints == robot.home)


def test_a_drive_straight_through_is_one_drive_and_one_turn(robot, scene, plan, outcome):
    start, goal = np.array([1.8, 1.0, 3.0]), np.array([-1.7, -1.2, -3.0])
    motion = drive(robot, scene, plan, outcome, start, goal, straight=True)
    assert [part.doing for part in motion.parts] == [Doing.DRIVE, Doing.TURN]
    expected = moves.trapezoid(np.hypot(3.5, 2.2), 0.5, 0.5) + moves.trapezoid(2 * np.pi - 6.0, 0.5, 1.0)
    assert motion.time[-1] == pytest.approx(expected, rel=1e-6)


def test_who_is_there_stays_there(robot, scene, plan, outcome):
    pose = np.array([0.3, -0.9, 3.1])
    assert not drive(robot, scene, plan, outcome, pose, pose + np.array([0.0, 0.0, 2 * np.pi])).parts


def test_smoothed_arm_moves_take_that_much_longer(robot, scene, plan, outcome, motion):
    smoothed = plan_motion(robot, scene, plan, outcome, smoothing_s=0.25)
    assert smoothed.time[-1] == pytest.approx(motion.time[-1] + 2 * 5 * 0.25)


def test_it_speeds_up_and_slows_down(motion):
    key = next(key for key, part in enumerate(motion.parts) if part.doing is Doing.DRIVE)
    begin, end = motion.time[key : key + 2]
    places = np.array([motion.at(time)[0][:2] for time in np.linspace(begin, end, 21)])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps[0] < 0.5 * steps[10]
    assert steps[-1] < 0.5 * steps[10]
