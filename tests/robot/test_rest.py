"""Home, stow and the move between: refused where the clearance kernel finds a touch from some allowed place."""

import dataclasses
import re

import jax
import numpy as np
import pytest

from basenet_jax.config import PickConfig
from basenet_jax.documents.fields import DocumentError
from basenet_jax.robot.reading import RobotFileError, find_source, load_robot, packaged_robots
from basenet_jax.robot.rest import check_body, check_tables
from basenet_jax.world.boxes import Room
from tests import compiled
from tests.robot.test_reading import put, read

FAR = np.array([50.0, 0.0, 0.0], np.float32)
WIDE = 3.0  # m, half the sides of a table that is large enough
HEADINGS = np.linspace(-np.pi, np.pi, 60, endpoint=False)
MARGIN = 2e-3  # m: the arm may reach half a millimetre farther between two directions, and headings are 6 degrees apart


def passes(check, *given):
    try:
        check(*given)
    except DocumentError:
        return False
    return True


def resting(robot, joints):
    return dataclasses.replace(robot, home=joints, stow=joints)


def test_the_body_is_touched_where_the_kernel_says_so(robot, room):
    joints = np.random.default_rng(5).uniform(-2.5, 2.5, (300, 6))
    touches = compiled.arm_collides(robot, FAR, joints.astype(np.float32), room)
    assert 20 < np.sum(touches) < 280
    assert [not passes(check_body, resting(robot, state)) for state in joints] == touches.tolist()


def test_the_move_between_is_checked_too(robot):
    """From upright to upright, once round."""
    home, stow = (np.array([0.0, lift, 0.5, 0.0, 0.0, 0.0]) for lift in (-1.4, 4.5))
    assert passes(check_body, resting(robot, home))
    assert passes(check_body, resting(robot, stow))
    with pytest.raises(DocumentError, match=r"stow_degrees: found between stow and home \(shoulder_pan 0, .*touches"):
        check_body(dataclasses.replace(robot, home=home, stow=stow))


def touches_beside(robot, height, clearance):
    """Whether the kernel finds the arm touching a wide table from places beside it, turned in all ways."""
    ways = np.linspace(robot.home, robot.stow, PickConfig().swept_points + 2)
    half = np.abs(np.cos(HEADINGS)) * robot.footprint_half_size[0] + np.abs(np.sin(HEADINGS)) * 0.25
    poses = np.stack([WIDE + clearance + half, 0.0 * HEADINGS, HEADINGS], axis=-1)
    wide = Room.of_table(np.array([WIDE, WIDE], np.float32), np.float32(height), np)
    return bool(np.any(compiled.arm_collides(robot, poses[:, None], ways, wide)))


@pytest.mark.parametrize(("name", "height"), [("ur5e_mobile", 1.1), ("panda_mobile", 1.5), ("ur10e_mobile", 1.25)])
def test_tables_are_safe_up_to_the_clearance_at_which_the_kernel_finds_a_touch(name, height):
    robot, low, high = load_robot(name), 0.0, 0.5
    while high - low > 1e-4:
        middle = (low + high) / 2
        safe = passes(check_tables, robot, height, PickConfig(base_clearance_m=middle))
        low, high = (low, middle) if safe else (middle, high)
    assert MARGIN < high < 0.3, "the arm reaches beyond the footprint"
    assert touches_beside(robot, height, high - MARGIN)
    assert not touches_beside(robot, height, high + MARGIN)


@pytest.mark.parametrize("name", packaged_robots())
def test_packaged_robots_rest_beside_usual_tables(name):
    robot = load_robot(name)
    check_body(robot)
    check_tables(robot, 1.2)


@pytest.mark.parametrize("name", packaged_robots())
def test_a_robot_in_single_precision_is_the_same(name):
    robot, config = load_robot(name), PickConfig(base_clearance_m=0.02)
    single = jax.tree.map(np.float32, robot)
    check_body(single)
    for height in (0.75, 0.9, 1.1, 1.3):
        assert passes(check_tables, single, height, config) == passes(check_tables, robot, height, config)


def test_what_is_below_no_table_is_safe_without_any_clearance(robot):
    check_tables(robot, 0.7, PickConfig(base_clearance_m=0.0))


def test_a_table_that_a_resting_arm_may_touch_is_refused_by_name():
    message = (
        "home_degrees: found at home (joint1 20, joint2 -45, joint3 0, joint4 -135, joint5 0, joint6 90, joint7 45)"
        " the link behind joint3 reaches 0.120 m beyond the footprint below a table's top at 1.5 m, allowed is 0.1 m"
    )
    with pytest.raises(DocumentError, match=re.escape(message)):
        check_tables(load_robot("panda_mobile"), 1.5)


@pytest.mark.parametrize("where", ["home", "stow"])
def test_a_file_whose_arm_rests_in_its_body_is_refused_by_name(files, where):
    content, path = files
    joints = [0.0, 60.0, 60.0, 0.0, 0.0, 0.0]
    changed = put(content, [f"{where}_degrees"], joints)
    message = (
        f"{path}: {where}_degrees: found at {where} (shoulder_pan 0, shoulder_lift 60, elbow 60, wrist_1 0, wrist_2 0,"
        " wrist_3 0) the link behind elbow touches the robot's body, allowed are joints at which only the first link"
    )
    with pytest.raises(RobotFileError, match=re.escape(message)):
        read(changed, path)
    with pytest.raises(RobotFileError, match=re.escape(message)):
        load_robot(str(path))
    assert find_source(str(path)).robot.name == "mine", "so that it can be looked at"
