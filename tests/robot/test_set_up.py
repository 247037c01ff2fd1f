"""Set-ups that would make plans for a robot that nobody has: each is refused, with the way out."""

import re

import numpy as np
import pytest

from basenet_jax.robot.posture import link_frames
from basenet_jax.robot.reading import RobotFileError, read_robot, read_source
from basenet_jax.robot.set_up import tool_tilt_degrees
from basenet_jax.robot.tool import axis_turns, from_rpy_degrees, nearest_turn
from tests.robot import mini

TURNED = {  # of the tool's frame: rpy of the URDF's joint that leave this axis pointing out of the gripper
    "x": "0 0 1.5707963267948966",
    "-x": "0 0 -1.5707963267948966",
    "y": "0 0 0",
    "-y": "0 0 3.141592653589793",
    "-z": "1.5707963267948966 0 0",
}


def with_tool(rpy):
    return mini.urdf(tool=mini.TOOL.replace('rpy="-1.5707963267948966 0 0"', f'rpy="{rpy}"'))


def refused(path, *messages):
    with pytest.raises(RobotFileError) as caught:
        read_robot(path)
    for message in messages:
        assert message in str(caught.value)


def test_the_base_case(tmp_path):
    robot = read_robot(mini.write(tmp_path))
    assert tool_tilt_degrees(robot) == pytest.approx(0.0, abs=1e-6)
    frames = link_frames(robot, np.asarray(robot.stow))
    np.testing.assert_allclose(frames[-1, :3, 3], [0.05, -0.04, 1.05373], atol=1e-5)


@pytest.mark.parametrize("axis", TURNED)
def test_a_frame_whose_other_axis_points_out_of_the_gripper(tmp_path, axis):
    """At stow the gripper points down; the turn that the message names makes the robot that of the base case."""
    path = mini.write(tmp_path, with_tool(TURNED[axis]))
    with pytest.raises(RobotFileError, match=re.escape(f"along the frame's {axis}")) as caught:
        read_robot(path)
    turn = [int(x) for x in re.findall(r"rotation_rpy_degrees: \[(.*?)\]", str(caught.value))[0].split(",")]
    frames = {"arm_base": "base_link"}
    fixed = mini.write(
        tmp_path, with_tool(TURNED[axis]), frames=frames, tool={"frame": "tool0", "rotation_rpy_degrees": turn}
    )
    robot = read_robot(fixed)
    assert tool_tilt_degrees(robot) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("axis", ["x", "-y"])
def test_a_stow_pose_that_brings_the_wrong_axis_down_is_no_way_round(tmp_path, axis):
    """The frame's z points down, and the gripper is level."""
    stow = [0, 30, 150, -90, 0, 90]
    source = read_source(mini.write(tmp_path, with_tool(TURNED[axis]), home_degrees=stow, stow_degrees=[*stow]))
    refused(tmp_path / "robot.yaml", "found a frame whose z lies 90° off the last joint's axis", f"the frame's {axis}")
    assert tool_tilt_degrees(source.robot) == pytest.approx(0.0, abs=1e-6)


def test_the_owners_word_counts(tmp_path):
    """A rotation that is given, be it none, says that z is the gripper's axis; then stow has to bring it down."""
    tool = {"rotation_rpy_degrees": [0, 0, 0]}
    refused(mini.write(tmp_path, with_tool(TURNED["x"]), tool=tool), "z is 90° off straight down at stow")


@pytest.mark.parametrize("tilt", [12.0, 45.0, 75.0, 87.0])
def test_a_tilted_stow_is_said_or_refused(tmp_path, tilt):
    stow = [0, 30, 150, -90 - tilt, -90, 90]
    path = mini.write(tmp_path, stow_degrees=stow, grasp_depth=0.05)
    refused(path, f"found a tool frame whose z is {tilt:.0f}° off straight down at stow", "allowed is 0°")
    refused(path, f"say that it is meant: stow_tilt_degrees: {tilt:.0f}")
    path = mini.write(tmp_path, stow_degrees=stow, stow_tilt_degrees=tilt, deck={"center": [0, 0], "size": [0.8, 0.5]})
    assert tool_tilt_degrees(read_source(path).robot) == pytest.approx(tilt, abs=1e-6)
    read_robot(path)
    refused(mini.write(tmp_path, stow_degrees=stow, stow_tilt_degrees=tilt + 10), f"allowed is {tilt + 10:g}°")


def test_an_offset_and_a_grasp_depth_shift_the_frame_that_is_planned_with(tmp_path):
    """With the fingers at the tool frame, that frame is where a flange's fingers are: 0.25 m along its z."""
    plain = read_robot(mini.write(tmp_path))
    tool = {"frame": "tool0", "offset": [0.0, 0.0, 0.25], "rotation_rpy_degrees": [0, 0, 90]}
    tip = read_robot(mini.write(tmp_path, frames={"arm_base": "base_link"}, tool=tool, grasp_depth=0.0))
    np.testing.assert_allclose(tip.tool_position, plain.tool_position, atol=1e-12)
    np.testing.assert_allclose(tip.tool_rotation, plain.tool_rotation @ from_rpy_degrees((0, 0, 90)), atol=1e-12)


