"""Maps are made once, kept, and made anew where what is kept is of no use."""

import numpy as np
import pytest

from basenet_jax.config import GridConfig, PickConfig
from basenet_jax.planners import reachability
from basenet_jax.planners.reachability import HEIGHT_STEP, MapStore, build_map, load_map, map_folder, save_map
from basenet_jax.weights_file import save_weights
from tests import compiled
from tests.regrasp import regrasp

GRID, CONFIG = compiled.GRID, PickConfig()
HEIGHTS = np.array([1.1, 1.2], np.float32)


@pytest.fixture(scope="module")
def built(robot):
    return build_map(robot, HEIGHTS.tolist(), GRID, CONFIG)


@pytest.fixture(scope="module")
def expected(robot, scene):
    return build_map(robot, scene.first_grasp[:, 2].tolist(), GRID, CONFIG).reachable


@pytest.fixture(scope="module")
def scene(random_scene):
    return random_scene(3, count=5)


@pytest.fixture
def builds(monkeypatch):
    """Heights (m) that were built, in calls."""
    calls = []

    def count(robot, heights, grid, config):
        calls.append(heights)
        return build_map(robot, heights, grid, config)

    monkeypatch.setattr(reachability, "build_map", count)
    return calls


def check(reach_map, scene, expected):
    np.testing.assert_array_equal(reach_map.reachable[scene.mask], expected[scene.mask])
    np.testing.assert_allclose(reach_map.height[scene.mask], scene.first_grasp[scene.mask, 2], atol=HEIGHT_STEP)
    assert not reach_map.reachable[~scene.mask].any()
    assert reach_map.reachable[scene.mask].any(axis=(1, 2, 3)).all()


def test_a_file_holds_the_map(tmp_path, robot, built):
    save_map(tmp_path / "map", built, robot, GRID, CONFIG)
    loaded = load_map(tmp_path / "map", HEIGHTS, robot, GRID, CONFIG)
    np.testing.assert_array_equal(loaded.reachable, built.reachable)
    np.testing.assert_array_equal(loaded.height, HEIGHTS)
    assert loaded.step_m == GRID.step_m


def test_a_robot_in_single_precision_is_the_same_robot(tmp_path, setup, robot, built):
    save_map(tmp_path / "map", built, robot, GRID, CONFIG)
    load_map(tmp_path / "map", HEIGHTS, setup.robot, GRID, CONFIG)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda robot: {"robot": robot.replace(joint_upper=robot.joint_upper * 0.99)}, "another robot"),
        (lambda robot: {"robot": robot.replace(closed_form=None)}, "another robot"),
        (lambda _: {"config": PickConfig(gripper_symmetric=False)}, "another robot or configuration"),
        (lambda _: {"grid": GridConfig(step_m=0.2000001, turns=4)}, "another robot or configuration"),
        (lambda _: {"grid": GridConfig(step_m=0.2, turns=3)}, "shape"),
        (lambda _: {"heights": HEIGHTS + 1e-3}, r"height: found \[1.1"),
        (lambda _: {"heights": HEIGHTS[:1]}, "shape"),
    ],
)
def test_a_map_of_something_else_is_refused(tmp_path, robot, built, change, message):
    save_map(tmp_path / "map", built, robot, GRID, CONFIG)
    wanted = {"heights": HEIGHTS, "robot": robot, "grid": GRID, "config": CONFIG, **change(robot)}
    with pytest.raises(ValueError, match=rf"map: .*{message}"):
        load_map(tmp_path / "map", **wanted)


def test_another_format_is_refused(tmp_path, robot, built):
    arrays = {"height": HEIGHTS, "reachable": built.reachable}
    save_weights(tmp_path / "map", arrays, {"format": "basenet-reachability/0"})
    with pytest.raises(ValueError, match="found 'basenet-reachability/0', needs 'basenet-reachability/1'"):
        load_map(tmp_path / "map", HEIGHTS, robot, GRID, CONFIG)


