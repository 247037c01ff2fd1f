"""Scene files: what is read, what is refused and in which words, and that writing loses nothing."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from basenet_jax.documents.text_files import MAX_JSON_BYTES, MAX_YAML_BYTES
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.grasps import of_class
from basenet_jax.world.naming import name_objects
from basenet_jax.world.scene import BY_SLOT, MAX_OBJECTS, OBJECT_CLASSES, NamedScene
from basenet_jax.world.scene_file import SceneFileError, load_scene, save_scene
from tests.scene_texts import TEXT, content


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("scenes")


def load_text(folder, text, name="scene.yaml"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    return load_scene(path)


def message(folder, text, name="scene.yaml"):
    """What is said of a bad file, without its name."""
    with pytest.raises(SceneFileError) as info:
        load_text(folder, text, name)
    assert str(info.value).startswith(f"{folder / name}: ")
    return str(info.value).removeprefix(f"{folder / name}: ")


def assert_equal(one: NamedScene, other: NamedScene):
    assert (one.names, one.robot) == (other.names, other.robot)
    for a, b in zip(jax.tree.leaves(one.arrays), jax.tree.leaves(other.arrays), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_scene_is_read_as_it_stands(folder):
    scene = load_text(folder, TEXT)
    arrays = scene.arrays
    assert scene.names == ("mug_1", "part_7")
    assert scene.robot == "ur5e_mobile"
    mug = OBJECT_CLASSES[3]
    np.testing.assert_array_equal(arrays.object_pose, np.array([[0.31, -0.22, 0.4], [0.1, -0.2, 1.1]], np.float32))
    np.testing.assert_array_equal(arrays.object_size, np.array([mug.size, (0.05, 0.05, 0.12)], np.float32))
    np.testing.assert_array_equal(
        arrays.object_grasps.planar[:, 0], np.array([(-0.06, 0, 0.3, 0), (0, 0, 0.3, 0)], np.float32)
    )
    assert arrays.object_class.tolist() == [3, -1]
    assert arrays.mask.tolist() == [True, True]
    np.testing.assert_array_equal(arrays.robot_start, np.array([2.4, -1.1, 1.57], np.float32))
    np.testing.assert_array_equal(arrays.room.table_half_size, np.array([1.0, 0.4], np.float32))
    assert float(arrays.room.table_height) == 0.75


def test_table_and_model_may_be_left_out(folder):
    scene = content()
    del scene["table"], scene["robot"]["model"]
    assert_equal(load_text(folder, yaml.safe_dump(scene)), load_text(folder, TEXT))


@pytest.mark.parametrize("name", ["scene.json", "scene.JSON", "scene.yaml", "scene"])
def test_json_is_read_by_any_name(folder, name):
    assert_equal(load_text(folder, json.dumps(content()), name), load_text(folder, TEXT))


def test_numbers_are_those_of_yaml_1_2(folder):
    scene = load_text(folder, TEXT.replace("0.31", "31e-2").replace("mug_1", "no").replace("part_7", "2026-01-01"))
    assert scene.names == ("no", "2026-01-01")
    assert float(scene.arrays.object_pose[0, 0]) == np.float32(0.31)


# What is replaced by what, and what is then said.
BAD = [
    ("scene/1", "scene/3", "format: found 'basenet-scene/3', allowed is 'basenet-scene/1' or 'basenet-scene/2'"),
    ("scene/1", "scene/2", "table: found an unknown key, allowed are format, floor, map, surfaces, obstacles"),
    ("format: basenet-scene/1\n", "", "format: found nothing, allowed is 'basenet-scene/1' or 'basenet-scene/2'"),
    ("robot:", "roboter:", "roboter: found an unknown key, allowed are format, table, robot, objects"),
    (
        "mug_1,",
        "mug_1, color: 1,",
        "objects[0].color: found an unknown key, allowed are name, class, pose, size, grasp",
    ),
    (
        "pose: [0.31, -0.22, 0.4]",
        "",
        "objects[0].pose: found nothing, allowed is [x, y, yaw], three numbers",
    ),
    ("[0.31, -0.22, 0.4]", "[0.31, 1]", "objects[0].pose: found [0.31, 1], allowed is [x, y, yaw], three numbers"),
    (
        "0.31, -0.22, 0.4",
        "0.31, -0.22, 90",
        "objects[0].pose[2]: found 90, allowed is a number from -100 to 100 (m), and t",
    ),
    ("0.31", "'a'", "objects[0].pose[0]: found 'a', allowed is a number from -100 to 100 (m), and the angle from -6.3"),
    ("0.31", "true", "objects[0].pose[0]: found true, allowed is a number"),
    ("0.31", "null", "objects[0].pose[0]: found null, allowed is a number"),
    ("0.31", "2026-01-01", "objects[0].pose[0]: found '2026-01-01', allowed is a number"),
    ("0.31", "1:30", "objects[0].pose[0]: found '1:30', allowed is a number"),
    ("0.31", ".nan", "objects[0].pose[0]: found nan, allowed are finite numbers"),
    ("0.31", "-.inf", "objects[0].pose[0]: found -inf, allowed are finite numbers"),
    ("0.31", "1e999", "objects[0].pose[0]: found inf, allowed are finite numbers"),
    ("0.31", "1" + "0" * 400, "objects[0].pose[0]: found inf, allowed are finite numbers"),
    ("0.31", "9" * 5000, "objects[0].pose[0]: found inf, allowed are finite numbers"),
    ("0.31", "1.01", "objects[0].pose[0]: found 1.01, off the table, allowed is -1.0 to 1.0"),
    ("-0.2,", "-0.41,", "objects[1].pose[1]: found -0.41, off the table, allowed is -0.4 to 0.4"),
    (
        "[0.1, -0.2,",
        "[0.31, -0.14,",
        "objects[1].pose: found 0.0800 m to the centre of objects[0] ('mug_1'), allowed",
    ),
    (
        "[0.05, 0.05,",
        "[0.5, 0.5,",
        "objects[1].pose: found [0.1, -0.2, 1.1], where its rectangle overlaps that of objects[0] ('mug_1'), allowed",
    ),
    ("part_7", "mug_1", "objects[1].name: found 'mug_1', the name of objects[0] too, allowed is a name of its own"),
    ("mug_1", "12", "objects[0].name: found 12, allowed is a text"),
    ("mug_1", "' a'", "objects[0].name: found ' a', allowed are 1 to 64 printable characters"),
    ("mug_1", "''", "objects[0].name: found '', allowed are 1 to 64 printable characters"),
    ("mug_1", "m" * 65, "objects[0].name: found 'mmm"),
    ("mug_1", '"\\e[31m"', "objects[0].name: found '\\x1b[31m', allowed are 1 to 64 printable characters"),
    (
        "class: mug",
        "class: mag",
        "objects[0].class: found 'mag', allowed are cracker_box, bleach_cleanser",
    ),
    (
        "class: mug, ",
        "",
        "objects[0].class: found neither class nor size and grasp, allowed are a class",
    ),
    ("class: mug", "class: mug, size: [1, 1, 1]", "objects[0].size: found it beside class, allowed are size and grasp"),
    ("    size: [0.05, 0.05, 0.12]\n", "", "objects[1].size: found nothing, allowed are size and grasp"),
    ("0.12]", "-0.12]", "objects[1].size[2]: found -0.12, allowed is a number from 0.001 to 2 (m)"),
    ("z: 0.30", "z: 3", "objects[1].grasp.z: found 3, allowed is a number from -2 to 2 (m)"),
    (
        "ur5e_mobile",
        "fetch",
        "robot.model: found 'fetch', allowed are panda_mobile, ridgeback_ur5e, ur10e_mobile",
    ),
    ("2.4, -1.1", "1.3, 0", "robot.start: found [1.3, 0.0, 1.57], where the base of ur5e_mobile touches"),
    ("height: 0.75", "height: 0", "table.height: found 0, allowed is a number from 0.01 to 3 (m)"),
    ("[2.0, 0.8]", "[20, 0.8]", "table.size[0]: found 20, allowed is a number from 0.1 to 3 (m)"),
    ("height: 0.75", "height: 0.75, height: 0.7", "table.height: found the key twice, allowed is once"),
    ("height: 0.75", "[a]: 1", "table: found the key ['a'], allowed are keys of letters, digits and _"),
    ("mug_1", "&a mug_1", "line 5: found the anchor or alias 'a', allowed is YAML without"),
    ("mug_1", "*a", "line 5: found the anchor or alias 'a', allowed is YAML without"),
    (
        "mug_1",
        "!!python/name:os.system x",
        "line 5: found the tag 'tag:yaml.org,2002:python/name:os.system'",
    ),
    ("0.31", "!!int abc", "line 5: found 'abc' tagged as int, allowed is YAML without tags"),
    ("0.31", "[" * 50 + "]" * 50, "line 5: found more than 16 levels of nesting, allowed are up to 16"),
    ("mug_1,", "mug_1", "line 5: no YAML: "),
    ("objects:", "---\nobjects:", "line 4: no YAML: "),
]


@pytest.mark.parametrize(("old", "new", "said"), BAD, ids=lambda text: text[:40])
def test_what_is_wrong_is_said(folder, old, new, said):
    assert old in TEXT
    assert message(folder, TEXT.replace(old, new, 1)).startswith(said)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "content: found an empty file, allowed is YAML or JSON"),
        (" \n\t\n", "content: found an empty file"),
        ("# nothing", "content: found null, allowed is a mapping with format, table, robot, objects"),
        ("[1, 2]", "content: found [1, 2], allowed is a mapping"),
        (b"\x89PNG\r\n\x1a\n\x00", "content: found the byte 0x89 at offset 0, allowed is UTF-8 text"),
        (b"\x00" * 10, "content: found the character 0x00 at offset 0, allowed is text"),
        ("[" * (MAX_YAML_BYTES - 1), "line 1: found more than 16 levels of nesting"),
        ("x" * (MAX_YAML_BYTES + 1), "content: found more than 65536 bytes, allowed are up to 65536"),
    ],
    ids=range(8),
)
def test_what_is_no_document_is_refused(folder, text, said):
    assert message(folder, text).startswith(said)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("0.31", "NaN", "objects[0].pose[0]: found nan, allowed are finite numbers"),
        ("0.31", "1e999", "objects[0].pose[0]: found inf, allowed are finite numbers"),
        ("0.31", "9" * 5000, "objects[0].pose[0]: found inf, allowed are finite numbers"),
        ("0.31", "[" * 100 + "]" * 100, "content: found more than 16 levels of nesting"),
        ("0.31", "[" * 200_000, "content: found more than 16 levels of nesting"),
        ('"name": "mug_1"', '"name": "mug_1", "name": "b"', "objects[0].name: found the key twice, allowed is once"),
        ('"name"', '"na me"', "objects[0]: found the key 'na me', allowed are keys of letters, digits and _"),
        ("mug_1", "\\ud800", "objects[0].name: found '\\ud800', allowed is Unicode text"),
        ('"mug_1",', '"mug_1"', "line 1: no JSON: "),
        ('"mug_1"', '"' + "x" * MAX_JSON_BYTES + '"', "content: found more than 1048576 bytes"),
    ],
    ids=range(10),
)
def test_bad_json_is_refused_likewise(folder, old, new, said):
    text = json.dumps(content())
    assert old in text
    assert message(folder, text.replace(old, new, 1), "scene.json").startswith(said)


def test_too_many_objects_are_refused(folder):
    scene = content()
    scene["objects"] = [{"name": f"mug_{i}", "class": "mug", "pose": [0, 0, 0]} for i in range(MAX_OBJECTS + 1)]
    found = message(folder, yaml.safe_dump(scene))
    assert found == "objects: found a list of 51, allowed is a list of 1 to 50 objects"
    scene["objects"] = []
    assert message(folder, yaml.safe_dump(scene)) == "objects: found [], allowed is a list of 1 to 50 objects"


@pytest.mark.parametrize("name", ["nowhere/scene.yaml", ".", "a" * 300, "a\0b"])
def test_a_file_that_cannot_be_read_is_named(folder, name):
    with pytest.raises(SceneFileError, match="can't be read"):
        load_scene(folder / name)


def test_objects_exactly_at_their_distance_may_stand(folder):
    """Two mugs touch at 0.1131 m; a millimetre less is allowed, 2 mm less is not."""
    mugs = [{"name": name, "class": "mug", "pose": [0.0, 0.0, 0.0]} for name in "ab"]
    scene = content() | {"objects": mugs}
    mugs[1]["pose"] = [0.1122, 0.0, 0.0]
    load_text(folder, yaml.safe_dump(scene))
    mugs[1]["pose"] = [0.1111, 0.0, 0.0]
    assert "0.1111 m to the centre" in message(folder, yaml.safe_dump(scene))


@pytest.fixture(scope="module")
def draw():
    draw = jax.jit(lambda key, count: draw_scene(key, count, Room.from_config(), slots=6, own_class_share=0.5))

    def named(seed: int, count: int) -> NamedScene:
        arrays, placed = draw(jax.random.key(seed), count)
        assert bool(placed)
        slots = jax.tree.map(lambda x: x[:count], {name: getattr(arrays, name) for name in BY_SLOT})
        return name_objects(dataclasses.replace(arrays, **slots))

    return named


NAMES = st.text(st.characters(codec="utf-8"), min_size=1, max_size=64)


@settings(max_examples=60)
@given(data=st.data(), seed=st.integers(0, 2**31), count=st.integers(1, 6), suffix=st.sampled_from([".yaml", ".json"]))
def test_a_saved_scene_comes_back_the_same(folder, draw, data, seed, count, suffix):
    names = NAMES.filter(lambda name: name.isprintable() and name == name.strip()) | st.sampled_from(
        [
            "1e3",
            "no",
            "null",
            "~",
            "=",
            "0x1f",
            "1:30",
            "2026-01-01",
            "[a",
            "- b",
            "c: d",
            "# e",
            ".inf",
            "!t",
            "&a",
            "é𝄞",
        ]
    )
    chosen = data.draw(st.lists(names, min_size=count, max_size=count, unique=True))
    scene = dataclasses.replace(draw(seed, count), names=tuple(chosen))
    path = folder / f"saved{suffix}"
    try:
        save_scene(path, scene)
    except SceneFileError as error:  # drawn objects keep discs free that are smaller than large ones of their own size
        assume("its rectangle overlaps" not in str(error))
        raise
    assert_equal(load_scene(path), scene)


def test_an_object_changed_from_its_class_is_written_with_its_own_size(folder, draw):
    scene = draw(0, 2)
    mug = OBJECT_CLASSES[3]
    arrays = dataclasses.replace(
        scene.arrays,
        object_class=jnp.array([3, 3]),
        object_size=jnp.array([mug.size, (0.08, 0.08, 0.09)]),
        object_grasps=of_class(jnp.tile(jnp.array([mug.grasp_x, mug.grasp_z, mug.grasp_yaw]), (2, 1))),
    )
    save_scene(folder / "own.yaml", dataclasses.replace(scene, arrays=arrays))
    again = load_scene(folder / "own.yaml").arrays
    assert again.object_class.tolist() == [3, -1]
    np.testing.assert_array_equal(again.object_size, arrays.object_size)


def test_an_invalid_scene_is_not_written(folder, draw):
    scene = draw(1, 3)
    pose = scene.arrays.object_pose
    wrong = dataclasses.replace(scene.arrays, object_pose=pose.at[1].set(pose[0]))
    path = folder / "invalid.yaml"
    with pytest.raises(SceneFileError, match=r"invalid\.yaml: objects\[1\]\.pose: found 0\.0000 m"):
        save_scene(path, dataclasses.replace(scene, arrays=wrong))
    nan = dataclasses.replace(scene.arrays, robot_start=jnp.array([jnp.nan, 0, 0]))
    with pytest.raises(SceneFileError, match="finite"):
        save_scene(path, dataclasses.replace(scene, arrays=nan))
    with pytest.raises(SceneFileError, match="2 names"):
        save_scene(path, dataclasses.replace(scene, names=scene.names[:2]))
    assert not path.exists()


def test_a_saved_file_reads_well(folder):
    save_scene(folder / "plain.yaml", load_text(folder, TEXT))
    text = (folder / "plain.yaml").read_text()
    assert "  start: [2.4, -1.1, 1.57]\n" in text
    assert "- name: mug_1\n  class: mug\n  pose: [0.31, -0.22, 0.4]\n" in text
    assert "  grasp: {x: 0.0, z: 0.3, yaw: 0.0}\n" in text
