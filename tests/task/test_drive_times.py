"""Drive times of one's own: tables, functions and files of them, and what is refused."""

import json
import math
from typing import Any

import numpy as np
import pytest

from basenet_jax.task.drive_times import (
    MAX_POSES,
    DriveTimes,
    DriveTimesError,
    load_drive_times,
    save_drive_times,
    tabulate_drives,
)
from basenet_jax.task.drives import GivenDrives
from basenet_jax.task.motion import plan_motion
from tests import judged

POSES = np.array([[0.0, -0.9, 0.0], [1.0, -0.9, 0.0], [1.6, 0.2, math.pi]])
SECONDS = np.array([[0.0, 3.0, 9.0], [4.0, 0.0, 7.0], [math.inf, 7.5, 0.0]])


@pytest.fixture(scope="module")
def table():
    return DriveTimes(POSES, SECONDS)


def content():
    return {
        "format": "basenet-drive-times/1",
        "poses": POSES.tolist(),
        "seconds": [[0, 3, 9], [4, 0, 7], [None, 7.5, 0]],
    }


def write(path, change=lambda content: None):
    own = content()
    change(own)
    path.write_text(json.dumps(own))
    return path


def test_a_file_is_read_and_written(tmp_path, table):
    read = load_drive_times(write(tmp_path / "drives.json"))
    assert read.source == "drives.json"
    save_drive_times(tmp_path / "again.json", read)
    for each in (read, load_drive_times(tmp_path / "again.json")):
        np.testing.assert_array_equal(each.poses, table.poses)
        np.testing.assert_array_equal(each.seconds, table.seconds)


def test_a_large_table_is_written_and_read(tmp_path):
    rng = np.random.default_rng(0)
    poses, seconds = rng.uniform(-9, 9, (MAX_POSES // 4, 3)), rng.uniform(0, 99, (MAX_POSES // 4, MAX_POSES // 4))
    save_drive_times(tmp_path / "drives.json", DriveTimes(poses, seconds))
    read = load_drive_times(tmp_path / "drives.json")
    np.testing.assert_array_equal(read.poses, poses)
    np.fill_diagonal(seconds, 0.0)
    np.testing.assert_array_equal(read.seconds, seconds)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("format"), r"format: found nothing, allowed is 'basenet-drive-times/1'"),
        (lambda c: c.pop("seconds"), r"seconds: found nothing, allowed is a list of rows, one for each pose"),
        (lambda c: c.update(stops=[]), r"stops: found an unknown key, allowed are format, poses, seconds"),
        (lambda c: c["poses"].pop(), r"seconds: found 3 rows, allowed are 2, one for each pose"),
        (lambda c: c["seconds"][1].pop(), r"seconds\[1\]: found 2 times, allowed are 3, one for each pose"),
        (lambda c: c["seconds"][1].__setitem__(2, -1), r"seconds\[1\]\[2\]: found -1, allowed is a number from 0 to"),
        (lambda c: c["seconds"][1].__setitem__(2, math.nan), r"seconds\[1\]\[2\]: found nan, allowed are finite"),
        (lambda c: c["seconds"][1].__setitem__(2, math.inf), r"seconds\[1\]\[2\]: found inf, allowed are finite"),
        (lambda c: c["seconds"][1].__setitem__(2, "7"), r"seconds\[1\]\[2\]: found '7', allowed is a number from 0"),
        (lambda c: c["seconds"][1].__setitem__(1, 2.0), r"seconds\[1\]\[1\]: found 2.0, allowed is 0: there the"),
        (lambda c: c["poses"][0].pop(), r"poses\[0\]: found \[0.0, -0.9\], allowed is \[x, y, heading\]"),
        (
            lambda c: c["poses"][0].__setitem__(1, 1e4),
            r"poses\[0\]\[1\]: found 10000.0, allowed is a number",
        ),
        (lambda c: c.update(poses=[], seconds=[]), r"poses: found \[\], allowed is a list of 1 to 1024 poses"),
    ],
)
def test_a_bad_file_is_refused_with_the_field(tmp_path, change, message):
    with pytest.raises(DriveTimesError, match=rf"drives.json: {message}"):
        load_drive_times(write(tmp_path / "drives.json", change))


