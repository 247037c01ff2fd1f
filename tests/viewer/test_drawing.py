"""What lies on the floor of a room: its squares, its bounds and its map."""

import dataclasses

import numpy as np

from basenet_jax.viewer.drawing import extents, floor_lines, floor_of, map_picture
from basenet_jax.viewer.furniture_view import hatching


def test_the_floor_is_as_large_as_its_bounds(room, scene):
    np.testing.assert_array_equal(floor_of(room), [(0.0, 0.0), (9.0, 7.0)])
    np.testing.assert_array_equal(floor_of(scene), [(-6.0, -6.0), (6.0, 6.0)])


def test_without_bounds_it_is_as_large_as_what_stands_on_it(room):
    """And the map, which may be far larger, doesn't count."""
    unbounded = dataclasses.replace(room.arrays.room, floor=np.array([-np.inf, -np.inf, np.inf, np.inf]))
    boxes = dataclasses.replace(unbounded.boxes, pose=np.array(unbounded.boxes.pose))
    boxes.pose[6] = (50.0, 50.0, 0.0)
    arrays = dataclasses.replace(room.arrays, room=dataclasses.replace(unbounded, boxes=boxes))
    low, high = extents(dataclasses.replace(room, arrays=arrays, box_names=(*room.box_names, "map")))
    np.testing.assert_allclose(low, [-1.0, -0.8], atol=1e-5)  # 1 m beyond the wall, and the board of the shelf
    np.testing.assert_allclose(high, [9.5, 7.25], atol=1e-5)


def test_lines_of_the_floor_make_squares_of_a_metre():
    lines = floor_lines(np.array([0.0, 1.0]), np.array([2.0, 4.0]))
    assert lines.shape == (3 + 4, 2, 3)
    ends = {tuple(map(tuple, line[:, :2].tolist())) for line in lines}
    assert ((1.0, 1.0), (1.0, 4.0)) in ends
    assert ((0.0, 3.0), (2.0, 3.0)) in ends


def test_hatching_stays_inside():
    half = np.array([0.7, 0.3])
    lines = hatching(half, 0.15)
    assert np.all(np.abs(lines) <= half + 1e-12)
    np.testing.assert_allclose(np.diff(lines, axis=1)[:, 0, 0], np.diff(lines, axis=1)[:, 0, 1])
    assert np.all(np.diff(lines[..., 1] - lines[..., 0], axis=0) - 0.15 < 1e-12)


def test_a_map_s_picture_shows_closed_cells_and_is_bounded():
    closed = np.zeros((3, 5000), bool)
    closed[1, 4321] = True
    picture = map_picture(closed)
    assert max(picture.shape) <= 2048
    rows, columns = np.nonzero(picture[..., 3])
    assert (rows.tolist(), columns.tolist()) == ([0], [4321 // 3])
    assert np.count_nonzero(map_picture(np.ones((4, 4), bool))[..., 3]) == 16
