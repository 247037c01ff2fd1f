"""Drives as legs, through given poses and along polylines."""

import math

import numpy as np
import pytest

from basenet_jax.task.manoeuvre import Gear, Manoeuvre, along_path, through, turn_time
from tests.oracles.timing import trapezoid


def test_legs_through_poses(robot):
    poses = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (-1.0, 0.0, 2.0), (-1.0, 0.0, 2.0)]
    drive = through(robot, poses)
    assert [(leg.turn, leg.straight, leg.direction) for leg in drive.legs] == [(0.0, -1.0, 0.0), (2.0, 0.0, 0.0)]
    times = [trapezoid(1.0, 0.5, 0.5), trapezoid(2.0, 0.5, 1.0)]
    assert [leg.time_s for leg in drive.legs] == pytest.approx(times)
    assert drive.time_s == pytest.approx(sum(times))


def test_a_piece_across_the_heading_says_in_which_direction(robot):
    (leg,) = through(robot, [(0.0, 0.0, 1.0), (-2.0 * math.sin(1.0), 2.0 * math.cos(1.0), 1.0)]).legs
    assert (leg.straight, leg.direction) == (pytest.approx(2.0), pytest.approx(math.pi / 2))


def test_nowhere_to_go(robot):
    assert through(robot, [(1.0, 2.0, 3.0)] * 3).legs == ()
    assert through(robot, []).time_s == turn_time(robot, 0.0) == 0.0


@pytest.mark.parametrize(("heading", "straights"), [(0.1, [1.0, 2.0]), (3.0, [-1.0, -2.0])])
def test_all_forward_or_all_in_reverse(robot, heading, straights):
    path = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 2.0)])
    drive = along_path(robot, path, (0.0, 0.0, heading), (1.0, 2.0, heading + 1.5), same_pose=1e-6)
    assert [leg.straight for leg in drive.legs if leg.straight] == pytest.approx(straights)
    assert drive.legs[-1].after == pytest.approx((1.0, 2.0, heading + 1.5))


def test_the_gear_and_where_it_goes_straight_to_the_goal(robot):
    turn, back = through(robot, [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (-math.cos(1.0), -math.sin(1.0), 1.0)]).legs
    assert (turn.gear, back.gear) == (None, Gear.REVERSE)
    assert Manoeuvre((turn, back)).staging_pose == pytest.approx((0.0, 0.0, 1.0))
    assert Manoeuvre((turn,)).staging_pose == pytest.approx((0.0, 0.0, 1.0))
    assert Manoeuvre(()).staging_pose is None
    (aside,) = through(robot, [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0)]).legs
    assert aside.gear == Gear.SIDEWAYS


def test_never_in_reverse(robot):
    path = np.array([(0.0, 0.0), (1.0, 0.0)])
    drive = along_path(robot, path, (0.0, 0.0, 3.0), (1.0, 0.0, 3.0), same_pose=1e-6, reverse=False)
    assert [leg.gear for leg in drive.legs] == [None, Gear.FORWARD, None]


def test_with_the_heading_kept_one_turn_at_the_end(robot):
    drive = along_path(
        robot, [(0.0, 0.0), (0.0, 2.0)], (0.0, 0.0, 0.5), (0.0, 2.0, -0.5), same_pose=1e-6, keep_heading=True
    )
    assert [leg.turn for leg in drive.legs] == pytest.approx([0.0, -1.0])
    assert drive.legs[0].direction == pytest.approx(math.pi / 2 - 0.5)
