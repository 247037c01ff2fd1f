"""Collision-free inverse kinematics, beside MuJoCo and all branches tried one by one."""

from typing import Any

import jax
import numpy as np
import pytest

from basenet_jax.task.free_ik import collision_free_ik
from basenet_jax.world.boxes import Boxes, Room
from basenet_jax.world.grasps import top_down
from basenet_jax.world.mujoco_scene import MujocoChecker
from tests import compiled
from tests.oracles import arm
from tests.oracles.picking import tool_target

ROWS, DOUBT = 256, 1e-4  # m


@pytest.fixture(scope="module")
def boxes():
    """A table, a board above it and a wall behind it."""
    yes = np.ones(3, bool)
    leaves: dict[str, Any] = {
        "pose": np.array([[0.0, 0.0, 0.0], [0.2, 0.1, 0.3], [0.0, 0.5, 0.0]], np.float32),
        "half_size": np.array([[1.0, 0.4], [0.5, 0.15], [1.2, 0.05]], np.float32),
        "low": np.array([0.0, 1.35, 0.0], np.float32),
        "high": np.array([0.75, 1.38, 2.0], np.float32),
        "blocks_base": yes,
        "blocks_arm": yes,
        "bears_objects": ~yes,
    }
    return Boxes(**leaves)


@pytest.fixture(scope="module")
def problems():
    rng = np.random.default_rng(2)
    base = rng.uniform([-0.8, -1.1, -np.pi], [0.8, -0.75, np.pi], (ROWS, 3))
    grasp = rng.uniform([-0.6, -0.35, 0.95, -np.pi], [0.6, 0.3, 1.4, np.pi], (ROWS, 4))
    return base.astype(np.float32), grasp.astype(np.float32)


@pytest.fixture(scope="module")
def solutions(robot, boxes, problems):
    base, grasp = problems
    return jax.device_get(jax.jit(collision_free_ik)(robot, boxes, base, top_down(grasp)))


@pytest.fixture(scope="module")
def checker(robot, room, boxes):
    clear = Room(boxes, room.floor)
    return MujocoChecker(robot, clear, compiled.PickConfig(base_clearance_m=0.0), scene=compiled.draw_scene(0, 1, room))


def depths(checker, base, joints):
    """How near MuJoCo sees base, arm and the arm itself (m): less than 0 is touching."""
    return checker.distances(base[None].astype(float), joints[None].astype(float))[0, [0, 1, 3]].min()


def test_what_is_found_reaches_and_touches_nothing(solutions, checker, problems):
    assert 0.1 < np.mean(solutions.found) < 0.9
    for base, grasp, joints in zip(*(x[solutions.found] for x in (*problems, solutions.joints)), strict=True):
        errors = [arm.pose_error(joints, tool_target(base, grasp, 0.0, turn)) for turn in (0.0, np.pi)]
        position, orientation = min(errors)
        assert position < 1e-3
        assert orientation < np.radians(0.5)
        assert depths(checker, base, joints) > -DOUBT


def test_where_nothing_is_found_no_branch_would_do(solutions, checker, problems):
    for base, grasp in zip(*(x[~solutions.found] for x in problems), strict=True):
        for turn in (0.0, np.pi):
            target = tool_target(base, grasp, 0.0, turn)
            for branch in arm.BRANCHES:
                joints = arm.inverse_kinematics(target, branch)
                reached = arm.pose_error(joints, target)[0] < 0.99e-3
                assert not reached or depths(checker, base, joints) < DOUBT
