"""Every file says the same: what is read back is the schedule."""

import csv
import dataclasses
import io

import numpy as np
import pytest
import yaml

from basenet_jax.exports.bag import write_bag
from basenet_jax.exports.csv_text import to_csv
from basenet_jax.exports.schedule import NANOSECONDS
from basenet_jax.exports.yaml_text import to_yaml
from basenet_jax.task.motion_check import Overlap
from tests.exports.conftest import TABLE_POSE


def seconds(time):
    """Of a ROS time or duration, as a mapping or a message."""
    sec, nanosec = (time["sec"], time["nanosec"]) if isinstance(time, dict) else (time.sec, time.nanosec)
    assert 0 <= nanosec < NANOSECONDS
    return sec + nanosec / NANOSECONDS


@pytest.fixture(scope="module")
def document(schedule):
    return yaml.load(to_yaml(schedule), yaml.CSafeLoader)


def test_yaml_says_what_it_is(document, schedule):
    assert document["format"] == "basenet-execution/1"
    assert document["robot"] == "ur5e_mobile"
    assert tuple(document["table_pose"].values()) == TABLE_POSE
    assert document["duration_s"] == pytest.approx(schedule.duration_s, abs=1e-8)
    assert document["overlaps"] == []


def test_yaml_says_what_would_be_touched(schedule):
    overlaps = (Overlap(0, True, 0, 0.08312), Overlap(1, False, None, 0.002))
    document = yaml.load(to_yaml(dataclasses.replace(schedule, overlaps=overlaps)), yaml.CSafeLoader)
    assert document["overlaps"] == [
        {"object": "mug_1", "base": "table", "by_m": 0.0831},
        {"object": "mug_2", "arm": "the robot's own body", "by_m": 0.002},
    ]


def test_yaml_holds_the_messages(document, schedule):
    assert len(document["commands"]) == len(schedule.commands)
    for each, command in zip(document["commands"], schedule.commands, strict=True):
        assert (each["doing"], each["object"]) == (command.doing, command.object)
        assert each["at_s"] == pytest.approx(command.time_ns / NANOSECONDS)
        assert each["lasts_s"] == pytest.approx(command.duration_ns / NANOSECONDS)
        if command.drive:
            for name, pose in (("staging_pose", command.drive.staging), ("base_goal", command.drive.goal)):
                assert each[name]["header"]["frame_id"] == "hall"
                assert seconds(each[name]["header"]["stamp"]) == pytest.approx(each["at_s"])
                place, turn = each[name]["pose"]["position"], each[name]["pose"]["orientation"]
                assert (place["x"], place["y"]) == pytest.approx(pose[:2])
                assert complex(turn["w"], turn["z"]) ** 2 == pytest.approx(np.exp(1j * pose[2]))  # half the angle
            for leg, stretch in zip(each["legs"], command.drive.legs, strict=True):
                assert tuple(leg["to"].values()) == pytest.approx(stretch.goal)
                assert leg["lasts_s"] == pytest.approx(stretch.leg.time_s, abs=1e-8)
                assert leg["gear"] == (stretch.leg.gear or "turn")
                assert leg.get("turn", 0.0) == pytest.approx(stretch.leg.turn)
                assert leg.get("straight", 0.0) == pytest.approx(stretch.leg.straight)
        elif command.trajectory:
            message = each["arm_trajectory"]
            assert message["joint_names"] == list(schedule.joint_names)
            for name in ("positions", "velocities", "accelerations"):
                values = [point[name] for point in message["points"]]
                np.testing.assert_allclose(values, getattr(command.trajectory, name), atol=1e-9)
            times = [seconds(point["time_from_start"]) for point in message["points"]]
            np.testing.assert_allclose(times, np.array(command.trajectory.time_ns) / NANOSECONDS)
        else:
            assert each["gripper"] == command.gripper


