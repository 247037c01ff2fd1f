"""What a model says of its joints: followed where it is a standard's, refused by name where no plan would be right."""

import re

import numpy as np
import pytest

from basenet_jax.evaluation.robot_check import compare_with_mujoco
from basenet_jax.robot.reading import RobotFileError, read_robot, read_source
from tests.robot import mini

TURN = np.radians(360.0)


def refused(path, *messages):
    with pytest.raises(RobotFileError) as caught:
        read_robot(path)
    for message in messages:
        assert message in str(caught.value)


@pytest.mark.parametrize(
    "limit", ["", '<limit effort="1" velocity="1"/>', '<limit lower="-1" upper="1" velocity="1"/>']
)
def test_a_continuous_joint_turns_for_ever_whatever_its_limits(tmp_path, limit):
    robot = read_robot(mini.write(tmp_path, mini.urdf(j1=mini.joint("j1", "continuous", limit))))
    assert (robot.joint_lower[0], robot.joint_upper[0]) == (-TURN, TURN)
    assert robot.joint_upper[1] == pytest.approx(3.1)


def test_what_may_not_be_meant_is_noted_by_name(tmp_path):
    model = mini.urdf(j1=mini.joint("j1", "continuous", ""))
    source = read_source(mini.write(tmp_path, model, joint_speed=[1.0, 2.0, 2.5, 1.0, 1.0, 1.0]))
    assert source.notes == (
        "j1 has no limits in the model: it is planned with a whole turn either way",
        "j3 is planned with 2.5 /s, and its model allows 2 /s: see joint_speed",
    )


def test_an_axis_is_along_x_unless_it_is_given(tmp_path):
    """The standard's default."""
    model = mini.urdf(j2=mini.joint("j2").replace('<axis xyz="0 1 0"/>', ""))
    same = mini.urdf(j2=mini.joint("j2").replace("0 1 0", "3 0 0"))
    given = read_source(mini.write(tmp_path / "given", same)).robot
    left_out = read_source(mini.write(tmp_path / "left_out", model)).robot
    np.testing.assert_allclose(left_out.joint_rotation, given.joint_rotation, atol=1e-12)


