"""Robot files that are wrong in one way each: refused with the file, the field, what was found, what is allowed."""

import json
import os
import re

import numpy as np
import pytest
import yaml

from basenet_jax.robot.reading import RobotFileError, load_robot, read_robot, read_source, robot_name, robot_stamp

JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]


def read(content, path, *, whole=True):
    """The robot of such a file; if it isn't looked at as a whole, its arm may rest in its body."""
    path.write_text(yaml.safe_dump(content, width=1000) if path.suffix != ".json" else json.dumps(content))
    return read_robot(path) if whole else read_source(path).robot


def refused(files, message):
    """The message of the error, which is one line, names the file and says what is allowed."""
    with pytest.raises(RobotFileError, match=re.escape(message)) as caught:
        read(*files)
    text = str(caught.value)
    assert str(files[1]) in text
    assert "\n" not in text
    return text


def put(content, path, value):
    """The content with one field changed, or taken out."""
    key, *rest = path
    changed = {**content} if isinstance(content, dict) else [*content]
    if rest:
        changed[key] = put(changed[key], rest, value)
    elif value is None:
        del changed[key]
    else:
        changed[key] = value
    return changed


def test_the_copy_is_the_packaged_robot(files, robot):
    mine = read(*files)
    np.testing.assert_array_equal(mine.joint_position, robot.joint_position)
    assert mine.joint_names == robot.joint_names
    assert read_robot(files[1]).capsule_link == robot.capsule_link


def test_json_will_do(files, robot):
    content, path = files
    assert read(content, path.with_suffix(".json")).joint_names == robot.joint_names


def test_a_robot_of_ones_own_is_loaded_by_its_path(files):
    content, path = files
    read(content, path)
    assert load_robot(str(path)).name == robot_name(str(path)) == "mine"


def test_a_robot_is_kept_until_a_file_of_it_changes(files):
    content, path = files
    model = path.parent / content["model"]
    part = path.parent / "part.xml"
    part.write_text("<mujoco/>")
    model.write_text(model.read_text().replace("<worldbody>", '<include file="part.xml"/><worldbody>', 1))
    read(content, path)

    def changed(change):
        before, stamp = load_robot(str(path)), robot_stamp(str(path))
        change()
        assert (robot_stamp(str(path)) != stamp) == (load_robot(str(path)) is not before)
        return load_robot(str(path)) is not before

    assert not changed(lambda: None)
    for each in (model, part):
        assert changed(lambda file=each: file.write_text(file.read_text() + " "))
    assert changed(lambda: read(content | {"deck": content["deck"] | {"center": [0.1, 0.0]}}, path))
    np.testing.assert_array_equal(load_robot(str(path)).deck[:2], [0.1, 0.0])
    path.unlink()
    with pytest.raises(RobotFileError, match="can't be read"):
        load_robot(str(path))


@pytest.mark.parametrize("reference", ["ur6e", "robot.xml", ""])
def test_unknown_robots(reference):
    allowed = (
        "allowed are panda_mobile, ridgeback_ur5e, ur10e_mobile, ur3e_mobile, ur5e_mobile, or the path of a robot file"
    )
    with pytest.raises(ValueError, match=f"found '{reference}', {allowed}"):
        load_robot(reference)


