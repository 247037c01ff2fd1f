"""Drives in a room, as a robot is told: in the map's frame, leg by leg, straight from the staging pose to the stop."""

import dataclasses
import itertools
from pathlib import Path

import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
import yaml

import basenet_jax as bn
from basenet_jax.exports import ExportError, check_table_pose, make_schedule
from basenet_jax.exports.bag import write_bag
from basenet_jax.exports.yaml_text import to_yaml
from basenet_jax.task.plan import Plan
from tests import judged

ROOM = Path(__file__).parents[2] / "docs/examples/room.yaml"
STOPS = np.array([(5.9, 0.9502, 0.0), (2.7002, 3.5, -1.5708), (2.7002, 3.5, -1.5708)], np.float32)


@pytest.fixture(scope="module")
def room():
    return bn.load_scene(ROOM)


@pytest.fixture(scope="module")
def schedule(robot, room):
    """Of a plan whose picks are made up."""
    plan = Plan(jnp.arange(3), jnp.asarray(STOPS), jnp.ones(3, bool), jnp.zeros(3, int))
    short = judged.made_up_outcome()
    outcome = dataclasses.replace(
        short,
        is_step=np.ones(3, bool),
        feasible=np.ones(3, bool),
        reason=np.zeros(3, int),
        navigation_time=np.array([5.0, 16.0, 0.0]),
        pick_time=np.full(3, 9.0),
        joints=np.tile(np.asarray(short.joints)[:1], (3, 1, 1)),
    )
    return make_schedule(robot, room, plan, outcome)


def drives(schedule):
    return [command.drive for command in schedule.commands if command.drive]


def test_stops_are_the_plans_own_poses(schedule):
    assert schedule.map_frame == "map"
    np.testing.assert_allclose([drive.goal for drive in drives(schedule)], STOPS[:2], atol=1e-6)


def test_the_last_straight_piece_leads_from_the_staging_pose_to_the_stop(schedule):
    turned, docked = drives(schedule)
    assert turned.legs[-1].leg.gear is None
    assert turned.staging == turned.goal  # it turns there last
    away = np.array(docked.goal[:2]) - docked.staging[:2]
    assert np.hypot(*away) > 0.5
    assert docked.staging[2] == pytest.approx(docked.goal[2])
    ahead = away @ [np.cos(docked.goal[2]), np.sin(docked.goal[2])]
    assert abs(ahead) == pytest.approx(np.hypot(*away)), "straight along the heading"
    assert docked.legs[-1].leg.straight == pytest.approx(ahead)
    assert docked.legs[-1].leg.gear == ("forward" if ahead > 0 else "reverse")


def test_legs_follow_one_another(schedule, room):
    before = tuple(np.asarray(room.arrays.robot_start, float))
    for command in schedule.commands:
        if not command.drive:
            continue
        legs = command.drive.legs
        assert legs[0].time_ns == command.time_ns
        assert all(a.time_ns + a.duration_ns == b.time_ns for a, b in itertools.pairwise(legs))
        assert sum(leg.duration_ns for leg in legs) == pytest.approx(command.duration_ns, abs=len(legs))
        for stretch in legs:
            along = complex(*stretch.goal[:2]) - complex(*before[:2])
            if stretch.leg.gear:
                assert along == pytest.approx(stretch.leg.straight * np.exp(1j * before[2]), abs=1e-6)
            turn = np.exp(1j * (stretch.goal[2] - before[2]))
            assert turn == pytest.approx(np.exp(1j * stretch.leg.turn), abs=1e-6)
            before = stretch.goal
        assert before == pytest.approx(command.drive.goal, abs=1e-6)


def test_yaml_and_bag_say_the_same(schedule, tmp_path):
    rosbags = pytest.importorskip("rosbags.highlevel")
    document = yaml.load(to_yaml(schedule), yaml.CSafeLoader)
    told = [command for command in document["commands"] if "base_goal" in command]
    write_bag(tmp_path / "bag", schedule)
    with rosbags.AnyReader([tmp_path / "bag"]) as reader:
        read = [(each.topic, reader.deserialize(raw, each.msgtype)) for each, _, raw in reader.messages()]
    for topic, wanted in (("/staging_pose", "staging_pose"), ("/base_goal", "base_goal")):
        poses = [message for name, message in read if name == topic]
        for message, command in zip(poses, told, strict=True):
            assert message.header.frame_id == command[wanted]["header"]["frame_id"] == "map"
            place, turn = command[wanted]["pose"]["position"], command[wanted]["pose"]["orientation"]
            assert (message.pose.position.x, message.pose.position.y) == pytest.approx((place["x"], place["y"]))
            assert (message.pose.orientation.z, message.pose.orientation.w) == pytest.approx((turn["z"], turn["w"]))
    legs = [leg for command in told for leg in command["legs"]]
    assert [message.data for name, message in read if name == "/gear"] == [leg["gear"] for leg in legs]
    goals = [message.pose.position for name, message in read if name == "/leg_goal"]
    places = [(leg["to"]["x"], leg["to"]["y"]) for leg in legs]
    np.testing.assert_allclose([(place.x, place.y) for place in goals], places, atol=1e-8)


def test_a_rooms_map_is_the_frame_already(room):
    check_table_pose(room, (1.0, 2.0, 0.5))  # no map: it may stand anywhere in one
    furniture = msgspec.structs.replace(room.furniture, map="depot.yaml")
    on_map = dataclasses.replace(room, furniture=furniture)
    check_table_pose(on_map, (0.0, 0.0, 0.0))
    with pytest.raises(ExportError, match=r"found \[1.0, 2.0, 0.5\] for a room with a map, allowed is none"):
        check_table_pose(on_map, (1.0, 2.0, 0.5))
