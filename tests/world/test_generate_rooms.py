"""Random rooms obey their rules, a seed gives one room, and batches have one size."""

import hashlib
import json

import jax
import numpy as np
import pytest

from basenet_jax.config import SceneConfig
from basenet_jax.world import generate_rooms
from basenet_jax.world.boxes import blocks
from basenet_jax.world.generate_rooms import draw_room
from basenet_jax.world.room_batch import PADDED_BOXES, draw_rooms, pad_scene
from basenet_jax.world.room_file import room_document
from tests.oracles.clearance import polygon_distance
from tests.oracles.occupancy_map import inside_box


@pytest.fixture(scope="module")
def rooms():
    return [draw_room([0, i], 1 + i % 24) for i in range(40)]


def corners(pose, size):
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    return (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(size) / 2) @ turn.T + np.array(pose[:2])


def test_furniture_is_of_the_sizes_and_stands_on_the_floor_apart(rooms):
    near_wall = turned = count = 0
    for room in rooms:
        furniture = room.furniture
        _, _, width, depth = furniture.floor
        assert 6 <= width <= 10
        assert 5 <= depth <= 8
        assert 1 <= len(furniture.surfaces) <= 3
        assert 0 <= len(furniture.obstacles) <= 6
        for each in furniture.surfaces:
            assert 0.8 <= each.size[0] <= 2.4
            assert 0.5 <= each.size[1] <= 1.0
            assert 0.6 <= each.height <= 0.9
            shape = corners(each.pose, each.size)
            near_wall += min(shape.min(), (np.array([width, depth]) - shape).min()) <= 1.0
            turned += abs(each.pose[2] / (np.pi / 2) - round(each.pose[2] / (np.pi / 2))) > 1e-6
            count += 1
        for each in furniture.obstacles:
            assert 0.2 <= each.size[0] == each.size[1] <= 0.8
            assert 0.2 <= each.size[2] <= 1.8
        shapes = [corners(each.pose, each.size[:2]) for each in (*furniture.surfaces, *furniture.obstacles)]
        for index, shape in enumerate(shapes):
            assert np.all(shape >= -1e-3)
            assert np.all(shape <= np.array([width, depth]) + 1e-3)
            assert all(polygon_distance(shape, other) > 0.04 for other in shapes[:index])
    assert near_wall >= 0.4 * count, "half of them are so near, and some others by chance"
    assert 0.05 * count < turned < 0.5 * count


def test_objects_stand_on_their_surfaces_apart(rooms):
    for room in rooms:
        document, arrays = room_document(room), jax.device_get(room.arrays)
        surfaces = {each.name: each for each in room.furniture.surfaces}
        on = [surfaces[item["on"]] for item in document["objects"]]
        for pose, height, surface in zip(arrays.object_pose, arrays.surface_height, on, strict=True):
            assert height == np.float32(surface.height)
            half = np.array(surface.size) / 2 - 0.08 + 1e-3
            assert inside_box(pose[:2].tolist(), surface.pose, half)
        radius = np.minimum(np.hypot(*arrays.object_size[:, :2].T) / 2, 0.09)
        for i, j in zip(*np.triu_indices(len(on), 1), strict=True):
            distance = np.hypot(*(arrays.object_pose[i] - arrays.object_pose[j])[:2])
            assert on[i] is not on[j] or distance >= radius[i] + radius[j] - 1e-3


def test_the_start_is_a_turning_place_and_a_stop(rooms):
    margin = np.hypot(0.4, 0.25) + 0.05 - 0.001
    for room in rooms:
        x, y, heading = np.asarray(room.arrays.robot_start, float).tolist()
        base = corners((x, y, heading), (0.8, 0.5))
        _, _, width, depth = room.furniture.floor
        assert margin - 0.05 <= x <= width - margin + 0.05
        assert margin - 0.05 <= y <= depth - margin + 0.05
        for each in (*room.furniture.surfaces, *room.furniture.obstacles):
            assert not inside_box((x, y), each.pose, np.array(each.size[:2]) / 2 + margin - 1e-6)
            assert polygon_distance(base, corners(each.pose, np.array(each.size[:2]) + 0.2)) > 0


def test_a_seed_gives_the_same_room_everywhere():
    """What the file of a room holds is kept: it doesn't depend on the machine or on versions."""
    text = json.dumps(room_document(draw_room(7, 5)))
    assert text == json.dumps(room_document(draw_room(7, 5)))
    assert text != json.dumps(room_document(draw_room(8, 5)))
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == "3f47ffa8bae2741d"


def test_what_finds_no_place_is_told(monkeypatch):
    monkeypatch.setattr(generate_rooms, "_ROOMS", 4)
    with pytest.raises(ValueError, match="objects: found 50, which find no place in 4 rooms, allowed are fewer"):
        draw_room(0, 50, config=SceneConfig(max_footprint_radius_m=1.0, edge_margin_m=0.3, tries=32))


def test_rooms_of_a_batch_are_padded_to_one_size():
    batch, rooms = draw_rooms(0, 4, (1, 3), slots=3)
    assert batch.room.boxes.pose.shape == (4, PADDED_BOXES, 3)
    assert batch.object_pose.shape == (4, 3, 3)
    assert batch.object_grasps.pose.shape[:2] == batch.object_grasps.there.shape[:2] == (4, 3)
    assert {len(room.names) for room in rooms} == {1, 3}
    solid = blocks(batch.room.boxes, 0.75)
    for index, room in enumerate(rooms):
        assert solid[index].sum() == len(room.box_names)
        assert batch.mask[index].sum() == len(room.names)
        np.testing.assert_array_equal(batch.room.floor[index], room.arrays.room.floor)
    again, _ = draw_rooms(0, 2, (1, 3), slots=3)
    np.testing.assert_array_equal(again.object_pose, batch.object_pose[:2])
    with pytest.raises(ValueError, match="slots: found 3, allowed are up to 2"):
        pad_scene(next(room for room in rooms if len(room.names) == 3).arrays, slots=2)
