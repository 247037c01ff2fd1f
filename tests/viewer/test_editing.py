"""Edited scenes stay such that files can hold them, and anything else is refused with the reason."""

import dataclasses

import numpy as np
import pytest

from basenet_jax.api import sample_scene
from basenet_jax.viewer import editing
from basenet_jax.viewer.editing import FEW_OBJECTS, PlacementError
from basenet_jax.world.room_file import as_room
from basenet_jax.world.scene import MAX_OBJECTS, OBJECT_CLASSES
from basenet_jax.world.scene_file import load_scene, save_scene


def test_padding_keeps_the_objects(scene):
    assert scene.arrays.mask.shape == (FEW_OBJECTS,)
    assert scene.arrays.mask.tolist() == [True, True] + [False] * (FEW_OBJECTS - 2)
    np.testing.assert_array_equal(editing.pad(scene).arrays.object_pose, scene.arrays.object_pose)


def test_an_object_goes_where_it_is_put(scene):
    moved = editing.move_object(scene, "mug_2", np.array([-0.5, 0.2, 1.0]))
    np.testing.assert_allclose(moved.arrays.object_pose[1], [-0.5, 0.2, 1.0], rtol=1e-6)
    np.testing.assert_array_equal(moved.arrays.object_pose[0], scene.arrays.object_pose[0])
    np.testing.assert_allclose(scene.arrays.object_pose[1], [0.4, -0.25, 0.8], rtol=1e-6)


def test_an_object_that_is_put_beside_the_table_stops_at_its_edge(scene):
    moved = editing.move_object(scene, "mug_1", np.array([-7.0, 0.6, 0.0]))
    np.testing.assert_allclose(moved.arrays.object_pose[0], [-1.0, 0.4, 0.0])


def test_objects_dont_stand_in_one_another(scene):
    with pytest.raises(PlacementError, match="mug_1 can't stand there, mug_2 does"):
        editing.move_object(scene, "mug_1", np.array([0.41, -0.25, 0.0]))


def test_an_object_of_its_own_size_needs_room_for_all_of_it(scene):
    """A plate of 0.6 m: its centre may come within 0.15 m of a mug's by the rule for random objects."""
    size, kind = np.array(scene.arrays.object_size), np.array(scene.arrays.object_class)
    size[0], kind[0] = (0.6, 0.6, 0.05), -1
    wide = dataclasses.replace(scene.arrays, object_size=size, object_class=kind)
    plate = editing.move_object(dataclasses.replace(scene, arrays=wide), "mug_1", np.array([-0.6, 0.1, 0.0]))
    with pytest.raises(PlacementError, match="mug_1 can't stand there, mug_2 does"):
        editing.move_object(plate, "mug_1", np.array([0.1, -0.1, 0.0]))
    with pytest.raises(PlacementError, match="mug_2 can't stand there, mug_1 does"):
        editing.move_object(plate, "mug_2", np.array([-0.35, 0.35, 0.0]))
    grown = editing.add_object(plate, "bowl")
    away = np.abs(grown.arrays.object_pose[2, :2] - plate.arrays.object_pose[0, :2])
    assert np.max(away) > 0.3 + 0.07


def test_the_robot_starts_where_it_is_put_but_not_at_the_table(scene):
    moved = editing.move_start(scene, np.array([-2.0, 1.0, 3.0]))
    np.testing.assert_allclose(moved.arrays.robot_start, [-2.0, 1.0, 3.0])
    with pytest.raises(PlacementError, match=r"can't start less than 0\.1 m from the table"):
        editing.move_start(scene, np.array([1.3, 0.0, 0.0]))


@pytest.mark.parametrize("kind", [each.name for each in OBJECT_CLASSES])
def test_a_new_object_is_of_its_class_and_has_a_name_of_its_own(scene, kind):
    grown = editing.add_object(scene, kind)
    assert grown.names[:2] == scene.names
    assert grown.names[2] == ("mug_3" if kind == "mug" else f"{kind}_1")
    expected = next(each for each in OBJECT_CLASSES if each.name == kind)
    np.testing.assert_allclose(grown.arrays.object_size[2], expected.size)
    assert grown.arrays.mask.sum() == 3


def test_a_removed_object_leaves_no_gap(scene):
    grown = editing.add_object(scene, "bowl")
    left = editing.remove_object(grown, "mug_1")
    assert left.names == ("mug_2", "bowl_1")
    np.testing.assert_array_equal(left.arrays.object_pose[:2], grown.arrays.object_pose[1:3])
    assert left.arrays.mask.sum() == 2
    assert not np.any(left.arrays.object_pose[2:])


def test_a_room_stays_the_room_that_it_was_made_of(scene):
    room = as_room(scene)
    for edited in (editing.add_object(room, "mug"), editing.remove_object(room, scene.names[0])):
        assert (edited.furniture, edited.box_names) == (room.furniture, room.box_names)


def test_the_last_object_stays(scene):
    one = editing.remove_object(scene, "mug_1")
    with pytest.raises(PlacementError, match="last object"):
        editing.remove_object(one, "mug_2")


def test_many_edits_make_a_scene_that_a_file_can_hold(scene, tmp_path):
    """Up to the most objects there may be, or until the table is full."""
    rng = np.random.default_rng(0)
    while len(scene.names) < MAX_OBJECTS:
        try:
            scene = editing.add_object(scene, OBJECT_CLASSES[rng.integers(5)].name)
        except PlacementError:
            break
    assert len(scene.names) > FEW_OBJECTS
    assert scene.arrays.mask.shape == (MAX_OBJECTS,)
    scene = editing.remove_object(scene, scene.names[3])
    save_scene(tmp_path / "scene.yaml", scene)
    read = load_scene(tmp_path / "scene.yaml")
    assert read.names == scene.names
    np.testing.assert_array_equal(read.arrays.object_pose, scene.arrays.object_pose[: len(scene.names)])


def test_no_more_objects_than_files_may_have(scene):
    import jax

    full = editing.pad(sample_scene(jax.random.key(0), objects=MAX_OBJECTS))
    with pytest.raises(PlacementError, match=f"there are {MAX_OBJECTS} objects"):
        editing.add_object(full, "mug")