WRONG = {
    "mimic": (
        mini.joint("j3").replace("<limit", '<mimic joint="j2" multiplier="-1"/><limit'),
        "joints[2]: found 'j3', which the model moves with 'j2', allowed are joints that move by themselves",
    ),
    "no limit": (mini.joint("j3", limit=""), "joints[2]: found 'j3', a revolute joint whose <limit> gives no lower"),
    "limit of speed": (
        mini.joint("j3", limit='<limit velocity="1"/>'),
        "gives no lower or upper, allowed are limits in",
    ),
    "no range of a slide": (
        mini.joint("j3", "prismatic", ""),
        "joints[2]: found 'j3', a prismatic joint whose <limit>",
    ),
    "degrees": (
        mini.joint("j3", limit='<limit lower="-180" upper="180"/>'),
        "joints[2]: found 'j3', which turns from -180 to 180 rad in the model, allowed are limits up to 12.7 rad (are",
    ),
    "one in degrees": (
        mini.joint("j3", limit='<limit lower="-3" upper="150"/>'),
        "which turns from -3 to 150 rad in the",
    ),
    "twice degrees": (
        mini.joint("j3", limit='<limit lower="2.60" upper="2.65"/>'),
        "allowed are ranges of 0.12 rad or m",
    ),
    "planar": (
        mini.joint("j3", "planar"),
        "frames.tool: found 'tool0', behind the planar joint 'j3', allowed is a frame",
    ),
    "floating": (
        mini.joint("j3", "floating"),
        "frames.tool: found 'tool0', behind the floating joint 'j3', allowed is a",
    ),
    "no axis": (
        mini.joint("j3").replace('xyz="0 1 0"', 'xyz="0 0 0"'),
        "model: MuJoCo can't read it: Error: axis too sm",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_joints_that_no_plan_would_be_right_for(tmp_path, what):
    element, message = WRONG[what]
    refused(mini.write(tmp_path, mini.urdf(j3=element)), message)


MJCF = """<mujoco><compiler angle="{angle}"/><worldbody><body name="base">
<body pos="0 0 .16"><joint name="j1" axis="0 0 1" {range}/><geom size=".05"/>
<body pos="0 .14 0"><joint name="j2" axis="0 1 0"/><geom type="capsule" size=".05" fromto="0 0 0 0 0 .4"/>
<body pos="0 -.12 .42"><joint name="j3" axis="0 1 0"/><geom type="capsule" size=".05" fromto="0 0 0 0 0 .4"/>
<body pos="0 0 .39"><joint name="j4" axis="0 1 0"/><geom size=".05"/>
<body pos="0 .09 0"><joint name="j5" axis="0 0 1"/><geom size=".05"/>
<body pos="0 0 .09"><joint name="j6" axis="0 1 0"/><geom size=".05"/><site name="tool0" pos="0 .08 0" euler="{euler}"/>
</body></body></body></body></body></body></body></worldbody><equality>{equality}</equality></mujoco>"""


def mjcf(folder, *, angle="degree", limits="", equality=""):
    euler = "-90 0 0" if angle == "degree" else "-1.5707963 0 0"
    path = mini.write(folder, frames={"arm_base": "base", "tool": "tool0"})
    (folder / "mini.urdf").write_text(MJCF.format(angle=angle, range=limits, equality=equality, euler=euler))
    return path


def test_an_mjcf_with_equalities_or_radians_among_its_degrees(tmp_path):
    assert read_robot(mjcf(tmp_path)).joint_upper[0] == TURN
    equality = '<joint joint1="j3" joint2="j2"/>'
    refused(mjcf(tmp_path, equality=equality), "joints[2]: found 'j3', which the model moves with 'j2'")
    refused(
        mjcf(tmp_path, limits='range="-3.1 3.1"'), "joints[0]: found 'j1', which turns from -0.05411 to 0.05411 rad"
    )
    refused(mjcf(tmp_path, angle="radian", limits='range="-180 180"'), "which turns from -180 to 180 rad")


ODOM = '<link name="odom"/><joint name="jb" type="{}"><parent link="odom"/><child link="base_link"/></joint>'


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_the_joint_that_moves_the_base_is_none_of_the_arms(tmp_path, kind):
    plain = read_robot(mini.write(tmp_path / "plain"))
    moving = read_robot(mini.write(tmp_path / kind, mini.urdf(ODOM.format(kind))))
    np.testing.assert_array_equal(moving.joint_position, plain.joint_position)


LIFT = (
    '<link name="chassis"/><joint name="lift" type="prismatic"><parent link="chassis"/><child link="column"/>'
    '<axis xyz="0 0 1"/><limit lower="0" upper="0.4" velocity="0.1"/></joint><link name="column"/>'
    '<joint name="turn" type="revolute"><parent link="column"/><child link="base_link"/><axis xyz="0 0 1"/>'
    '<limit lower="-3" upper="3" velocity="1"/></joint>'
)
FINGER = (
    '<link name="finger"/><joint name="grip" type="prismatic"><parent link="tool0"/><child link="finger"/>'
    '<axis xyz="0 0 1"/><limit lower="0" upper="0.04" velocity="1"/></joint>'
)


def eight(folder, lift=0.1):
    mini_arm = mini.ROBOT["home_degrees"]
    return mini.write(
        folder,
        mini.urdf(LIFT),
        frames={"arm_base": "chassis", "tool": "tool0"},
        joints=["lift", "turn", *mini.ROBOT["joints"]],
        joint_speed=[0.1] + [1.0] * 7,
        joint_acceleration=[0.5] + [1.4] * 7,
        home_degrees=[lift, 0, *mini_arm],
        stow_degrees=[lift, 0, *mini_arm],
    )


def test_a_lift_and_seven_joints(tmp_path):
    source = read_source(eight(tmp_path))
    assert source.robot.prismatic == (True,) + (False,) * 7
    assert compare_with_mujoco(source).is_small
    read_robot(tmp_path / "robot.yaml")


def test_joints_that_are_frozen(tmp_path):
    """A lift at 0.1 m and a turn by 30 degrees are part of the arm's base; a finger's joint is part of the tool."""
    fields = {"frames": {"arm_base": "chassis", "tool": "finger"}, "fixed": {"lift": 0.1, "turn": 30, "grip": 0.02}}
    source = read_source(mini.write(tmp_path, mini.urdf(LIFT + FINGER), **fields))
    assert compare_with_mujoco(source).is_small
    plain = read_source(mini.write(tmp_path / "plain")).robot
    robot = source.robot
    np.testing.assert_allclose(robot.joint_position[0], np.add(plain.joint_position[0], [0, 0, 0.1]), atol=1e-12)
    turn = np.array([[np.cos(np.pi / 6), -0.5, 0], [0.5, np.cos(np.pi / 6), 0], [0, 0, 1]])
    np.testing.assert_allclose(robot.joint_rotation[0], turn @ plain.joint_rotation[0], atol=1e-12)
    np.testing.assert_allclose(robot.tool_position, plain.tool_position + 0.02 * plain.tool_rotation[:, 2], atol=1e-12)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"frames": {"arm_base": "base_link", "tool": "finger"}}, "(or freeze some at a value: fixed: {grip: 0})"),
        ({"fixed": {"knee": 1.0}}, "fixed.knee: found a joint that the model hasn't, or that moves in several ways"),
        (
            {"fixed": {"j1": 1.0}},
            "fixed.j1: found a joint that joints lists too, allowed is each joint in one of the two",
        ),
        ({"fixed": {"grip": "open"}}, "fixed.grip: found 'open', allowed is a number from -720 to 720"),
        ({"fixed": [1]}, "fixed: found [1], allowed is a mapping of joints' names and where they stay"),
    ],
)
def test_wrong_frozen_joints(tmp_path, fields, message):
    refused(mini.write(tmp_path, mini.urdf(FINGER), **fields), message)


def test_five_joints_are_refused_with_what_they_can_t_do(tmp_path):
    fields = {name: mini.ROBOT[name][:5] for name in ("joints", "joint_speed", "joint_acceleration")}
    fields |= {name: mini.ROBOT[name][:5] for name in ("home_degrees", "stow_degrees")}
    message = re.escape(
        "allowed is a list of 6 to 8 joint names, from arm base to tool (with fewer a gripper can't be held"
    )
    with pytest.raises(RobotFileError, match=message):
        read_robot(mini.write(tmp_path, **fields))
