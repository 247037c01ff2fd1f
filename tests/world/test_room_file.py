"""Rooms' files: what is read, what is refused and in which words, and that writing loses nothing."""

import dataclasses
import json
import math
import os

import jax
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from basenet_jax.world.generate_rooms import draw_room
from basenet_jax.world.room_file import as_room
from basenet_jax.world.scene_file import SceneFileError, load_scene, save_scene
from tests import scene_texts
from tests.regrasp import regrasp
from tests.room_texts import TEXT, content, rules


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With a map of 4 x 3 m, open but for its rightmost half metre."""
    folder = tmp_path_factory.mktemp("rooms")
    image = np.full((30, 40), 254, np.uint8)
    image[:, 35:] = 0
    Image.fromarray(image).save(folder / "hall.pgm")
    lines = ["image: hall.pgm", "resolution: 0.1", "origin: [3, 0, 0]", "negate: 0"]
    (folder / "hall.yaml").write_text("\n".join([*lines, "occupied_thresh: 0.65", "free_thresh: 0.25"]))
    return folder


def load_text(folder, text, name="room.yaml"):
    (folder / name).write_text(text)
    return load_scene(folder / name)


def message(folder, text, name="room.yaml"):
    with pytest.raises(SceneFileError) as info:
        load_text(folder, text, name)
    assert str(info.value).startswith(f"{folder / name}: ")
    return str(info.value).removeprefix(f"{folder / name}: ")


def assert_equal(one, other):
    for name in ("names", "robot", "box_names", "furniture"):
        assert getattr(one, name) == getattr(other, name)
    for a, b in zip(jax.tree.leaves(one.arrays), jax.tree.leaves(other.arrays), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_room_is_read_as_it_stands(folder):
    scene = load_text(folder, TEXT)
    arrays = scene.arrays
    boxes, filled_up = (
        jax.tree.map(lambda x, rows=rows: x[rows], arrays.room.boxes) for rows in (slice(6), slice(6, None))
    )
    assert len(filled_up.low) == 10
    assert not np.any(filled_up.blocks_base | filled_up.blocks_arm | filled_up.bears_objects)
    assert scene.names == ("mug_1", "bowl_1", "part_7")
    assert scene.box_names == ("bench", "shelf_2", "pillar", "lamp", "north", "charging")
    np.testing.assert_array_equal(arrays.room.floor, np.array([0.0, 0.0, 8.5, 6.2], np.float32))
    np.testing.assert_array_equal(boxes.pose[0], np.array([2.0, 3.1, 1.5708], np.float32))
    np.testing.assert_allclose(
        boxes.half_size, [(0.9, 0.35), (0.6, 0.2), (0.2, 0.2), (0.1, 0.1), (4.25, 0.05), (0.4, 0.4)]
    )
    np.testing.assert_allclose(boxes.low, [0.0, 1.02, 0.0, 1.9, 0.0, 0.0])
    np.testing.assert_allclose(boxes.high, [0.82, 1.05, 2.5, 2.2, 2.5, 0.01])
    assert boxes.blocks_base.tolist() == [True] * 6
    assert boxes.blocks_arm.tolist() == [True] * 5 + [False]
    assert boxes.bears_objects.tolist() == [True] * 2 + [False] * 4
    np.testing.assert_allclose(arrays.surface_height, [0.82, 0.82, 1.05])
    assert arrays.object_class.tolist() == [3, 4, -1]
    np.testing.assert_allclose(arrays.object_grasps.pose[2, 0], [0, 0, 0.3, math.pi, 0, math.radians(30)], atol=1e-6)
    assert rules(scene) == ("docked", True)


def test_what_may_be_left_out_has_its_defaults(folder):
    room = content()
    for key in ("floor", "obstacles", "walls", "keep_out", "drives", "clutter"):
        del room[key]
    scene = load_text(folder, json.dumps(room), "room.json")
    assert scene.box_names == ("bench", "shelf_2")
    assert scene.arrays.room.floor.tolist() == [-math.inf, -math.inf, math.inf, math.inf]
    assert rules(scene) == ("docked", True)


def test_walls_are_a_box_for_each_piece(folder):
    room = content()
    room["walls"] = [{"name": "corner", "points": [[7, 3], [7, 5], [8, 5]], "thickness": 0.2, "height": 2}]
    scene = load_text(folder, json.dumps(room), "room.json")
    assert scene.box_names[4:6] == ("corner[0]", "corner[1]")
    boxes = scene.arrays.room.boxes
    np.testing.assert_allclose(boxes.pose[4:6], [(7, 4, math.pi / 2), (7.5, 5, 0)], atol=1e-6)
    np.testing.assert_allclose(boxes.half_size[4:6], [(1, 0.1), (0.5, 0.1)])


def test_a_map_blocks_the_base_alone(folder):
    room = content() | {"map": "hall.yaml"}
    room["robot"]["start"] = [5.0, 1.5, 0.0]
    scene = load_text(folder, json.dumps(room), "room.json")
    boxes, of_map = scene.arrays.room.boxes, np.zeros(16, bool)
    of_map[: len(scene.box_names)] = np.array(scene.box_names) == "map"
    assert of_map.sum() == 4, "a frame, whose right side is the map's own"
    assert np.all(boxes.blocks_base[of_map])
    assert not np.any(boxes.blocks_arm[of_map])
    room["robot"]["start"] = [6.1, 1.5, 0.0]
    found = message(folder, json.dumps(room), "room.json")
    assert found.startswith(
        "robot.start: found [6.1, 1.5, 0.0], where the base of ur5e_mobile touches 'map' or its margin"
    )
    room["map"] = "hall.pgm"
    assert message(folder, json.dumps(room), "room.json").startswith("map: hall.pgm: ")


# What is replaced by what, and what is then said.
BAD = [
    ("basenet-scene/2", "basenet-scene/3", "format: found 'basenet-scene/3', allowed is 'basenet-scene/1' or 'basen"),
    ("floor:", "flor:", "flor: found an unknown key, allowed are format, floor, map, surfaces, obstacles, walls, ke"),
    ("8.5, 6.2]\n", "-1, 6.2]\n", "floor: found [0.0, 0.0, -1.0, 6.2], allowed is [x_min, y_min, x_max, y_max]"),
    ("name: pillar", "name: bench", "obstacles[0].name: found 'bench', the name of surfaces[0] too, allowed is a na"),
    ("name: mug_1", "name: north", "objects[0].name: found 'north', the name of walls[0] too, allowed is a name of"),
    ("[1.8, 0.7]", "[1.8, 0.0]", "surfaces[0].size[1]: found 0.0, allowed is a number from 0.1 to 20 (m)"),
    ("height: 0.82", "height: 9", "surfaces[0].height: found 9, allowed is a number from 0.01 to 3 (m)"),
    ("thickness: 0.03", "thickness: 1.2", "surfaces[1].thickness: found 1.2, so that its underside is below the flo"),
    ("[4.0, 3.0, 0.0]", "[4.0, 3.0]", "obstacles[0].pose: found [4.0, 3.0], allowed is [x, y, yaw], three numbers"),
    ("z: 1.9", "z: -1", "obstacles[1].z: found -1, allowed is a number from 0 to 10 (m), or no such key"),
    ("[[0, 6.2], [8.5, 6.2]]", "[[0, 6.2]]", "walls[0].points: found [[0, 6.2]], allowed is a list of 2 to 257 poin"),
    ("[[0, 6.2], [8.5, 6.2]]", "[[0, 6], [0, 6]]", "walls[0].points[1]: found [0.0, 6.0], where the point before is"),
    ("[[0, 6.2], [8.5, 6.2]]", "[[0, 6], [0]]", "walls[0].points[1]: found [0], allowed is [x, y], two numbers (m)"),
    ("[[0, 6.2], [8.5, 6.2]]", "[[2, 0], [2, 6]]", "surfaces[0].pose: found [2.0, 3.1, 1.5708], where it overlaps a"),
    ("[0.8, 0.8]", "[0.8, .inf]", "keep_out[0].size[1]: found inf, allowed are finite numbers"),
    (
        "drives: docked",
        "drives: point",
        "drives: found 'point' in a room, allowed is docked; point only goes round one",
    ),
    ("drives: docked", "drives: fast", "drives: found 'fast', allowed is docked or point, or no such key"),
    ("clutter: true", "clutter: 1", "clutter: found 1, allowed is true or false, or no such key"),
    ("start: [4.2, 1.0,", "start: [4.2, 0.1,", "robot.start: found [4.2, 0.1, 0.0], where the base of ur5e_mobile l"),
    ("start: [4.2, 1.0,", "start: [4.0, 3.0,", "robot.start: found [4.0, 3.0, 0.0], where the base of ur5e_mobile t"),
    ("start: [4.2, 1.0,", "start: [1.9, 1.0,", "robot.start: found [1.9, 1.0, 0.0], where the base of ur5e_mobile t"),
    ("start: [4.2, 1.0,", "start: [4.2, 5.85,", "robot.start: found [4.2, 5.85, 0.0], where the base of ur5e_mobile"),
    ("on: bench", "on: table", "objects[0].on: found 'table', allowed are names of surfaces: 'bench', 'shelf_2'"),
    ("on: bench", "on: shelf_2", "objects[0].pose: found [2.1, 3.3, 0.4], off 'shelf_2', allowed are poses whose x,"),
    ("[1.9, 3.7, 0.0]", "[1.9, 4.1, 0.0]", "objects[1].pose: found [1.9, 4.1, 0.0], off every surface, allowed are"),
    ("[1.9, 3.7, 0.0]", "[2.1, 3.4, 0.0]", "objects[1].pose: found [2.1, 3.4, 0.0], where its rectangle overlaps that"),
    (
        "z: 1.9}",
        "z: 0.9}\n  - {name: crate, pose: [2.1, 3.3, 0.0], size: [0.3, 0.3, 0.5], z: 0.82}",
        "objects[0].pose: found [2.1, 3.3, 0.4], inside 'crate', allowed are poses outside of other boxes",
    ),
    ("class: mug", "class: mag", "objects[0].class: found 'mag', allowed are cracker_box, bleach_cleanser, mustard_"),
    ("class: mug,", "", "objects[0].class: found neither class nor size and grasps, allowed are a class, or size an"),
    ("class: mug,", "class: mug, size: [1, 1, 1],", "objects[0].size: found it beside class, allowed are size and g"),
    ("    size: [0.05, 0.05, 0.12]\n", "", "objects[2].size: found nothing, allowed are size and grasps, both and w"),
    ("180, 0, 30]", "180, 0, 30], approach: 0", "objects[2].grasps[0].approach: found 0, allowed is a number from 0"),
    ("180, 0, 30]", "180, 0, 30], symmetric: 1", "objects[2].grasps[0].symmetric: found 1, allowed is true or false"),
    ("180, 0, 30]", "180, 0, .inf]", "objects[2].grasps[0].rpy_degrees[2]: found inf, allowed are finite numbers"),
    ("position: [0, 0, 0.3], ", "", "objects[2].grasps[0].position: found nothing, allowed is [x, y, z], three numb"),
    ("grasps:", "grasp:", "objects[2].grasp: found an unknown key, allowed are name, class, on, pose, size, grasps"),
    ("ur5e_mobile", "fetch", "robot.model: found 'fetch', allowed are panda_mobile, "),
    ("pose: [2.0, 3.1, 1.5708]", "pose: [2.0, 3.1, 90.0]", "surfaces[0].pose[2]: found 90.0, allowed is a number from"),
    (
        "[4.0, 3.0, 0.0]",
        "[4.0, 3.0, 45]",
        "obstacles[0].pose[2]: found 45, allowed is a number from -100 to 100 (m), an",
    ),
    ("[1.9, 3.7, 0.0]", "[1.9, 3.7, -90]", "objects[1].pose[2]: found -90, allowed is a number from -100 to 100 (m),"),
    ("start: [4.2, 1.0, 0.0]", "start: [4.2, 1.0, 90]", "robot.start[2]: found 90, allowed is a number from -100 to"),
    ("floor:", "map: none.yaml\nfloor:", "map: found 'none.yaml', allowed are files in the scene file's folder or b"),
    ("floor:", "map: 7\nfloor:", "map: found 7, allowed is the name of a map_server file, or no such key"),
]


@pytest.mark.parametrize(("old", "new", "said"), BAD, ids=lambda text: text[:40])
def test_what_is_wrong_is_said(folder, old, new, said):
    assert old in TEXT
    assert message(folder, TEXT.replace(old, new, 1)).startswith(said)


@pytest.mark.parametrize(("grasps", "found"), [([], "[]"), (201, "a list of 201")])
def test_an_object_has_1_to_200_grasps(folder, grasps, found):
    room = content()
    item = room["objects"][2]
    item["grasps"] = item["grasps"] * grasps if isinstance(grasps, int) else grasps
    said = message(folder, json.dumps(room), "room.json")
    assert said.startswith(f"objects[2].grasps: found {found}, allowed is a list of 1 to 200 grasps, or the name of a")


SHELF = {"name": "low", "pose": [6.0, 0.4, 0.0], "size": [1.2, 0.4], "height": 0.6, "thickness": 0.03}


def test_an_object_over_several_surfaces_says_on_which(folder):
    room = content()
    room["surfaces"].append(SHELF)
    assert load_text(folder, json.dumps(room), "room.json").arrays.surface_height.tolist()[2] == np.float32(1.05)
    del room["objects"][2]["on"]
    found = message(folder, json.dumps(room), "room.json")
    assert found.startswith("objects[2].on: found nothing, where several are under the object: 'shelf_2', 'low', allow")


def test_objects_stand_on_boards_above_one_another_but_not_through_them(folder):
    room = content()
    room["surfaces"].append(SHELF)
    part = room["objects"][2]
    room["objects"].append(part | {"name": "part_8", "on": "low"})
    assert len(load_text(folder, json.dumps(room), "room.json").names) == 4
    room["objects"][3]["size"] = [0.05, 0.05, 0.5]
    found = message(folder, json.dumps(room), "room.json")
    assert found.startswith(
        "objects[3].pose: found [6.1, 0.45, 1.1], where its rectangle overlaps that of objects[2] ("
    )
    del room["objects"][2]
    found = message(folder, json.dumps(room), "room.json")
    assert found.startswith("objects[2].pose: found [6.1, 0.45, 1.1], inside 'shelf_2', allowed are poses outside")


def test_surfaces_may_touch_and_not_overlap(folder):
    room = content()
    second = {"name": "side", "pose": [2.85, 2.55, 0.0], "size": [1.0, 0.7], "height": 0.9}
    room["surfaces"].append(second)
    assert len(load_text(folder, json.dumps(room), "room.json").box_names) == 7
    second["pose"][0] = 2.84
    found = message(folder, json.dumps(room), "room.json")
    assert found.startswith(
        "surfaces[0].pose: found [2.0, 3.1, 1.5708], where it overlaps surfaces[2] ('side'), allowed are"
    )
    second |= {"height": 1.3, "thickness": 0.4}
    load_text(folder, json.dumps(room), "room.json")


def test_too_many_boxes_are_refused_in_all(folder):
    room = content()
    room["keep_out"] = [
        {"name": f"spot_{i}", "pose": [8, 5, 0], "size": [0.1, 0.1]} for i in range(251)
    ]  # besides two surfaces, two obstacles and a wall
    assert len(load_text(folder, json.dumps(room), "room.json").box_names) == 256
    room["keep_out"].append(room["keep_out"][0] | {"name": "another"})
    found = message(folder, json.dumps(room), "room.json")
    assert (
        found
        == "content: found 257 boxes in surfaces, obstacles, walls' pieces and keep_out, allowed are up to 256 in all"
    )


def test_a_body_passes_under_a_board_that_is_high_enough(folder):
    """The packaged one is 0.75 m high."""
    room = content() | {"robot": {"start": [6.0, 0.9, 0.0]}, "obstacles": []}
    room["surfaces"][1] |= {"size": [1.2, 1.5], "pose": [6.0, 0.9, 0.0]}
    load_text(folder, json.dumps(room), "room.json")
    room["surfaces"][1]["height"] = 0.77
    found = message(folder, json.dumps(room), "room.json")
    assert found.startswith("robot.start: found [6.0, 0.9, 0.0], where the base of ur5e_mobile touches 'shelf_2'")


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31), count=st.integers(1, 6), suffix=st.sampled_from([".yaml", ".json"]))
def test_a_saved_room_comes_back_the_same(folder, seed, count, suffix):
    scene = draw_room(seed, count)
    save_scene(folder / f"saved{suffix}", scene)
    assert_equal(load_scene(folder / f"saved{suffix}"), scene)


@settings(max_examples=100)
@given(
    st.lists(st.floats(-2, 2, width=32), min_size=3, max_size=3),
    st.lists(st.floats(-100, 100, width=32), min_size=3, max_size=3),
)
def test_any_grasp_is_written_to_the_last_bit(folder, position, angles):
    scene = load_text(folder, TEXT)
    arrays = regrasp(jax.device_get(scene.arrays), lambda pose: np.copyto(pose[2, 0], [*position, *angles]))
    save_scene(folder / "saved.yaml", dataclasses.replace(scene, arrays=arrays))
    saved = load_scene(folder / "saved.yaml").arrays.object_grasps
    jax.tree.map(np.testing.assert_array_equal, saved, arrays.object_grasps)


def test_the_example_with_a_map_comes_back_the_same_but_for_a_folder_without_it(folder):
    room = content() | {"map": "hall.yaml", "robot": {"start": [5.0, 1.5, 0.0]}}
    scene = load_text(folder, json.dumps(room), "room.json")
    save_scene(folder / "saved.yaml", scene)
    assert_equal(load_scene(folder / "saved.yaml"), scene)
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    with pytest.raises(SceneFileError, match=r"saved\.yaml: map: found 'hall\.yaml', allowed are files in the scene"):
        save_scene(elsewhere / "saved.yaml", scene)
    assert not os.listdir(elsewhere)


def test_a_room_that_is_changed_beside_its_furniture_is_not_written(folder):
    scene = load_text(folder, TEXT)
    arrays = jax.device_get(scene.arrays)
    lower = dataclasses.replace(arrays, surface_height=arrays.surface_height - 0.1)
    with pytest.raises(SceneFileError, match=r"objects\[0\]\.pose: found .* at a height of 0\.7"):
        save_scene(folder / "wrong.yaml", dataclasses.replace(scene, arrays=lower))
    boxes = dataclasses.replace(arrays.room.boxes, high=arrays.room.boxes.high + 1)
    room = dataclasses.replace(arrays, room=dataclasses.replace(arrays.room, boxes=boxes))
    with pytest.raises(SceneFileError, match="room: found boxes or a floor changed in the arrays"):
        save_scene(folder / "wrong.yaml", dataclasses.replace(scene, arrays=room))
    with pytest.raises(
        SceneFileError, match="room: found a room of 6 boxes without its furniture, allowed is one table"
    ):
        save_scene(folder / "wrong.yaml", dataclasses.replace(scene, furniture=None))
    with pytest.raises(SceneFileError, match="2 names"):
        save_scene(folder / "wrong.yaml", dataclasses.replace(scene, names=scene.names[:2]))
    assert not (folder / "wrong.yaml").exists()


def test_the_papers_world_is_a_room_too(folder):
    scene = load_text(folder, scene_texts.TEXT.replace("mug_1", "table"))
    room = as_room(scene)
    assert room.box_names == ("table_0",)
    assert rules(room) == ("point", False)
    save_scene(folder / "converted.yaml", room)
    again = load_scene(folder / "converted.yaml")
    assert_equal(again, room)
    for a, b in zip(jax.tree.leaves(again.arrays), jax.tree.leaves(scene.arrays), strict=True):
        np.testing.assert_array_equal(a, b)
    with pytest.raises(ValueError, match="format: found a room"):
        as_room(room)


ODD = st.none() | st.booleans() | st.integers(-3, 300) | st.floats() | st.text(max_size=4) | st.just([]) | st.just({})


def paths_of(value, path=()):
    yield path
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in children:
        yield from paths_of(child, (*path, key))


@settings(max_examples=200)
@given(st.data())
def test_changed_rooms_are_read_or_refused(folder, data):
    """Whatever a file holds: a scene, or one sentence."""
    room = content() | {"map": "hall.yaml", "robot": {"start": [5.0, 1.5, 0.0]}}
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from([path for path in paths_of(room) if path]))
        parent = room
        for key in path[:-1]:
            parent = parent[key]
        old, change = parent[path[-1]], data.draw(st.sampled_from(["nudge", "replace", "remove", "repeat"]))
        if change == "nudge" and isinstance(old, float):
            parent[path[-1]] = old + data.draw(st.floats(-2, 2))
        elif change == "remove":
            del parent[path[-1]]
        elif change == "repeat" and isinstance(parent, list):
            parent.append(json.loads(json.dumps(old)))
        else:
            parent[path[-1]] = data.draw(ODD)
    said = None
    try:
        load_text(folder, json.dumps(room), "changed.json")
    except SceneFileError as error:
        said = str(error)
    assert said is None or (": " in said and "\n" not in said and len(said) < 500)


def test_yaml_and_json_are_the_same(folder):
    assert_equal(load_text(folder, json.dumps(content()), "room.json"), load_text(folder, TEXT))
    assert_equal(load_text(folder, yaml.safe_dump(content())), load_text(folder, TEXT))
