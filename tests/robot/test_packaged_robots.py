"""Every packaged robot: the maker's numbers, and a home and a stow that make sense."""

import jax
import numpy as np
import pytest

from basenet_jax.robot.reading import load_robot, packaged_robots
from basenet_jax.world.boxes import Room
from tests import compiled

HALF_PI = np.pi / 2
# Denavit-Hartenberg parameters as the makers publish them: d, a, alpha, one row for each joint.
UR_ALPHA = (HALF_PI, 0.0, 0.0, HALF_PI, -HALF_PI, 0.0)
UR = {
    "ur3e_mobile": ((0.15185, 0, 0, 0.13105, 0.08535, 0.0921), (0, -0.24355, -0.2132, 0, 0, 0)),
    "ur5e_mobile": ((0.1625, 0, 0, 0.1333, 0.0997, 0.0996), (0, -0.425, -0.3922, 0, 0, 0)),
    "ur10e_mobile": ((0.1807, 0, 0, 0.17415, 0.11985, 0.11655), (0, -0.6127, -0.57155, 0, 0, 0)),
}
UR["ridgeback_ur5e"] = UR["ur5e_mobile"]
PANDA_D = (0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0)
PANDA_A = (0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088)  # Craig's convention: before the joint
PANDA_ALPHA = (0.0, -HALF_PI, HALF_PI, HALF_PI, -HALF_PI, HALF_PI, HALF_PI)
PANDA_FLANGE, PANDA_HAND = 0.107, -np.pi / 4
FLOAT64 = 1e-12
TOOL_M = 5e-5  # home and stow are given in thousandths of a degree: at 1.3 m that is 2e-5 m
GRIPPER_M = 0.25  # from tool0 to its tip
ROBOTS = ("panda_mobile", *sorted(UR))


def turn(axis, angle):
    cosine, sine = np.cos(angle), np.sin(angle)
    result = np.eye(4)
    one, other = {"x": (1, 2), "z": (0, 1)}[axis]
    result[one, one] = result[other, other] = cosine
    result[one, other], result[other, one] = -sine, sine
    return result


def shift(x, z):
    result = np.eye(4)
    result[:3, 3] = x, 0.0, z
    return result


def ur_tool(name, joints):
    d, a = UR[name]
    frame = np.eye(4)
    for q, d_i, a_i, alpha in zip(joints, d, a, UR_ALPHA, strict=True):
        frame = frame @ turn("z", q) @ shift(0.0, d_i) @ shift(a_i, 0.0) @ turn("x", alpha)
    return frame


def panda_tool(joints):
    frame = np.eye(4)
    for q, d, a, alpha in zip(joints, PANDA_D, PANDA_A, PANDA_ALPHA, strict=True):
        frame = frame @ turn("x", alpha) @ shift(a, 0.0) @ turn("z", q) @ shift(0.0, d)
    return frame @ shift(0.0, PANDA_FLANGE) @ turn("z", PANDA_HAND)


def tool_in_base(robot, joints):
    with jax.enable_x64(True):
        position, rotation = (x[0] for x in compiled.forward_kinematics(robot, np.asarray(joints, float)[None]))
    mount = np.asarray(robot.mount_rotation)
    return mount @ np.asarray(position) + robot.mount_position, mount @ np.asarray(rotation)


def test_these_are_all():
    assert packaged_robots() == tuple(sorted(ROBOTS))


@pytest.mark.parametrize("name", ROBOTS)
def test_the_tool_is_where_the_makers_parameters_put_it(name):
    robot = load_robot(name)
    joints = np.random.default_rng(1).uniform(robot.joint_lower, robot.joint_upper, (20, robot.dof))
    with jax.enable_x64(True):
        position, rotation = compiled.forward_kinematics(robot, joints)
    expected = np.array([panda_tool(q) if name == "panda_mobile" else ur_tool(name, q) for q in joints])
    np.testing.assert_allclose(position, expected[:, :3, 3], atol=FLOAT64)
    np.testing.assert_allclose(rotation, expected[:, :3, :3], atol=FLOAT64)


def test_one_of_them_drives_in_any_direction():
    assert [name for name in ROBOTS if load_robot(name).omnidirectional] == ["ridgeback_ur5e"]


def test_the_closed_form_is_used_where_there_is_one():
    known = dict.fromkeys(UR, "ur") | {"panda_mobile": "spherical-shoulder"}
    assert {name: load_robot(name).closed_form for name in ROBOTS} == known


@pytest.mark.parametrize(
    ("name", "where"),
    [(name, where) for name in ROBOTS for where in ("home", "stow") if (name, where) != ("ur5e_mobile", "home")],
)
def test_the_gripper_hangs_over_the_deck(name, where):
    """Tool down; but for the UR5e's home, which is the release's and not quite so."""
    robot = load_robot(name)
    position, rotation = tool_in_base(robot, getattr(robot, where))
    np.testing.assert_allclose(rotation[:, 2], [0.0, 0.0, -1.0], atol=1e-4)
    tip = position + GRIPPER_M * rotation[:, 2]
    deck = np.asarray(robot.deck)
    assert np.all(np.abs(tip[:2] - deck[:2]) <= deck[2:] / 2 + TOOL_M)
    top = robot.body_center[2] + robot.body_half_size[2]
    assert top + 0.1 < tip[2] < top + 0.6


@pytest.mark.parametrize("name", ROBOTS)
def test_home_and_stow_and_the_way_between_are_clear(name):
    robot = load_robot(name)
    ways = np.linspace(robot.home, robot.stow, 11).astype(np.float32)
    far = np.tile(np.array([9.0, 0.0, 0.0], np.float32), (len(ways), 1))
    assert not np.any(compiled.arm_collides(robot, far, ways, Room.from_config()))
    margin = np.minimum(robot.home - robot.joint_lower, robot.joint_upper - robot.home)
    assert np.all(margin > np.radians(5.0))
