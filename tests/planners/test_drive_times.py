"""Planners on drive times of somebody else's: exact where they are exact, among the poses that these are for."""

import dataclasses
import itertools

import jax
import numpy as np
import pytest

from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.planners.basenet_paper import BaSeNetPaper
from basenet_jax.planners.dp import Dp
from basenet_jax.planners.greedy_stops import GreedyStops
from basenet_jax.planners.in_its_room import hold_to
from basenet_jax.planners.protocol import PlanningError
from basenet_jax.task.drive_times import DriveTimes
from basenet_jax.task.drives import GivenDrives
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import judge
from tests import compiled

KEY = jax.random.key(0)
OBJECTS = 3


@pytest.fixture(scope="module")
def scene(random_scene):
    return random_scene(0, OBJECTS)


@pytest.fixture(scope="module")
def times(robot, room, scene):
    """Between the start and six stops, two that serve each object; drives there and back differ, and one is no way."""
    stops = aligned_poses(robot, room, compiled.ALIGNED)
    serves = compiled.check_candidates(robot, scene, stops).serves
    kept = np.unique(np.concatenate([np.flatnonzero(serves[:, slot])[[0, -1]] for slot in range(OBJECTS)]))
    poses = np.concatenate([[scene.robot_start], stops[kept]])
    seconds = np.random.default_rng(1).uniform(1.0, 30.0, (len(poses), len(poses)))
    seconds[0, 1] = np.inf
    return DriveTimes(poses, seconds)


@pytest.fixture(scope="module")
def setup(robot, times):
    return compiled.make_setup(robot, drive_times=times)


def judged(setup, scene, plan):
    return jax.device_get(judge(setup.robot, scene, plan, setup.world, GivenDrives.of(setup.drive_times)))


def cheapest(robot, scene, times):
    """By enumeration: the least of all orders of the objects, each from any pose that serves it."""
    pick = np.asarray(compiled.check_candidates(robot, scene, times.poses.astype(np.float32)).pick_time)
    best = np.inf
    for order in itertools.permutations(range(OBJECTS)):
        for stops in itertools.product(range(1, len(times.poses)), repeat=OBJECTS):
            drives = sum(times.seconds[a, b] for a, b in itertools.pairwise((0, *stops)))
            best = min(best, drives + sum(pick[stop, slot] for stop, slot in zip(stops, order, strict=True)))
    return best


def test_exact_planning_is_exact_on_them(setup, scene, times):
    plan = Dp(setup)(scene, KEY)
    outcome = judged(setup, scene, plan)
    assert int(outcome.grasped) == OBJECTS
    assert float(outcome.execution) == pytest.approx(cheapest(setup.robot, scene, times), abs=1e-3)


def test_the_judge_counts_them(setup, scene, times):
    plan = jax.device_get(GreedyStops(setup)(scene, KEY))
    outcome, poses = judged(setup, scene, plan), [scene.robot_start, *plan.base_pose[:OBJECTS]]
    which = [int(np.argmin(np.abs(times.poses - pose).sum(axis=1))) for pose in poses]
    assert int(outcome.grasped) == OBJECTS
    expected = [times.seconds[a, b] for a, b in itertools.pairwise(which)]
    np.testing.assert_allclose(outcome.navigation_time[:OBJECTS], expected, rtol=1e-6)


def test_a_pose_without_a_time_ends_the_plan(setup, scene):
    plan = jax.device_get(GreedyStops(setup)(scene, KEY))
    elsewhere = dataclasses.replace(plan, base_pose=plan.base_pose * np.array([1.05, 1.05, 1.0], np.float32))
    outcome = judged(setup, scene, elsewhere)
    assert not int(outcome.grasped)
    assert outcome.reason[0] == Reason.UNREACHABLE


def test_starts_without_times_are_refused(setup, scene):
    planner = hold_to(setup, GreedyStops(setup))
    away = dataclasses.replace(scene, robot_start=np.array([2.0, 2.0, 0.0], np.float32))
    message = r"robot.start: found \[2.0, 2.0, 0.0\], allowed are the poses of drive_times, or add it to them"
    with pytest.raises(PlanningError, match=message):
        planner(away, KEY)
    whole_turn = dataclasses.replace(scene, robot_start=scene.robot_start + np.array([0.0, 0.0, 2 * np.pi], np.float32))
    planner(whole_turn, KEY)


def test_poses_where_the_base_can_not_stand_are_no_stops(robot, times):
    inside = np.concatenate([times.poses, [(0.0, 0.0, 0.0)]])
    more = DriveTimes(inside, np.ones((len(inside), len(inside))))
    assert len(compiled.make_setup(robot, drive_times=more).aligned_stops().poses) == len(times.poses)
    nowhere = compiled.make_setup(robot, drive_times=DriveTimes(inside[-1:], np.zeros((1, 1)), "drives.json"))
    with pytest.raises(PlanningError, match=r"drives.json: poses: found 1 at which the base is too near to something"):
        nowhere.aligned_stops()


def test_the_papers_planner_knows_no_stops(setup):
    with pytest.raises(PlanningError, match="drive_times: basenet-paper parks wherever its policy says"):
        BaSeNetPaper(setup)
