"""The map of grasps of any orientation: its bins beside enumeration, looking them up, and how often it is right."""

import dataclasses
import functools
import math
from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from basenet_jax.config import PickConfig
from basenet_jax.planners import grasp_map_build
from basenet_jax.planners.grasp_map import TILTS, GraspMap, Shape, is_reached
from basenet_jax.planners.grasp_map_build import build_grasp_map, map_shape
from basenet_jax.robot.reading import load_robot
from basenet_jax.world.grasps import Grasps
from tests import compiled
from tests.oracles import arm as oracle
from tests.oracles.reach import reached

ROWS = 512
COARSE = Shape(step_m=0.05, lowest=0, heights=45, side=47, headings=1, turns=1)
_is_reached = jax.jit(is_reached)


@pytest.fixture(scope="module")
def coarse(robot):
    return build_grasp_map(robot, shape=COARSE)


def single(pose, symmetric=True):
    """One grasp each, in W."""
    one = np.ones(len(pose), bool)
    leaves: Any = (np.asarray(pose, np.float32), np.zeros(len(pose), np.float32), one & symmetric, one)
    return Grasps(*leaves)


def look_up(grasp_map, base_pose, grasps):
    call = functools.partial(_is_reached, jax.device_get(grasp_map))
    return compiled.by_rows(call, np.asarray(base_pose, np.float32), grasps, size=ROWS)