NAN = float("nan")
FIELDS = [
    (("format",), "basenet-robot/2", "format: found 'basenet-robot/2', allowed is 'basenet-robot/1'"),
    (("format",), None, "format: found nothing"),
    (("name",), 3, "name: found 3, allowed is a text"),
    (("name",), "../x", "name: found '../x', allowed are 1 to 64 letters, digits, _ and -"),
    (("name",), "ur5e_mobile", "name: found 'ur5e_mobile', a packaged robot's, allowed is a name of its own"),
    (("wheels",), 4, "wheels: found an unknown key, allowed are format, name, model"),
    (("model",), None, "model: found nothing, allowed is the path of an MJCF or URDF file"),
    (("model",), "nowhere.xml", "model: found 'nowhere.xml', which isn't there, allowed are paths of files in the"),
    (("model",), "../ur5e.xml", "model: found '../ur5e.xml', which isn't there, allowed are paths of files in the"),
    (("model",), "/etc/passwd", "model: found '/etc/passwd', which lies elsewhere, allowed are paths of files in "),
    (("frames", "tool"), "nothing", "frames.tool: found 'nothing', allowed are the model's sites and bodies: 'tool0',"),
    (("frames", "tool"), None, "frames.tool: found nothing, and no tool.frame, allowed is the name of a"),
    (("frames", "arm_base"), "link6", "joints[0]: found 'shoulder_pan', allowed are all joints from arm base to tool"),
    (("frames",), {"arm_base": "link3", "tool": "link2"}, "frames.tool: found 'link2', which it doesn't, allowed is"),
    (("joints",), [*JOINTS[:5], "knee"], "joints[5]: found 'knee', allowed are all joints from arm base to tool, in o"),
    (("joints",), [*JOINTS[1:], JOINTS[0]], "joints[0]: found 'shoulder_lift', allowed are all joints from arm base"),
    (("joints",), [*JOINTS[:5], JOINTS[0]], "joints[5]: found 'shoulder_pan' twice, allowed is each joint once"),
    (("joints",), JOINTS[:5], "joints: found a list of 5, allowed is a list of 6 to 8 joint names"),
    (("joints",), "elbow", "joints: found 'elbow', allowed is a list of 6 to 8 joint names"),
    (("closed_form",), "panda", "closed_form: found 'panda', allowed is ur or none, or no such key"),
    (("drive",), "tracks", "drive: found 'tracks', allowed is differential or omnidirectional, or no such key"),
    (("joint_speed",), [1.0] * 7, "joint_speed: found 7 values, allowed is one for each of the 6 joints"),
    (("joint_speed", 2), 0.0, "joint_speed[2]: found 0.0, allowed is a number from 0.01 to 20 (rad/s"),
    (("joint_speed", 0), 180.0, "joint_speed[0]: found 180.0, allowed is a number from 0.01 to 20 (rad/s"),
    (("joint_speed", 1), NAN, "joint_speed[1]: found nan, allowed are finite numbers"),
    (("joint_acceleration", 5), -1.4, "joint_acceleration[5]: found -1.4, allowed is a number from 0.01 to 200"),
    (("home_degrees", 2), 190.0, "home_degrees[2]: found 190, allowed is -180 to 180 degrees, the joint's limits"),
    (("stow_degrees",), "up", "stow_degrees: found 'up', allowed is a list of 6 to 8 numbers"),
    (("mount", "position", 2), 920.0, "mount.position[2]: found 920.0, allowed is a number from -3 to 3 (m)"),
    (("mount",), None, "mount: found nothing, allowed is a mapping of position and, if turned, rpy_degrees"),
    (("base", "footprint"), [800, 500], "base.footprint[0]: found 800, allowed is a number from 0.05 to 3 (m)"),
    (("base", "body", "size"), [0.8, 0.5], "base.body.size: found [0.8, 0.5], allowed is [x, y, z], three numbers (m)"),
    (("base", "speed", "linear"), 0.0, "base.speed.linear: found 0.0, allowed is a number from 0.01 to 10 (m/s)"),
    (("deck", "size"), [0.1, -0.1], "deck.size[1]: found -0.1, allowed is a number from 0.05 to 3 (m)"),
    (("capsules",), [{"frame": "link9", "start": [0, 0, 0], "end": [0, 0, 1], "radius": 0.1}], "capsules[0].frame: fo"),
    (("capsules",), [{"frame": "link2", "start": [0, 0, 0], "end": [0, 0, 1]}], "capsules[0].radius: found nothing, a"),
]


@pytest.mark.parametrize(("path", "value", "message"), FIELDS, ids=lambda part: str(part)[:30])
def test_a_wrong_field_is_named(files, path, value, message):
    content, file = files
    refused((put(content, path, value), file), message)