@pytest.mark.parametrize(
    ("frames", "tool", "message"),
    [
        (
            {"arm_base": "base_link"},
            None,
            "frames.tool: found nothing, and no tool.frame, allowed is the name of a site",
        ),
        ({"arm_base": "base_link", "tool": "tool0"}, {"frame": "tool0"}, "frames.tool: found tool.frame beside it"),
        ({"arm_base": "base_link"}, {"frame": "hand"}, "tool.frame: found 'hand', allowed are the model's sites"),
        (
            {"arm_base": "base_link"},
            {"frame": "tool0", "turn": 1},
            "tool.turn: found an unknown key, allowed are frame",
        ),
    ],
)
def test_wrong_tools(tmp_path, frames, tool, message):
    refused(mini.write(tmp_path, frames=frames, tool=tool), message)


def test_there_are_24_turns_and_the_nearest_is_found():
    turns = axis_turns()
    assert len({rotation.tobytes() for rotation in turns.values()}) == 24
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(20, 3)):
        turn, off = nearest_turn(np.eye(3), direction)
        z = from_rpy_degrees(turn)[:, 2]
        assert z @ direction == pytest.approx(np.max(np.abs(direction)))
        assert np.cos(np.radians(off)) == pytest.approx(np.max(np.abs(direction)) / np.linalg.norm(direction))


PLACES = [
    (
        {"stow_degrees": [170, 30, 150, -90, -90, 90]},
        "stow_degrees: found fingers at (-0.56, -0.21, 0.80)",
        "beside the",
    ),
    (
        {"deck": {"center": [-2.5, 2.5], "size": [0.3, 0.3]}},
        "deck: found a place 2.40 m beyond the base's footprint",
        "",
    ),
    ({"deck": {"center": [0.3, 0.05], "size": [0.45, 0.35]}}, "deck: found a place 0.12 m beyond the base's", ""),
    (
        {"deck": {"center": [-0.2, -0.1], "size": [0.2, 0.2]}},
        "stow_degrees: found fingers at",
        "0.15 m beside the deck",
    ),
    ({"mount": {"position": [1.4, 0.0, 1.0]}}, "mount.position: found a place 1.00 m beyond the base's footprint", ""),
    (
        {"mount": {"position": [-0.25, -0.15, 1.8]}},
        "stow_degrees: found fingers at",
        "0.85 m above the body's top, allow",
    ),
    (
        {"mount": {"position": [-0.25, -0.15, 0.7]}},
        "home_degrees: found fingers at (0.05, -0.04, 0.50)",
        "in the robot's",
    ),
]


@pytest.mark.parametrize(("fields", "message", "more"), PLACES, ids=range(len(PLACES)))
def test_what_is_not_on_the_robot_is_refused(tmp_path, fields, message, more):
    refused(mini.write(tmp_path, **fields), message, more)


def test_a_body_beside_its_footprint_is_refused(tmp_path):
    body = {"center": [0.5, 0, 0.375], "size": [0.8, 0.5, 0.75]}
    refused(mini.write(tmp_path, base={**mini.ROBOT["base"], "body": body}), "base.body: found a place 0.50 m beyond")


RADIANS = [
    ({"home_degrees": [0, 0.52, 2.6, -1.57, -1.57, 1.57]}, "home_degrees: found [0.0, 0.52, 2.6, -1.57,"),
    ({"stow_degrees": [0, 0.52, 2.6, -1.57, -1.57, 1.57]}, "stow_degrees: found [0.0, 0.52, 2.6, -1.57,"),
    ({"mount": {"position": [-0.25, -0.15, 1.0], "rpy_degrees": [0, 0, 1.5708]}}, "mount.rpy_degrees[2]: found 1.5708"),
    (
        {"mount": {"position": [-0.25, -0.15, 1.0], "rpy_degrees": [3.14, 0, 0]}},
        "mount.rpy_degrees[0]: found 3.14, all",
    ),
    (
        {"tool": {"rotation_rpy_degrees": [0, -0.785, 0]}},
        "tool.rotation_rpy_degrees[1]: found -0.785, allowed are degr",
    ),
]


@pytest.mark.parametrize(("fields", "message"), RADIANS, ids=range(len(RADIANS)))
def test_radians_in_place_of_degrees(tmp_path, fields, message):
    refused(mini.write(tmp_path, **fields), message, "radians")


def test_an_arm_stretched_out_at_zero_is_no_fault_of_units(tmp_path):
    """All zeros are zeros in any unit; a mount may be a degree off level."""
    fields = {"home_degrees": [0] * 6, "mount": {"position": [-0.25, -0.15, 1.0], "rpy_degrees": [0.7, 1.2, 0]}}
    read_source(mini.write(tmp_path, **fields))