def in_bins(grasp_map, number, offset, azimuth, turn, tool, robot):
    """Base poses and grasps that are so much of a bin (up to half) beside the centres of bins, turned as one likes.

    Args:
        number: of the bins, (n, 6).
        offset: (n, 6), of height, tilt, x, y, heading and turn.
        azimuth: of the approach in W (rad).
        turn: of the gripper or the base where the bins leave it open, (n, 2).
        tool: its x and y in W (m).
    """
    shape = grasp_map.shape
    height, tilt, i, j, heading, held = (number + offset).T
    z = (height + shape.lowest) * shape.step_m
    base_heading = azimuth + (turn[:, 0] if shape.headings == 1 else 2 * np.pi * heading / shape.headings)
    hold = turn[:, 1] if shape.turns == 1 else 2 * np.pi * held / shape.turns
    angles = np.stack([azimuth, np.pi * tilt / (TILTS - 1), hold], axis=-1)
    rpy = Rotation.from_euler("ZYZ", angles).as_euler("ZYX", suppress_warnings=True)[:, ::-1]
    along, across = ((k - shape.side // 2) * shape.step_m for k in (i, j))
    axis = tool + np.stack(
        [np.cos(azimuth) * along - np.sin(azimuth) * across, np.sin(azimuth) * along + np.cos(azimuth) * across],
        axis=-1,
    )
    mount = np.asarray(robot.mount_position)
    sine, cosine = np.sin(base_heading), np.cos(base_heading)
    base = axis - np.stack([cosine * mount[0] - sine * mount[1], sine * mount[0] + cosine * mount[1]], axis=-1)
    return np.column_stack([base, base_heading]), np.column_stack([tool, z, rpy])


def random_numbers(rng, grasp_map, count):
    """Of bins, half of them reached."""
    bins = grasp_map.bins()
    where = [np.argwhere(bins == value) for value in (True, False)]
    return np.concatenate([each[rng.integers(len(each), size=count // 2)] for each in where])


def check_centres(grasp_map, robot, count, lower=oracle.LOWER, upper=oracle.UPPER):
    """Bins are as enumeration says of their centres, where a little more or less reach makes no difference."""
    rng = np.random.default_rng(2)
    number = random_numbers(rng, grasp_map, count)
    azimuth, turn, tool = rng.uniform(-3, 3, count), rng.uniform(-3, 3, (count, 2)), rng.uniform(-2, 2, (count, 2))
    poses = in_bins(grasp_map, number, np.zeros((count, 6)), azimuth, turn, tool, robot)
    expected = np.array(
        [[reached(*pair, lower, upper, slack) for slack in (-5e-4, 2e-3)] for pair in zip(*poses, strict=True)]
    )
    clear = expected[:, 0] == expected[:, 1]
    found = grasp_map.bins()[tuple(number.T)]
    np.testing.assert_array_equal(found[clear], expected[clear, 0])
    assert np.mean(clear) > 0.97


def test_bins_are_as_enumeration_says_of_their_centres(coarse, robot):
    check_centres(coarse, robot, 600)


def test_joints_that_do_not_turn_all_round_have_an_axis_each(robot):
    """The first joint by half a turn, the last by a quarter: base headings and the gripper's turns then count."""
    free = np.array([0, 1, 1, 1, 1, 0], bool)
    lower = np.where(free, robot.joint_lower, [-1.6, 0, 0, 0, 0, -0.8])
    upper = np.where(free, robot.joint_upper, [1.6, 0, 0, 0, 0, 0.8])
    limited = robot.replace(joint_lower=lower, joint_upper=upper)
    assert map_shape(limited)[-2:] == (8, 8)
    shape = Shape(step_m=0.2, lowest=5, heights=1, side=11, headings=8, turns=8)
    grasp_map = build_grasp_map(limited, shape=shape)
    check_centres(grasp_map, limited, 400, lower, upper)
    number = random_numbers(np.random.default_rng(0), grasp_map, ROWS)
    still = np.zeros((ROWS, 2))
    poses, grasps = in_bins(grasp_map, number, np.zeros((ROWS, 6)), np.zeros(ROWS), still, still, robot)
    turned = number.copy()
    turned[:, 5] = (turned[:, 5] + 4) % 8
    own, other = (grasp_map.bins()[tuple(each.T)] for each in (number, turned))
    np.testing.assert_array_equal(look_up(grasp_map, poses, single(grasps)), own | other)
    np.testing.assert_array_equal(look_up(grasp_map, poses, single(grasps, symmetric=False)), own)
    one_way = build_grasp_map(limited, PickConfig(gripper_symmetric=False), shape)
    np.testing.assert_array_equal(look_up(one_way, poses, single(grasps)), own)
    assert np.any(other & ~own)


inside = st.floats(-0.45, 0.45)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), base_turn=st.floats(-3, 3), gripper_turn=st.floats(-3, 3))
def test_moved_and_turned_together_base_and_grasp_are_in_the_same_bin(coarse, robot, seed, base_turn, gripper_turn):
    """The base also about its arm's first joint, the gripper also about its own z."""
    rng = np.random.default_rng(seed)
    number = random_numbers(rng, coarse, ROWS)
    number[:, 1] = np.clip(number[:, 1], 1, TILTS - 2)  # the azimuth of what is upright is anything
    offset = rng.uniform(-0.45, 0.45, (ROWS, 6))
    turn = np.tile([base_turn, gripper_turn], (ROWS, 1))
    poses, grasps = in_bins(
        coarse, number, offset, rng.uniform(-3, 3, ROWS), turn, rng.uniform(-2, 2, (ROWS, 2)), robot
    )
    found = look_up(coarse, poses, single(grasps))
    np.testing.assert_array_equal(found, coarse.bins()[tuple(number.T)])


def test_upright_grasps_turn_with_the_scene_too(coarse, robot):
    """Their azimuth is their own; but for rounding at the edges of bins."""
    rng = np.random.default_rng(1)
    base, xy, z = rng.uniform(-0.9, 0.9, (ROWS, 3)), np.zeros((ROWS, 2)), rng.uniform(0.9, 1.3, ROWS)
    for roll in (np.pi, 0.0):
        verdicts = []
        for turn in (0.0, 0.7, -2.5):
            sine, cosine = math.sin(turn), math.cos(turn)
            moved = np.column_stack([base[:, :2] @ [[cosine, sine], [-sine, cosine]], base[:, 2] + turn])
            grasps = np.column_stack([xy, z, np.full(ROWS, roll), np.zeros(ROWS), np.full(ROWS, turn)])
            verdicts.append(look_up(coarse, moved, single(grasps)))
        assert np.mean(verdicts[0] == verdicts[1]) > 0.99
        assert np.mean(verdicts[0] == verdicts[2]) > 0.99
        assert 0.1 < np.mean(verdicts[0]) < 0.9


def test_beyond_the_bins_nothing_is_reached(coarse, robot):
    """Of a map all of whose bins are; it ends half a bin beyond the last centre."""
    everything = dataclasses.replace(coarse, bits=np.full_like(coarse.bits, 255))
    beyond, top, below = 23.5 * 0.05, 44.5 * 0.05, -0.5 * 0.05
    for x, y, z, there in [
        (beyond - 0.01, 0.0, 1.0, True),
        (beyond + 0.01, 0.0, 1.0, False),
        (0.0, 0.01 - beyond, 1.0, True),
        (0.0, -0.01 - beyond, 1.0, False),
        (0.0, 0.0, top - 0.01, True),
        (0.0, 0.0, top + 0.01, False),
        (0.0, 0.0, below + 0.01, True),
        (0.0, 0.0, below - 0.01, False),
    ]:
        base = np.array([[x, y, 0.0]]) - [*robot.mount_position[:2], 0.0]
        found = look_up(everything, base, single([[0.0, 0.0, z, np.pi / 2, 0.0, np.pi / 2]]))  # it comes along x
        assert found[0] == there


def random_pairs(rng, robot, count):
    """Tools evenly within the sphere that the arm can't leave, turned in any way, and base poses anywhere."""
    direction = rng.normal(size=(4 * count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    radius = 0.425 + 0.3922 + 0.1333 + 0.0997 + 0.0996
    tool = direction * radius * rng.random((4 * count, 1)) ** (1 / 3) + oracle.MOUNT + [0.0, 0.0, 0.1625]
    tool = tool[tool[:, 2] > 0][:count]
    base = rng.uniform([-3, -3, -np.pi], [3, 3, np.pi], (count, 3))
    rpy = Rotation.random(count, rng).as_euler("ZYX")[:, ::-1]
    sine, cosine = np.sin(base[:, 2]), np.cos(base[:, 2])
    x = base[:, 0] + cosine * tool[:, 0] - sine * tool[:, 1]
    y = base[:, 1] + sine * tool[:, 0] + cosine * tool[:, 1]
    return base, np.column_stack([x, y, tool[:, 2], rpy])


def rates(grasp_map, robot, count):
    """Shares of what is reached, and of what isn't, that the map says are reached."""
    base, grasps = random_pairs(np.random.default_rng(7), robot, count)
    found = look_up(grasp_map, base, single(grasps))
    truth = np.array([reached(*pair) for pair in zip(base, grasps, strict=True)])
    assert 0.3 < np.mean(truth) < 0.6
    return np.mean(found[truth]), np.mean(found[~truth])


def test_the_map_is_nearly_always_right(coarse, robot):
    """Measured with bins of 5 cm, over 100,000 pairs: 0.977 and 0.020."""
    true_positive, false_positive = rates(coarse, robot, 3_000)
    assert true_positive > 0.96
    assert false_positive < 0.035


@pytest.mark.slow
def test_the_default_map_is_as_good_as_the_docs_say(robot):
    """0.984 and 0.011."""
    grasp_map = build_grasp_map(robot)
    assert grasp_map.bits.nbytes < 2e6
    true_positive, false_positive = rates(grasp_map, robot, 20_000)
    assert true_positive > 0.98
    assert false_positive < 0.015


def test_without_a_closed_form_bins_are_those_that_joints_lead_into(robot, monkeypatch):
    monkeypatch.setattr(grasp_map_build, "_SAMPLES", 2**20)
    shape = Shape(step_m=0.1, lowest=0, heights=23, side=23, headings=1, turns=1)
    sampled = build_grasp_map(robot.replace(closed_form=None), shape=shape)
    true_positive, false_positive = rates(sampled, robot, 1_000)
    assert true_positive > 0.95
    assert false_positive < 0.25, "a bin is reached if any part of it is"


def test_arms_that_turn_all_round_have_four_axes_and_small_maps():
    for name, step in (("ur5e_mobile", 0.025), ("panda_mobile", 0.05), ("ridgeback_ur5e", 0.025)):
        shape = map_shape(load_robot(name))
        assert shape.step_m == step
        assert (shape.headings, shape.turns) == (1, 1)
        assert shape.total <= 8 * 2e6


def test_a_map_is_the_same_every_time(coarse, robot):
    again = build_grasp_map(robot, shape=COARSE)
    assert isinstance(again, GraspMap)
    np.testing.assert_array_equal(again.bits, coarse.bits)