def test_csv_is_the_motion_over_time(schedule):
    rows = list(csv.DictReader(io.StringIO(to_csv(schedule, 50.0).decode())))
    time = np.array([float(row["time_s"]) for row in rows])
    assert time[0] == 0.0
    assert time[-1] == pytest.approx(schedule.duration_s, abs=1e-6)
    assert np.all(np.diff(time) >= 0)
    assert np.diff(time).max() < 0.023
    assert [name for name in rows[0] if name.endswith("_rad")][1:] == [f"{name}_rad" for name in schedule.joint_names]
    first, last = ([float(row[f"base_{name}"]) for name in ("x_m", "y_m", "yaw_rad")] for row in (rows[0], rows[-1]))
    assert last == pytest.approx(schedule.commands[0].drive.goal, abs=1e-5)
    start = complex(*TABLE_POSE[:2]) + complex(2.6, -0.5) * np.exp(1j * TABLE_POSE[2])
    assert complex(*first[:2]) == pytest.approx(start, abs=1e-5)
    pan = np.array([float(row["shoulder_pan_rad"]) for row in rows])
    assert np.abs(np.diff(pan)).max() <= 1.0 * 0.023
    assert {row["doing"] for row in rows} == {"turn", *(command.doing for command in schedule.commands)}
    assert {row["object"] for row in rows} == {"mug_1", "mug_2"}


def expected_of(drive):
    """Topics, times and contents of the messages of a drive that comes first."""
    told = [("/staging_pose", 0, drive.staging), ("/base_goal", 0, drive.goal)]
    for each in drive.legs:
        told += [("/gear", each.time_ns, each.leg.gear or "turn"), ("/leg_goal", each.time_ns, each.goal)]
    return told


def test_a_bag_is_read_back_by_rosbags(schedule, tmp_path):
    rosbags = pytest.importorskip("rosbags.highlevel")
    from rosbags.typesys import Stores, get_typestore

    write_bag(tmp_path / "bag", schedule)
    store = get_typestore(Stores.ROS2_JAZZY)  # written by the definitions of another distribution
    with rosbags.AnyReader([tmp_path / "bag"], default_typestore=store) as reader:
        read = [(c.topic, c.msgtype, time, reader.deserialize(raw, c.msgtype)) for c, time, raw in reader.messages()]
    expected = expected_of(schedule.commands[0].drive)
    told = len(expected)
    for (topic, kind, time, message), (name, at, content) in zip(read, expected, strict=False):
        assert (topic, time) == (name, at)
        if isinstance(content, str):
            assert (kind, message.data) == ("std_msgs/msg/String", content)
            continue
        assert (kind, message.header.frame_id) == ("geometry_msgs/msg/PoseStamped", "hall")
        assert seconds(message.header.stamp) == pytest.approx(time / NANOSECONDS, abs=1e-9)
        position, turn = message.pose.position, message.pose.orientation
        assert (position.x, position.y, position.z) == (*content[:2], 0.0)
        assert (turn.x, turn.y) == (0.0, 0.0)
        assert complex(turn.w, turn.z) ** 2 == pytest.approx(np.exp(1j * content[2]))
    assert [time for _, _, time, _ in read[told:]] == [command.time_ns for command in schedule.commands[1:]]
    for (topic, kind, time, message), command in zip(read[told:], schedule.commands[1:], strict=True):
        if command.trajectory:
            assert (topic, kind) == ("/arm_trajectory", "trajectory_msgs/msg/JointTrajectory")
            assert message.joint_names == list(schedule.joint_names)
            for name in ("positions", "velocities", "accelerations"):
                values = [getattr(point, name) for point in message.points]
                np.testing.assert_array_equal(values, getattr(command.trajectory, name))
            times = [seconds(point.time_from_start) for point in message.points]
            np.testing.assert_allclose(times, np.array(command.trajectory.time_ns) / NANOSECONDS)
        else:
            assert (topic, kind, message.data) == ("/gripper", "std_msgs/msg/String", command.gripper)
            continue
        assert seconds(message.header.stamp) == pytest.approx(time / NANOSECONDS, abs=1e-9)
