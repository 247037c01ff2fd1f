"""What a motion overlaps, beside polygons and the package's own kernels."""

import dataclasses
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from basenet_jax.config import NavigationConfig, WorldConfig
from basenet_jax.robot.time_law import TimeLaw
from basenet_jax.task.manoeuvre import through
from basenet_jax.task.motion import Doing, Motion, Part, plan_motion
from basenet_jax.task.motion_check import find_overlaps, thing
from tests import compiled, judged
from tests.oracles import docked_drives as oracle
from tests.task.docked_rooms import base_of

TABLE = oracle.rectangle((0.0, 0.0, 0.0, 1.0, 0.4))


def driven(robot, poses):
    """A motion of drives alone."""
    legs = through(robot, poses).legs
    states = np.array([legs[0].before, *(leg.after for leg in legs)])
    count = len(states)
    rest: Any = (np.tile(np.asarray(robot.home, float), (count, 1)), np.full(count, -1), np.zeros(count))
    parts = tuple(Part(Doing.TURN if leg.turn else Doing.DRIVE, 0, leg.law, leg) for leg in legs)
    return Motion(np.arange(len(states), dtype=float), states, *rest, parts=parts)


def depth(robot, poses):
    """By polygons, in finer steps: the deepest of all states in the table (m)."""
    states = np.concatenate([np.linspace(a, b, 2000) for a, b in pairwise(poses)])
    return max(-oracle.gap(oracle.footprint(base_of(robot), pose), TABLE) for pose in states)


@pytest.mark.parametrize(
    "poses",
    [
        [(0.0, -0.75, 0.0), (0.0, -0.75, np.pi / 2)],
        [(0.3, -0.8, 0.2), (0.3, -0.8, 1.2)],
        [(1.45, 0.0, np.pi / 2), (1.45, 0.0, np.pi)],
        [(-2.0, -0.6, 0.0), (2.0, -0.6, 0.0)],
    ],
)
def test_the_base_goes_as_deep_as_polygons_say(robot, room, poses):
    (found,) = find_overlaps(robot, room, driven(robot, poses))
    assert (found.step, found.driving, found.box) == (0, True, 0)
    assert found.depth_m == pytest.approx(depth(robot, poses), abs=2e-3)
    assert thing(found, ("table",)) == "table"


@pytest.mark.parametrize(
    "poses", [[(0.0, -0.9, 0.0), (0.0, -0.9, np.pi)], [(-2.0, -0.66, 0.0), (2.0, -0.66, 0.0)], [(2.0, 0.0, 0.0)] * 2]
)
def test_what_is_free_is_not_named(robot, room, poses):
    poses = [*poses, (*poses[-1][:2], poses[-1][2] + 0.1)]
    assert depth(robot, poses) <= 0
    assert find_overlaps(robot, room, driven(robot, poses)) == []


def test_the_arm_is_gone_through_too(robot, room):
    rng, several = np.random.default_rng(2), 12
    pose = np.tile([0.3, -0.9, 0.0], (2, 1))
    hits = 0
    for _ in range(several):
        joints = np.stack([np.asarray(robot.home, float), np.asarray(robot.home) + rng.uniform(-2.0, 2.0, robot.dof)])
        rest: Any = (np.full(2, -1), np.zeros(2))
        motion = Motion(np.arange(2.0), pose, joints, *rest, parts=(Part(Doing.REACH, 0, TimeLaw(1.0, 0.0)),))
        states = np.linspace(joints[0], joints[1], 120)
        touches = bool(np.any(compiled.arm_collides(robot, np.tile(pose[0], (120, 1)), states, room)))
        found = find_overlaps(robot, room, motion)
        assert not any(each.driving for each in found)
        assert bool(found) == touches or max((each.depth_m for each in found), default=0.0) < 3e-3
        hits += touches
    assert 0 < hits < several, "says little"


def test_docked_drives_are_free_where_those_of_a_point_are_not(robot, room):
    scene, plan = (judged.first(each) for each in (judged.scenes(), judged.plans()))
    stop = np.array([0.0, -0.76, 0.0], np.float32)
    scene = dataclasses.replace(scene, robot_start=np.array([-0.2, -1.9, 2.0], np.float32))
    plan = dataclasses.replace(plan, base_pose=np.stack([stop, stop]))
    executed: Any = {"is_step": np.array([True, False]), "feasible": np.zeros(2, bool), "navigation_time": np.ones(2)}
    outcome = dataclasses.replace(judged.made_up_outcome(), **executed)
    found = {}
    for config in (NavigationConfig(drives="point"), NavigationConfig(drives="docked")):
        world = WorldConfig(navigation=config)
        found[config.drives] = find_overlaps(robot, room, plan_motion(robot, scene, plan, outcome, world))
    assert [each.driving for each in found["point"]] == [True]
    assert 0.05 < found["point"][0].depth_m < 0.15
    assert found["docked"] == []