def test_a_missing_file(tmp_path):
    with pytest.raises(RobotFileError, match=r"nowhere\.yaml: can't be read: No such file"):
        read_robot(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize("text", ["{", "", "- 1", "a: &x 1", "!!python/object/apply:os.system ['true']", "\x00"])
def test_a_file_that_holds_no_robot(tmp_path, text):
    (tmp_path / "robot.yaml").write_text(text)
    with pytest.raises(RobotFileError, match=r"robot\.yaml: "):
        read_robot(tmp_path / "robot.yaml")


def edit(files, old, new):
    """Changes the model."""
    content, path = files
    model = path.parent / content["model"]
    text = model.read_text()
    assert old in text
    model.write_text(text.replace(old, new))


def test_lengths_come_from_the_model(files, robot):
    """A calibrated arm: another number in the model is another number in the robot, and nowhere else."""
    edit(files, 'pos="-0.3922 0 0"', 'pos="-0.3930 0.0002 0"')
    calibrated = read(*files)
    assert calibrated.closed_form == "ur"
    np.testing.assert_allclose(calibrated.joint_position[3], [-0.3930, 0.0002, 0.0], atol=1e-15)
    np.testing.assert_array_equal(calibrated.joint_position[2], robot.joint_position[2])


MODELS = [
    ('pos="-0.425 0 0"', 'pos="-425 0 0"', "long from joint 1 to the tool, allowed is 0.2 to 4.0 m (are its lengths i"),
    ('pos="-0.425 0 0"', 'pos="nan 0 0"', "model: "),
    ('pos="-0.425 0 0"', 'pos="up 0 0"', "model: MuJoCo can't read it: "),
    ('range="-3.141592653589793 3.141592653589793"', 'range="1 1"', "joints[2]: found the range 1 to 1 in the model, "),
    (
        'pos="-0.425 0 0"',
        'pos="-0.425 0 0" euler="0.1 0 0"',
        "closed_form: found 'ur' for another kind of arm, allowed",
    ),
    ('<joint name="elbow" axis="0 0 1" range="-3.141592653589793', '<joint name="elbow" type="ball" range="0', "joint"),
    ('size="0.06"', 'size="60"', "model: found a shape of link 2 with a radius of 60 m, allowed are up to 0.5 m (are "),
    ("</mujoco>", "", "ur5e.xml: no XML: "),
    ('<mujoco model="ur5e">', '<!DOCTYPE x [<!ENTITY a "1">]><mujoco model="ur5e">', "ur5e.xml: found "),
    ("mujoco", "sdf", "ur5e.xml: found XML of <sdf>, allowed are MJCF (<mujoco>) and URDF (<robot>)"),
    ('class="arm">', 'class="looks"><geom contype="0" conaffinity="0"/></default><default class="arm">', "model: "),
    ('<geom type="capsule"', '<geom contype="0" conaffinity="0" type="capsule"', "capsules: found none, and no moving"),
    ("<worldbody>", '<include file="ur5e.xml"/><worldbody>', "include: found an include of itself ('ur5e.xml'), allow"),
    ("<worldbody>", '<include file="../x.xml"/><worldbody>', "include: found '../x.xml', allowed are files in the rob"),
    ("<worldbody>", '<include file="/etc/hostname"/><worldbody>', "include: found '/etc/hostname', allowed are files "),
]


@pytest.mark.parametrize(("old", "new", "message"), MODELS, ids=range(len(MODELS)))
def test_a_wrong_model_is_explained(files, old, new, message):
    edit(files, old, new)
    refused(files, message)


def test_entities_never_expand(files):
    """A billion laughs: ten entities, each ten of the one before."""
    lines = ['<!ENTITY e0 "ha">', *(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))]
    edit(files, '<mujoco model="ur5e">', f'<!DOCTYPE x [{"".join(lines)}]><mujoco model="&e9;">')
    refused(files, "allowed is XML without")


def test_too_deep_a_model(files):
    edit(files, "</worldbody>", "<body>" * 500 + "</body>" * 500 + "</worldbody>")
    refused(files, "ur5e.xml: found more than 128 levels of elements")


def test_a_link_out_of_the_folder_is_refused(files, tmp_path_factory):
    content, path = files
    outside = tmp_path_factory.mktemp("outside") / "ur5e.xml"
    (path.parent / "ur5e.xml").rename(outside)
    os.symlink(outside, path.parent / "ur5e.xml")
    refused((content, path), f"model: found 'ur5e.xml', a link to {outside}, allowed are paths of files in the robot")
    os.remove(path.parent / "ur5e.xml")
    os.symlink("ur5e.xml", path.parent / "ur5e.xml")  # a link to itself
    refused((content, path), "model: found 'ur5e.xml', which isn't there, allowed are paths of files in the robot")


def test_own_capsules_replace_the_models(files):
    content, path = files
    own = [
        {"frame": "link3", "start": [0.0, 0.0, 0.0], "end": [-0.4, 0.0, 0.0], "radius": 0.07},
        {"frame": "tool0", "start": [0.0, 0.0, 0.0], "end": [0.0, 0.0, 0.2], "radius": 0.04},
        {"frame": "arm_base", "start": [0.0, 0.0, 0.0], "end": [0.0, 0.0, 0.1], "radius": 0.09},
    ]
    robot = read({**content, "capsules": own}, path)
    assert robot.capsule_link == (3, 6)  # the arm's base is drawn, but tested against nothing
    np.testing.assert_allclose(robot.capsule_end, [[-0.4, 0.0, 0.0], [0.0, 0.0, 0.2996]], atol=1e-12)
    np.testing.assert_allclose(robot.capsule_radius, [0.07, 0.04])


def test_a_turned_mount(files):
    content, path = files
    robot = read(put(content, ("mount", "rpy_degrees"), [180.0, 0.0, 90.0]), path, whole=False)
    np.testing.assert_allclose(robot.mount_rotation, [[0, 1, 0], [1, 0, 0], [0, 0, -1]], atol=1e-15)