def test_what_is_no_file_of_them_is_refused(tmp_path):
    with pytest.raises(DriveTimesError, match=r"none.json: can't be read: No such file"):
        load_drive_times(tmp_path / "none.json")
    (tmp_path / "text.json").write_text("[")
    with pytest.raises(DriveTimesError, match=r"text.json: line 1: no JSON"):
        load_drive_times(tmp_path / "text.json")


def test_a_function_is_called_once_with_all_poses():
    calls = []

    def seconds(start, goal):
        calls.append((start, goal))
        return np.hypot(*(goal[None, :, :2] - start[:, None, :2]).T).T

    table = tabulate_drives(seconds, POSES)
    ((start, goal),) = calls
    np.testing.assert_array_equal(start, POSES)
    np.testing.assert_array_equal(goal, POSES)
    assert table.seconds[0, 1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda start, goal: np.ones(3), r"seconds: found an array of shape \(3,\), allowed is \(3, 3\)"),
        (lambda start, goal: np.full((3, 3), math.nan), r"seconds\[0\]\[0\]: found nan, allowed are 0 to 1000000, or"),
        (lambda start, goal: -np.ones((3, 3)), r"seconds\[0\]\[0\]: found -1, allowed"),
        (lambda start, goal: np.full((3, 3), 1e9), r"seconds\[0\]\[0\]: found 1e\+09, allowed"),
        (lambda start, goal: [["a"]], r"drive_times: found no array of numbers, allowed is one"),
    ],
)
def test_a_function_that_says_no_times_is_refused(function, message):
    with pytest.raises(DriveTimesError, match=message):
        tabulate_drives(function, POSES)


@pytest.mark.parametrize("poses", [np.zeros((0, 3)), np.zeros((2, 2)), np.full((2, 3), np.nan), [["x"]]])
def test_poses_that_are_none_are_refused(poses):
    with pytest.raises(DriveTimesError, match=r"poses: found|no array of numbers"):
        DriveTimes(poses, np.zeros((2, 2)))


def test_drives_between_the_tables_poses_and_no_others(robot, table):
    drives = GivenDrives.of(table)
    asked: Any = np.array([POSES[1], POSES[0] + 1e-5, (*POSES[2, :2], -math.pi), (0.0, -0.9, 0.5)], np.float32)
    expected = np.full((4, 4), np.inf)
    which = [1, 0, 2]
    expected[:3, :3] = SECONDS[np.ix_(which, which)]
    np.testing.assert_array_equal(drives.matrix(robot, asked, asked), expected)
    np.testing.assert_array_equal(drives.each(robot, asked[:, None], asked), expected)
    np.testing.assert_array_equal(drives.times(robot, drives.ends(robot, asked), drives.ends(robot, asked)), expected)


def test_motions_take_the_given_times(robot):
    scene, plan, outcome = (judged.first(each) for each in (judged.scenes(), judged.plans(), judged.outcomes()))
    slow = outcome.replace(navigation_time=2.5 * outcome.navigation_time)
    motions = [
        plan_motion(robot, scene, plan, each, given_times=given)
        for each, given in ((outcome, False), (slow, True), (outcome.replace(navigation_time=np.zeros(2)), True))
    ]
    driving = [sum(part.law.duration_s for part in motion.parts if part.leg) for motion in motions]
    assert driving[1] == pytest.approx(2.5 * float(outcome.navigation), abs=1e-3)
    assert driving[2] == pytest.approx(0.0, abs=2e-3)
    np.testing.assert_allclose(motions[1].base_pose, motions[0].base_pose)
