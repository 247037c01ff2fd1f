"""Picks of an arm of seven joints by its closed form, replayed in MuJoCo."""

import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.config import PickConfig
from basenet_jax.evaluation.replay import PickReplay
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Reason
from basenet_jax.world.grasps import top_down
from tests import compiled


@pytest.fixture(scope="module")
def arm():
    return load_robot("panda_mobile")


@pytest.fixture(scope="module")
def problems():
    """Base poses beside the table, grasps near to them."""
    rng = np.random.default_rng(6)
    base = rng.uniform([-0.6, -1.0, -np.pi], [0.6, -0.8, np.pi], (compiled.ROWS, 3)).astype(np.float32)
    beside = base[:, :2] + rng.uniform([-0.5, 0.3], [0.5, 0.7], (compiled.ROWS, 2))
    grasp = np.column_stack([beside, rng.uniform([1.0, -np.pi], [1.2, np.pi], (compiled.ROWS, 2))])
    return base, grasp.astype(np.float32)


@pytest.fixture(scope="module")
def picks(arm, room, problems):
    base, grasp = problems
    return compiled.pick(arm, base, grasp, room)


def test_feasible_picks_break_no_rule_in_mujoco(arm, room, problems, picks):
    assert 0.1 < np.mean(picks.feasible) < 0.9
    replay = PickReplay(arm, room)
    grasps = top_down(problems[1], np)
    for index in np.flatnonzero(picks.feasible):
        grasp = jax.tree.map(lambda x, index=index: x[index, 0], grasps)
        assert replay.broken_rule(problems[0][index], picks.joints[index], grasp) == Reason.NONE


def test_more_angles_find_no_slower_picks(arm, room, problems, picks):
    """Three times as many angles of joint 7: what is found by default is nearly as good."""
    base, grasp = problems
    more = compiled.pick(arm, base, grasp, room, dataclasses.replace(PickConfig(), last_joint_angles=48))
    both = more.feasible & picks.feasible
    assert np.mean(more.feasible) >= np.mean(picks.feasible) - 0.01
    assert np.mean(more.time[both]) <= np.mean(picks.time[both])
    assert np.mean(picks.time[both] - more.time[both]) < 0.4