def test_what_was_built_is_kept_in_memory_and_on_disk(tmp_path, robot, scene, expected, builds):
    store = MapStore(robot, GRID, CONFIG, tmp_path / "maps")
    check(store.for_scene(scene), scene, expected)
    check(store.for_scene(scene), scene, expected)
    heights = len(set(scene.first_grasp[scene.mask, 2].tolist()))
    assert [len(call) for call in builds] == [heights]
    assert len(list((tmp_path / "maps").iterdir())) == heights
    check(MapStore(robot, GRID, CONFIG, tmp_path / "maps").for_scene(scene), scene, expected)
    assert len(builds) == 1


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch, robot, scene, expected):
    monkeypatch.chdir(tmp_path)
    check(MapStore(robot, GRID, CONFIG, None).for_scene(scene), scene, expected)
    assert not list(tmp_path.iterdir())


def damage(data):
    """The file's bytes, one of its last ones changed."""
    return data[:-20] + bytes([data[-20] ^ 1]) + data[-19:]


@pytest.mark.parametrize(
    "spoil",
    [lambda data: b"", lambda data: data[: len(data) // 2], damage, lambda data: b"\x00\xff" * 500],
    ids=["empty", "cut short", "damaged", "no map"],
)
def test_a_file_of_no_use_is_made_anew(tmp_path, robot, scene, expected, builds, spoil):
    MapStore(robot, GRID, CONFIG, tmp_path).for_scene(scene)
    before = {path: path.read_bytes() for path in sorted(tmp_path.iterdir())}
    spoilt = next(iter(before))
    spoilt.write_bytes(spoil(before[spoilt]))
    check(MapStore(robot, GRID, CONFIG, tmp_path).for_scene(scene), scene, expected)
    assert [len(call) for call in builds] == [len(before), 1]
    assert {path: path.read_bytes() for path in sorted(tmp_path.iterdir())} == before


def test_maps_of_another_robot_are_made_anew(tmp_path, robot, scene, builds):
    """A shorter arm of the same name reaches less."""
    shorter = robot.replace(joint_position=robot.joint_position * 0.96)
    MapStore(robot, GRID, CONFIG, tmp_path).for_scene(scene)
    found = MapStore(shorter, GRID, CONFIG, tmp_path).for_scene(scene)
    check(found, scene, build_map(shorter, scene.first_grasp[:, 2].tolist(), GRID, CONFIG).reachable)
    assert len(builds) == 2
    MapStore(shorter, GRID, CONFIG, tmp_path).for_scene(scene)
    assert len(builds) == 2, "the new maps were not kept"


def test_a_folder_that_can_not_be_written_is_said_and_no_error(tmp_path, robot, scene, expected):
    (tmp_path / "file").write_text("no folder")
    store = MapStore(robot, GRID, CONFIG, tmp_path / "file" / "maps")
    with pytest.warns(RuntimeWarning, match=r"file.maps: reachability maps can't be kept here \(Not a directory\)"):
        found = store.for_scene(scene)
    check(found, scene, expected)


def test_heights_are_rounded(robot, scene):
    """Grasps less than half a step from each other's rounded height share a layer."""
    z = 0.75 + 0.5 * scene.object_size[:, 2]
    height = 1.2 - z + np.array([0.0, 4e-5, -4e-5, 6e-5, 0.0, 0.0])
    same = regrasp(scene, lambda pose: np.copyto(pose[:, 0, 2], height, casting="same_kind"))
    reach_map = MapStore(robot, GRID, CONFIG, None).for_scene(same)
    np.testing.assert_allclose(reach_map.height[:5], [1.2, 1.2, 1.2, 1.2001, 1.2], atol=1e-6)


def test_the_folder_is_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert map_folder() == tmp_path / "basenet_jax" / "reachability"
    monkeypatch.setenv("BASENET_JAX_CACHE", "off")
    assert map_folder() is None
    monkeypatch.delenv("BASENET_JAX_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "ann"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "ann"))
    assert map_folder() == tmp_path / "ann" / ".cache" / "basenet_jax" / "reachability"
