"""Planners in a room of several surfaces: what they plan can be done, by the judge, by MuJoCo and by brute force."""

from pathlib import Path

import jax
import numpy as np
import pytest

import basenet_jax as bn
from basenet_jax.config import PickConfig
from basenet_jax.evaluation.replay import replay
from basenet_jax.planners.registry import PLANNERS
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.motion import plan_motion
from basenet_jax.task.picking import Reason
from basenet_jax.world.mujoco_scene import MujocoChecker
from tests.oracles import docked_drives as oracle
from tests.task.docked_rooms import base_of

ROOM = Path(__file__).parents[2] / "docs/examples/room.yaml"
FLOAT32_BOUND = 6e-3  # s, as in the tests of docked drives
IN_ROOMS = [name for name in PLANNERS if name != "basenet-paper"]


@pytest.fixture(scope="module")
def scene():
    return bn.load_scene(ROOM)


@pytest.fixture(scope="module")
def plan(scene):
    return bn.make_plan(scene, planner="greedy-stops")


@pytest.fixture(scope="module")
def outcome(scene, plan):
    return jax.device_get(bn.execute(scene, plan))


def known_room(scene):
    """The room as brute force sees it: what blocks the base, from the file's text alone."""
    names = ("bench", "pillar", "north", "charging", "shelf_2")
    rows = (
        (2.0, 3.1, 1.5708, 0.9, 0.35),
        (4.0, 3.0, 0.0, 0.2, 0.2),
        (4.25, 6.2, 0.0, 4.25, 0.05),
        (1.0, 1.0, 0.0, 0.4, 0.4),
    )
    assert set(names) < set(scene.box_names)
    return oracle.Room(rows, (0.0, 0.0, 8.5, 6.2))  # the base passes under the shelf's board and the lamp


def test_everything_is_grasped_and_mujoco_agrees(scene, plan, outcome):
    assert int(outcome.grasped) == 3
    batch = jax.tree.map(lambda x: np.asarray(x)[None], (scene.arrays, plan, outcome))
    np.testing.assert_array_equal(replay(load_robot(), *batch), Reason.NONE)


def test_drives_take_what_brute_force_says(scene, plan, outcome):
    base, room, before = base_of(load_robot()), known_room(scene), np.asarray(scene.arrays.robot_start)
    for step in range(3):
        pose = np.asarray(plan.base_pose[step])
        expected = oracle.drive_time(base, room, before, pose)
        assert float(outcome.navigation_time[step]) == pytest.approx(expected, abs=FLOAT32_BOUND)
        before = pose


def test_the_robot_touches_nothing_on_its_way(scene, plan, outcome):
    robot = load_robot()
    motion = plan_motion(robot, scene.arrays, plan, outcome)
    times = np.arange(0.0, motion.time[-1], 0.05)
    poses, joints = (np.array(each) for each in zip(*(motion.at(time)[:2] for time in times), strict=True))
    driving = np.any(np.diff(poses, axis=0, prepend=poses[:1]) != 0.0, axis=1)
    checker = MujocoChecker(robot, scene.arrays.room, PickConfig(base_clearance_m=0.045))
    assert not np.any(checker.base_touches(poses))
    assert not np.any(checker.arm_touches(poses, joints))
    assert np.sum(driving) > 300
    total = float(outcome.execution)
    assert motion.time[-1] == pytest.approx(total, abs=0.2)  # arm moves in a straight line take a little longer


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_ROOMS)
def test_every_planner_plans_rooms(scene, name):
    plan = bn.make_plan(scene, planner=name)
    outcome = bn.execute(scene, plan)
    if name in ("pbg", "mbp"):  # they trust the map
        assert int(np.sum(plan.served)) == 3
    else:
        assert int(outcome.grasped) == 3


def test_a_robot_that_is_shut_in_says_that_it_can_not_get_there(tmp_path):
    cell = "{name: cell, points: [[3.2, 0.0], [3.2, 2.0], [5.2, 2.0], [5.2, 0.0]], thickness: 0.1, height: 2.0}"
    (tmp_path / "room.yaml").write_text(ROOM.read_text().replace("walls:\n", f"walls:\n  - {cell}\n"))
    scene = bn.load_scene(tmp_path / "room.yaml")
    outcome = jax.device_get(bn.execute(scene, bn.make_plan(scene, planner="greedy-stops")))
    assert not int(outcome.grasped)
    np.testing.assert_array_equal(outcome.reason[:3], Reason.UNREACHABLE)


def test_a_wall_that_shuts_off_a_surface_is_said(tmp_path):
    """Round the bench is too little room to park: its objects can't be had, the shelf's can."""
    text = ROOM.read_text().replace(
        "keep_out:\n", "keep_out:\n  - {name: moat, pose: [2.0, 3.1, 0.0], size: [3.0, 4.0]}\n"
    )
    (tmp_path / "room.yaml").write_text(text)
    scene = bn.load_scene(tmp_path / "room.yaml")
    outcome = jax.device_get(bn.execute(scene, bn.make_plan(scene, planner="greedy-stops")))
    assert int(outcome.grasped) == 1
    np.testing.assert_array_equal(outcome.reason[1:3], Reason.OUT_OF_REACH)
