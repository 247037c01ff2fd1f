from pathlib import Path

import jax
import numpy as np
import pytest
import yaml

from basenet_jax.robot.reading import load_robot, packaged_robots, read_robot
from tests.oracles import arm as oracle


def test_arm_has_the_numbers_of_the_manufacturer(robot):
    """DH lengths show up in the joint frames: d1, a2, a3, d4, d5, and d6 before the tool."""
    np.testing.assert_allclose(robot.joint_position[1], [0, 0, oracle.D[0]], atol=1e-15)
    np.testing.assert_allclose(robot.joint_position[2], [oracle.A[1], 0, 0], atol=1e-15)
    np.testing.assert_allclose(robot.joint_position[3], [oracle.A[2], 0, 0], atol=1e-15)
    np.testing.assert_allclose(robot.joint_position[4], [0, 0, oracle.D[3]], atol=1e-15)
    np.testing.assert_allclose(robot.joint_position[5], [0, 0, oracle.D[4]], atol=1e-15)
    np.testing.assert_allclose(robot.tool_position, [0, 0, oracle.D[5]], atol=1e-15)
    np.testing.assert_allclose(robot.joint_lower, oracle.LOWER)
    np.testing.assert_allclose(robot.joint_upper, oracle.UPPER)
    np.testing.assert_allclose(robot.joint_speed, [1, 1, 1, 2, 2, 2])
    np.testing.assert_allclose(robot.joint_acceleration, 1.4)
    np.testing.assert_allclose(robot.home, oracle.HOME)
    np.testing.assert_allclose(robot.stow, oracle.STOW)
    assert robot.closed_form == "ur"
    assert not any(robot.prismatic)


def test_base_has_the_numbers_of_the_release(robot):
    np.testing.assert_allclose(robot.mount_position, oracle.MOUNT, atol=1e-15)
    np.testing.assert_allclose(robot.mount_rotation, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(robot.footprint_half_size, [0.40, 0.25])
    np.testing.assert_allclose(robot.body_half_size, [0.40, 0.25, 0.375])
    np.testing.assert_allclose(robot.body_center, [0.0, 0.0, 0.375])
    np.testing.assert_allclose(robot.base_speed, [0.5, 0.5])
    np.testing.assert_allclose(robot.base_acceleration, [0.5, 1.0])


def test_capsules_are_those_of_the_world(robot):
    """At the stow pose, in W with the base at its origin, capsule by capsule as the DH frames give them."""
    np.testing.assert_allclose(robot.capsule_radius, oracle.RADII)
    x, y, z = robot.mount_position
    frames = [oracle.pose(x, y, z, 0.0)]
    for turn, offset, angle in zip(robot.joint_rotation, robot.joint_position, robot.stow, strict=True):
        fixed = np.eye(4)
        fixed[:3, :3], fixed[:3, 3] = turn, offset
        frames.append(frames[-1] @ fixed @ oracle.rotation_z(angle))
    capsules = zip(robot.capsule_link, robot.capsule_start, robot.capsule_end, strict=True)
    found = [[(frames[link] @ (*end, 1.0))[:3] for end in ends] for link, *ends in capsules]
    for ends, expected in zip(np.array(found), oracle.capsules(oracle.STOW, (0.0, 0.0, 0.0)), strict=True):
        assert min(np.abs(ends - expected).max(), np.abs(ends[::-1] - expected).max()) < 1e-14  # MuJoCo may swap them


def test_leaves_are_double_numpy_arrays(robot):
    """So that one robot serves both precisions."""
    assert all(isinstance(leaf, np.ndarray) and leaf.dtype == np.float64 for leaf in jax.tree.leaves(robot))


def test_unknown_robot():
    with pytest.raises(ValueError, match=r"found 'ur6e', allowed are .*ur5e_mobile"):
        load_robot("ur6e")


def test_the_packaged_robots_load():
    assert "ur5e_mobile" in packaged_robots()
    assert all(load_robot(name).name == name for name in packaged_robots())


@pytest.fixture
def files(robot, tmp_path):
    """A copy of the packaged robot's files to damage: the robot file's content and where both are."""
    model = Path(robot.model_path)
    (tmp_path / model.name).write_text(model.read_text())
    return yaml.safe_load(model.with_suffix(".yaml").read_text()), tmp_path / "robot.yaml"


def read(content, path):
    path.write_text(yaml.safe_dump(content))
    return read_robot(path)


def test_the_copy_is_sound(files, robot):
    assert read(*files).joint_names == robot.joint_names


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("format", "basenet-robot/2", r"\$.format"),
        ("name", 3, r"\$.name"),
        ("model", "nowhere.xml", "model: .*nowhere.xml"),
        ("frames", {"arm_base": "nothing", "tool": "tool0"}, "frames.arm_base: .*nothing"),
        ("frames", {"arm_base": "arm_base", "tool": "nothing"}, "frames.tool: .*nothing"),
        ("frames", {"arm_base": "arm_base"}, "tool"),
        ("joints", ["shoulder_pan", "knee"], "joints: .*knee"),
        ("joints", ["base_x", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"], "joints: base_x without"),
        ("closed_form", "panda", r"\$.closed_form"),
        ("joint_speed", [1.0, 1.0], "joint_speed: found 2 values, needs one for each of 6 joints"),
        ("joint_speed", [0.0] * 6, r"\$.joint_speed"),
        ("joint_acceleration", [1.4] * 7, "joint_acceleration: found 7"),
        ("home_degrees", [0.0] * 5, "home_degrees: found 5"),
        ("stow_degrees", "up", r"\$.stow_degrees"),
        ("deck", {"center": [0, 0], "size": [0.1, -0.1]}, r"\$.deck.size"),
        ("arm_geoms", "nothing ", "arm_geoms: .*'nothing '"),
        ("arm_geoms", "", "arm_geoms: geom 'body' is not a capsule"),
        ("wheels", 4, "wheels"),
    ],
)
def test_a_malformed_field_is_named(files, field, value, message):
    content, path = files
    with pytest.raises(ValueError, match=message) as caught:
        read({**content, field: value}, path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("body", "nothing", "base.body: .*nothing"),
        ("body", "shoulder", "base.body: geom 'shoulder' is not a box"),
        ("footprint", [0.8], r"\$.base.footprint"),
        ("speed", {"linear": -1.0, "angular": 1.0}, r"\$.base.speed.linear"),
    ],
)
def test_a_malformed_base_is_named(files, key, value, message):
    content, path = files
    with pytest.raises(ValueError, match=message):
        read({**content, "base": {**content["base"], key: value}}, path)


@pytest.mark.parametrize("field", ["format", "joints", "base", "arm_geoms"])
def test_a_missing_field_is_named(files, field):
    content, path = files
    content.pop(field)
    with pytest.raises(ValueError, match=field):
        read(content, path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere\.yaml"):
        read_robot(tmp_path / "nowhere.yaml")


def test_a_file_that_is_no_yaml(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("{")
    with pytest.raises(ValueError, match=r"robot\.yaml"):
        read_robot(path)


def test_lengths_come_from_the_mjcf(files, robot):
    """A calibrated arm: another number in the model is another number in the robot, and nowhere else."""
    content, path = files
    model = path.parent / content["model"]
    model.write_text(model.read_text().replace('pos="-0.3922 0 0"', 'pos="-0.3930 0.0002 0"'))
    calibrated = read(content, path)
    np.testing.assert_allclose(calibrated.joint_position[3], [-0.3930, 0.0002, 0.0], atol=1e-15)
    np.testing.assert_array_equal(calibrated.joint_position[2], robot.joint_position[2])
