"""The map of a robot is made once, kept, and made anew where what is kept is of no use."""

import numpy as np
import pytest

from basenet_jax.config import PickConfig
from basenet_jax.planners import grasp_map_file
from basenet_jax.planners.grasp_map import Shape
from basenet_jax.planners.grasp_map_build import build_grasp_map
from basenet_jax.planners.grasp_map_file import KeptGraspMap, load_grasp_map, save_grasp_map
from basenet_jax.weights_file import save_weights

CONFIG = PickConfig()
SHAPE = Shape(step_m=0.2, lowest=4, heights=3, side=11, headings=1, turns=1)


@pytest.fixture(scope="module")
def built(robot):
    return build_grasp_map(robot, CONFIG, SHAPE)


@pytest.fixture
def builds(monkeypatch):
    """Robots that maps were built for, in calls."""
    calls = []

    def count(robot, config, shape):
        calls.append(robot)
        return build_grasp_map(robot, config, shape)

    monkeypatch.setattr(grasp_map_file, "build_grasp_map", count)
    return calls


def check(found, built):
    np.testing.assert_array_equal(found.bits, built.bits)
    np.testing.assert_array_equal(found.axis, built.axis)
    assert (found.shape, found.ways) == (built.shape, built.ways)


def test_a_file_holds_the_map(tmp_path, robot, built):
    save_grasp_map(tmp_path / "map", built, robot, CONFIG)
    check(load_grasp_map(tmp_path / "map", robot, CONFIG, SHAPE), built)
    assert 0.1 < built.bins().mean() < 0.9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda robot: {"robot": robot.replace(joint_upper=robot.joint_upper * 0.99)}, "another robot"),
        (lambda _: {"config": PickConfig(position_tolerance_m=2e-3)}, "another robot or configuration"),
        (lambda _: {"shape": SHAPE._replace(lowest=5)}, "another robot or configuration"),
        (lambda _: {"shape": SHAPE._replace(heights=4)}, "needs uint8 of"),
    ],
)
def test_a_map_of_something_else_is_refused(tmp_path, robot, built, change, message):
    save_grasp_map(tmp_path / "map", built, robot, CONFIG)
    wanted = {"robot": robot, "config": CONFIG, "shape": SHAPE, **change(robot)}
    with pytest.raises(ValueError, match=rf"map: .*{message}"):
        load_grasp_map(tmp_path / "map", **wanted)


def test_another_format_is_refused(tmp_path, robot, built):
    save_weights(tmp_path / "map", {"bits": built.bits, "axis": built.axis}, {"format": "basenet-grasp-map/0"})
    with pytest.raises(ValueError, match="found 'basenet-grasp-map/0', needs 'basenet-grasp-map/1'"):
        load_grasp_map(tmp_path / "map", robot, CONFIG, SHAPE)


def test_what_was_built_is_kept(tmp_path, robot, built, builds):
    kept = KeptGraspMap(robot, CONFIG, tmp_path / "maps", SHAPE)
    assert not builds, "nothing is built before it is asked for"
    check(kept.map, built)
    check(kept.map, built)
    check(KeptGraspMap(robot, CONFIG, tmp_path / "maps", SHAPE).map, built)
    assert len(builds) == 1
    assert len(list((tmp_path / "maps").iterdir())) == 1
    check(KeptGraspMap(robot, CONFIG, None, SHAPE).map, built)
    assert len(builds) == 2


@pytest.mark.parametrize("spoil", [lambda data: b"", lambda data: data[: len(data) // 2]], ids=["empty", "cut short"])
def test_a_file_of_no_use_is_made_anew(tmp_path, robot, built, builds, spoil):
    check(KeptGraspMap(robot, CONFIG, tmp_path, SHAPE).map, built)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    path.write_bytes(spoil(whole))
    check(KeptGraspMap(robot, CONFIG, tmp_path, SHAPE).map, built)
    assert len(builds) == 2
    assert path.read_bytes() == whole


def test_a_map_of_another_robot_is_made_anew(tmp_path, robot, built, builds):
    """A shorter arm of the same name reaches less."""
    shorter = robot.replace(joint_position=robot.joint_position * 0.9)
    check(KeptGraspMap(robot, CONFIG, tmp_path, SHAPE).map, built)
    found = KeptGraspMap(shorter, CONFIG, tmp_path, SHAPE).map
    assert len(builds) == 2
    assert found.bins().sum() < built.bins().sum()


def test_a_folder_that_can_not_be_written_is_said_and_no_error(tmp_path, robot, built):
    (tmp_path / "file").write_text("no folder")
    with pytest.warns(RuntimeWarning, match=r"file.maps: reachability maps can't be kept here \(Not a directory\)"):
        check(KeptGraspMap(robot, CONFIG, tmp_path / "file" / "maps", SHAPE).map, built)
