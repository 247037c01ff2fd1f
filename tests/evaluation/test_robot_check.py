"""The robot check: right about right robots, and about each thing that may be wrong with one."""

import dataclasses
import re

import numpy as np
import pytest
import yaml

from basenet_jax.commands.robot import main
from basenet_jax.evaluation.robot_check import (
    compare_with_mujoco,
    find_causes,
    rest_faults,
    solved_share,
)
from basenet_jax.evaluation.servable import random_grasps, serve
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.robot.reading import find_source, read_source
from basenet_jax.task.picking import Reason
from tests.robot.conftest import ASSETS


@pytest.fixture(scope="module")
def grasps(robot, room):
    return random_grasps(robot, room, 24, 0)


@pytest.fixture
def make(tmp_path):
    """A robot file with some fields changed, and the model's text."""

    def make(edit=lambda text: text, **fields):
        content = yaml.safe_load((ASSETS / "ur5e_mobile.yaml").read_text())
        (tmp_path / content["model"]).write_text(edit((ASSETS / content["model"]).read_text()))
        path = tmp_path / "mine.yaml"
        content = {**content, "name": "mine", **fields}
        if not content["closed_form"]:
            del content["closed_form"]
        path.write_text(yaml.safe_dump(content))
        return path

    return make


def test_the_packaged_robot_serves_the_table(robot, room, grasps):
    served = serve(robot, grasps, aligned_poses(robot, room), room)
    assert served.share == 1.0
    assert np.all((served.pick_time > 5.0) & (served.pick_time < 20.0))


@pytest.mark.parametrize("name", ["ur10e_mobile", "panda_mobile"])
def test_kinematics_agree_with_mujoco(name):
    assert compare_with_mujoco(find_source(name)).is_small


def test_a_wrong_length_is_noticed():
    source = find_source("ur5e_mobile")
    position = source.robot.joint_position + np.array([[0, 0, 0]] * 5 + [[0, 0, 1e-6]])
    difference = compare_with_mujoco(source._replace(robot=dataclasses.replace(source.robot, joint_position=position)))
    assert difference.position_m == pytest.approx(1e-6, rel=1e-3)
    assert not difference.is_small


def test_inverse_kinematics_is_solved_from_the_lattice(robot):
    assert solved_share(robot) > 0.9
    narrow = robot.replace(joint_upper=robot.joint_lower + 0.1)
    assert solved_share(narrow.replace(home=narrow.joint_lower)) == 1.0


def test_an_arm_that_rests_in_the_body_or_over_the_table_is_noticed(room):
    source = find_source("ur5e_mobile")
    robot = source.robot
    assert rest_faults(source, room) == []
    high = dataclasses.replace(robot, body_half_size=robot.body_half_size + np.array([0.0, 0.0, 0.4]))
    fault, _ = rest_faults(source._replace(robot=high), room)
    assert fault.startswith("home_degrees: found at home (shoulder_pan -180, ")
    assert "touches the robot's body" in fault
    low = dataclasses.replace(robot, mount_position=robot.mount_position + np.array([0.6, 0.0, -0.3]))
    assert "beyond the footprint below a table's top at 0.75 m" in rest_faults(source._replace(robot=low), room)[-1]


def limited(text, ranges):
    """The model with other limits (degrees) of some joints."""
    for joint, (low, high) in ranges.items():
        limits = f'range="{np.radians(low)} {np.radians(high)}"'
        text = re.sub(rf'(name="{joint}" axis="0 0 1") range="[^"]*"', rf"\1 {limits}", text)
    return text


# Elbow up, flange down: with its tool turned round such an arm can't pick from below.
ONE_POSTURE = {"shoulder_lift": (-130, -40), "elbow": (40, 150), "wrist_1": (-170, -60), "wrist_2": (-150, -30)}
STIFF = {"shoulder_pan": (-181, -170), "shoulder_lift": (-81, -79), "elbow": (104, 120)}
FLIPPED = ('"tool0" pos', '"tool0" euler="3.141592653589793 0 0" pos')
CAUSES = [
    ("tool frame: turned by rotation_rpy_degrees: [", ONE_POSTURE, FLIPPED, {"closed_form": None}),
    ("mount height", {}, ("", ""), {"mount": {"position": [-0.299, -0.158, 2.0]}}),
    ("joint limits", STIFF, ("", ""), {}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("cause", "limits", "change", "fields"), CAUSES, ids=[cause[:10] for cause, *_ in CAUSES])
def test_the_cause_of_serving_nothing_is_found(make, room, grasps, cause, limits, change, fields):
    robot = read_source(make(lambda text: limited(text, limits).replace(*change), **fields)).robot
    served = serve(robot, grasps[:8], aligned_poses(robot, room)[::3], room)
    assert served.share == 0.0
    causes = find_causes(robot, grasps[:8], room)
    assert causes, Reason(int(served.farthest[0])).name
    assert causes[0].what.startswith(cause)


def test_packaged_robots_are_listed(capsys):
    assert main(["list"]) == 0
    assert capsys.readouterr().out.split() == [
        "panda_mobile",
        "ridgeback_ur5e",
        "ur10e_mobile",
        "ur3e_mobile",
        "ur5e_mobile",
    ]


def test_a_refused_file_ends_with_code_2(make, capsys):
    assert main(["check", str(make(joints=["elbow"]))]) == 2
    assert "mine.yaml: joints: found ['elbow'], allowed is a list of 6 to 8 joint names" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["check", "ur6e"], "robot: found 'ur6e', allowed are panda_mobile"),
        (["check", "ur5e_mobile", "--package", "arms"], "--package: found 'arms', allowed are NAME=DIR"),
        (["check", "ur5e_mobile", "--grasps", "0"], "--grasps: found 0, allowed are 1 to 10000"),
    ],
)
def test_wrong_arguments_end_with_code_2(capsys, arguments, message):
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_a_check_of_a_packaged_robot(capsys, tmp_path):
    assert main(["check", "ur5e_mobile", "--grasps", "16", "--out", str(tmp_path)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "100.0 % of 16 random top-down grasps" in out
    assert "pick evaluations per second" in out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ur5e_mobile-frames.png", "ur5e_mobile-reach.png"]
