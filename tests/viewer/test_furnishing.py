"""Rooms whose furniture was moved, added and removed are such that files can hold them."""

import math

import numpy as np
import pytest

from basenet_jax.viewer import editing, furnishing
from basenet_jax.viewer.editing import PlacementError
from basenet_jax.viewer.furnishing import NEW, add_piece, move_piece, pieces, pose_of, remove_piece
from basenet_jax.world.furniture import WallFields
from basenet_jax.world.room_file import as_room
from basenet_jax.world.scene_file import load_scene, save_scene


def on(room, name):
    """Where an object is, seen from the surface under it: that surface's name, and x, y, yaw there."""
    slot = room.names.index(name)
    box = int(editing.surfaces_of(room)[slot])
    x, y, yaw = np.asarray(room.arrays.room.boxes.pose[box], float)
    pose = np.asarray(room.arrays.object_pose[slot], float)
    turned = complex(*(pose[:2] - (x, y))) * np.exp(-1j * yaw)
    return room.box_names[box], turned.real, turned.imag, pose[2] - yaw


def holds(room, folder):
    """That a file holds it, read back the same."""
    save_scene(folder / "room.yaml", room)
    read = editing.pad(load_scene(folder / "room.yaml"))
    assert (read.names, read.box_names, read.furniture) == (room.names, room.box_names, room.furniture)
    np.testing.assert_array_equal(read.arrays.object_pose, room.arrays.object_pose)


def test_every_box_belongs_to_a_piece(room):
    placed = pieces(room.furniture)
    assert list(placed) == ["bench", "shelf_2", "pillar", "lamp", "north", "charging"]
    boxes = room.arrays.room.boxes
    for name, (piece, own) in placed.items():
        assert room.box_names[own] == (name,)
        np.testing.assert_allclose(boxes.pose[own.start, :2], pose_of(piece)[:2], atol=1e-6)


def test_a_surface_carries_what_stands_on_it(room, tmp_path):
    before = {name: on(room, name) for name in room.names}
    moved = move_piece(room, "bench", np.array([2.2, 4.4, 0.3]))
    assert pose_of(pieces(moved.furniture)["bench"].piece) == pytest.approx([2.2, 4.4, 0.3])
    for name in room.names:
        after = on(moved, name)
        assert after[0] == before[name][0]
        assert after[1:] == pytest.approx(before[name][1:], abs=2e-5), "poses are rounded to tenths of a millimetre"
    np.testing.assert_array_equal(moved.arrays.object_pose[2], room.arrays.object_pose[2])
    holds(moved, tmp_path)


def test_a_wall_is_moved_and_turned_as_a_whole(room, tmp_path):
    moved = move_piece(room, "north", np.array([4.25, 6.0, 0.1]))
    wall = pieces(moved.furniture)["north"].piece
    assert isinstance(wall, WallFields)
    points = np.array(wall.points)
    np.testing.assert_allclose(np.mean(points, axis=0), [4.25, 6.0], atol=1e-4)
    np.testing.assert_allclose(np.diff(points, axis=0)[0], 8.5 * np.array([math.cos(0.1), math.sin(0.1)]), atol=2e-4)
    holds(moved, tmp_path)


@pytest.mark.parametrize(
    ("name", "pose", "message"),
    [
        ("bench", (4.0, 6.1, 0.0), "bench can't stand there, north does"),
        ("north", (2.0, 3.0, 0.0), "north can't stand there, bench does"),
        ("pillar", (2.1, 3.3, 0.0), "pillar can't stand there, mug_1 does"),
        ("pillar", (4.2, 1.3, 0.0), r"the robot would start less than 0\.1 m from pillar"),
        ("charging", (4.2, 1.3, 0.0), r"the robot would start less than 0\.1 m from charging"),
        ("sofa", (4.2, 1.3, 0.0), "sofa isn't there any more"),
    ],
)
def test_where_something_stands_nothing_else_does(room, name, pose, message):
    with pytest.raises(PlacementError, match=message):
        move_piece(room, name, np.array(pose))


def test_nothing_leaves_the_floor(room):
    moved = move_piece(room, "pillar", np.array([40.0, 3.0, 0.0]))
    assert pose_of(pieces(moved.furniture)["pillar"].piece) == pytest.approx([8.5, 3.0, 0.0])


@pytest.mark.parametrize("kind", NEW)
def test_a_new_piece_stands_apart_and_goes_again(room, tmp_path, kind):
    grown, name = add_piece(room, kind)
    assert name == f"{NEW[kind].name}_1"
    assert set(pieces(grown.furniture)) == {*pieces(room.furniture), name}
    holds(grown, tmp_path)
    left = remove_piece(grown, name)
    assert (left.furniture, left.box_names) == (room.furniture, room.box_names)


def test_a_surface_goes_with_what_stands_on_it_but_something_stays(room, tmp_path):
    left = remove_piece(room, "bench")
    assert left.names == ("part_7",)
    holds(left, tmp_path)
    with pytest.raises(PlacementError, match="the last surface can't be removed"):
        remove_piece(left, "shelf_2")
    grown, name = add_piece(left, "table")
    with pytest.raises(PlacementError, match="all objects stand on shelf_2"):
        remove_piece(grown, "shelf_2")
    moved = editing.move_object(grown, "part_7", np.array([0.0, 0.0, 0.0]), pieces(grown.furniture)[name].boxes.start)
    assert pieces(remove_piece(moved, "shelf_2").furniture).keys() == {"pillar", "lamp", "north", "charging", name}


def test_an_object_goes_from_surface_to_surface(room, tmp_path):
    shelf = pieces(room.furniture)["shelf_2"].boxes.start
    moved = editing.move_object(room, "mug_1", np.array([5.7, 0.4, 0.0]), shelf)
    assert on(moved, "mug_1")[0] == "shelf_2"
    assert moved.arrays.surface_height[0] == moved.arrays.room.boxes.high[shelf]
    holds(moved, tmp_path)
    with pytest.raises(PlacementError, match="mug_1 can't stand there, part_7 does"):
        editing.move_object(room, "mug_1", np.array([6.1, 0.45, 0.0]), shelf)


def test_an_object_goes_to_the_edge_of_a_turned_surface(room):
    moved = editing.move_object(room, "bowl_1", np.array([9.0, 4.5, 0.0]))
    name, x, y, _ = on(moved, "bowl_1")
    assert (name, y) == ("bench", pytest.approx(-0.35, abs=1e-6)), "turned by a quarter, its side is at x = 2.35"
    assert x == pytest.approx(0.9, abs=1e-6)


def test_the_paper_s_world_and_point_drives_keep_their_table(scene):
    with pytest.raises(PlacementError, match="paper's world, with one table"):
        add_piece(scene, "table")
    with pytest.raises(PlacementError, match="drives: point"):
        move_piece(editing.pad(as_room(scene)), "table", np.array([0.5, 0.0, 0.0]))


def test_a_map_stays_where_it_is(room):
    """Its boxes come after those that are written, whose number changes."""
    import dataclasses

    boxes = furnishing.written_boxes(room.furniture)[0]
    of_map = type(boxes)(*(getattr(boxes, leaf)[:2] for leaf in type(boxes).__dataclass_fields__))
    arrays, names = furnishing.furnish(room.furniture, of_map)
    with_map = dataclasses.replace(room, arrays=dataclasses.replace(room.arrays, room=arrays), box_names=names)
    grown, _ = add_piece(with_map, "wall")
    assert grown.box_names[-2:] == ("map", "map")
    np.testing.assert_array_equal(grown.arrays.room.boxes.pose[7:9], boxes.pose[:2])
