"""First robot files: for models with nothing but a chain, a file that is accepted, with all that is guessed marked."""

import numpy as np
import pytest
import yaml

from basenet_jax.commands.robot import main
from basenet_jax.robot.posture import link_frames
from basenet_jax.robot.reading import read_robot
from tests.robot import mini
from tests.robot.conftest import ASSETS

X_OUT = mini.TOOL.replace('rpy="-1.5707963267948966 0 0"', 'rpy="0 0 1.5707963267948966"')
TWO = "".join(
    part.replace('"j', '"right_j').replace('"l', '"right_l').replace("tool0", "right_tool0")
    for part in (
        *(f'<link name="l{i}">{mini.shape(f"l{i}")}</link>' for i in range(1, 7)),
        *map(mini.joint, mini.JOINTS),
        mini.TOOL,
    )
)


def init(folder, text, *options, name="mini.urdf"):
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    return main(["init", str(folder / name), *options])


@pytest.mark.parametrize(("tool", "turn"), [(mini.TOOL, None), (X_OUT, [0, 90, 0])], ids=["z out", "x out"])
def test_a_file_for_a_urdf_is_accepted(tmp_path, capsys, tool, turn):
    assert init(tmp_path, mini.urdf(tool=tool)) == 0
    assert "6 joints from base_link to tool0; correct what is guessed" in capsys.readouterr().out
    robot = read_robot(tmp_path / "robot.yaml")
    assert robot.joint_names == tuple(mini.ROBOT["joints"])
    np.testing.assert_array_equal(robot.joint_speed, 2.0)
    fingers = link_frames(robot, np.asarray(robot.stow))[-1]
    np.testing.assert_allclose(fingers[:3, 2], [0, 0, -1], atol=1e-3)
    np.testing.assert_allclose(fingers[:2, 3], robot.deck[:2], atol=2e-3)
    text = (tmp_path / "robot.yaml").read_text()
    assert text.count("guessed") == 8
    assert yaml.safe_load(text)["tool"].get("rotation_rpy_degrees") == turn


def test_a_file_for_an_mjcf_of_seven_joints(tmp_path):
    assert init(tmp_path, (ASSETS / "panda.xml").read_text(), name="panda.xml") == 0
    assert read_robot(tmp_path / "robot.yaml").dof == 7


def test_one_of_two_arms_is_chosen_by_its_tool(tmp_path, capsys):
    assert init(tmp_path, mini.urdf(TWO), "--tool", "right_tool0") == 0
    assert read_robot(tmp_path / "robot.yaml").joint_names[0] == "right_j1"
    assert init(tmp_path / "any", mini.urdf(TWO)) == 0
    assert "other tool frames (--tool): right_tool0, " in capsys.readouterr().out


def test_a_jaw_is_no_joint_of_the_arm_nor_a_camera_its_tool(tmp_path, capsys):
    """Six joints of which the last one opens a gripper are an arm of five; a TCP is where the fingers meet."""
    jaw = mini.urdf(j6=mini.joint("j6").replace('"j6"', '"Jaw"'))
    assert init(tmp_path, jaw) == 2
    assert "model: found 5 joints in a row at most, allowed are arms of 6 or more" in capsys.readouterr().err
    ends = '<parent link="tool0"/><child link="{0}"/><origin xyz="0 0 0.1"/>'
    names = ("hand_camera", "tcp")
    frames = "".join(f'<link name="{n}"/><joint name="to_{n}" type="fixed">{ends.format(n)}</joint>' for n in names)
    assert init(tmp_path, mini.urdf(frames), "--tool", "tcp") == 0
    assert yaml.safe_load((tmp_path / "robot.yaml").read_text())["grasp_depth"] == 0.0
    assert init(tmp_path / "any", mini.urdf(frames).replace("tool0", "last")) == 0
    assert yaml.safe_load((tmp_path / "any" / "robot.yaml").read_text())["tool"]["frame"] == "tcp"


def test_visual_shapes_are_taken_where_there_are_no_others(tmp_path):
    visual = {link: mini.shape(link).replace("collision", "visual") for link in mini.LINKS}
    assert init(tmp_path, mini.urdf(**visual)) == 0
    assert "shapes: visual" in (tmp_path / "robot.yaml").read_text()


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (mini.urdf(), ["--tool", "hand"], "--tool: found 'hand', allowed are the model's sites and bodies: base_link"),
        (mini.urdf(), ["--arm-base", "sky"], "--arm-base: found 'sky', allowed are the model's sites and bodies"),
        (mini.urdf(), ["--package", "arms"], "--package: found 'arms', allowed are NAME=DIR"),
        ("<robot/>", [], "mini.urdf: "),
        ("<robot", [], "mini.urdf: mini.urdf: no XML"),
        (
            mini.urdf(j6=mini.joint("j6", "fixed", "")),
            [],
            "model: found 5 joints in a row at most, allowed are arms",
        ),
        (
            mini.urdf(),
            ["--out", "nowhere/robot.yaml"],
            "--out: found 'nowhere/robot.yaml', allowed are files in the",
        ),
    ],
    ids=range(7),
)
def test_what_can_not_be_is_said(tmp_path, capsys, text, options, message):
    assert init(tmp_path, text, *options) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "robot.yaml").exists()


def test_no_file_is_written_over(tmp_path, capsys):
    (tmp_path / "robot.yaml").write_text("mine")
    assert init(tmp_path, mini.urdf()) == 2
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "robot.yaml").read_text() == "mine"
