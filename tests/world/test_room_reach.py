"""Where a base gets to in a room, beside the definitions of rooms' drives."""

import math

import numpy as np
import pytest

from basenet_jax.world.furniture import Furniture, ObstacleFields, SurfaceFields, WallFields, furnish
from basenet_jax.world.room_reach import Reach
from tests.oracles.occupancy_map import inside_box

TABLE = SurfaceFields(name="table", pose=(5.0, 2.0, 0.0), size=(1.2, 0.8), height=0.75)


def reach(robot, surfaces=(TABLE,), obstacles=(), walls=()):
    furniture = Furniture(
        floor=(0.0, 0.0, 8.0, 4.0), surfaces=list(surfaces), obstacles=list(obstacles), walls=list(walls)
    )
    room, _ = furnish(furniture)
    return Reach(room, robot), (np.array(surfaces[0].pose), np.array(surfaces[0].size) / 2)


def wall(x, low, high):
    return WallFields(name="wall", points=[(x, low), (x, high)], thickness=0.1, height=2.0)


def test_turning_places_are_clear_of_grown_boxes_and_of_the_floors_edge(robot):
    """Grown by half the footprint's diagonal and 0.05, less a millimetre for points; overhanging boxes don't count."""
    lamp = ObstacleFields(name="lamp", pose=(2.0, 2.0, 0.0), size=(0.3, 0.3, 0.3), z=1.5)
    crate = ObstacleFields(name="crate", pose=(2.0, 3.0, 0.6), size=(0.3, 0.5, 0.3))
    where, _ = reach(robot, obstacles=(lamp, crate))
    radius = math.hypot(0.4, 0.25)
    points = np.random.default_rng(0).uniform((0, 0), (8, 4), (2000, 2))
    margin = radius + 0.05 - 0.001
    expected = [
        radius <= x <= 8 - radius
        and radius <= y <= 4 - radius
        and not inside_box((x, y), (5.0, 2.0, 0.0), (0.6 + margin, 0.4 + margin))
        and not inside_box((x, y), (2.0, 3.0, 0.6), (0.15 + margin, 0.25 + margin))
        for x, y in points.tolist()
    ]
    assert where.turning(points).tolist() == expected
    assert 0.2 < np.mean(expected) < 0.8


def test_a_wall_parts_the_floor_and_a_gap_joins_it_again(robot):
    ends = np.array([[1.0, 2.0], [7.2, 2.0]])
    whole, _ = reach(robot)
    parted, _ = reach(robot, walls=(wall(3.0, 0.0, 4.0),))
    narrow, _ = reach(robot, walls=(wall(3.0, 0.0, 3.02),))
    gap, _ = reach(robot, walls=(wall(3.0, 0.0, 2.9),))
    assert [len(set(each.part(ends).tolist())) for each in (whole, parted, narrow, gap)] == [1, 2, 2, 1]
    assert np.all(parted.part(ends) > 0)
    assert whole.part(np.array([[5.0, 2.0]])) == [0]


@pytest.mark.parametrize(("where", "served"), [((1.0, 2.0), True), ((7.2, 2.0), True)])
def test_an_open_table_is_served_from_everywhere(robot, where, served):
    found, top = reach(robot)
    part = int(found.part(np.array([where]))[0])
    assert found.serves(part, *top) == served


def test_a_table_behind_a_wall_is_not_served(robot):
    found, top = reach(robot, walls=(wall(3.0, 0.0, 4.0),))
    near, far = found.part(np.array([[7.2, 2.0], [1.0, 2.0]])).tolist()
    assert found.serves(near, *top)
    assert not found.serves(far, *top)


def test_a_stop_in_a_bay_is_left_straight(robot):
    """Between two crates 0.75 m apart the base fits, and can only go straight out; at 0.65 m apart it doesn't fit."""
    counter = SurfaceFields(name="counter", pose=(7.7, 2.0, math.pi / 2), size=(0.5, 0.6), height=0.8)

    def served(gap):
        crates = [
            ObstacleFields(name=f"crate_{i}", pose=(6.6, 2.0 + side * (gap / 2 + 0.8), 0.0), size=(1.6, 1.6, 1.0))
            for i, side in enumerate((-1, 1))
        ]
        found, top = reach(robot, surfaces=(counter,), obstacles=crates)
        part = int(found.part(np.array([[2.0, 2.0]]))[0])
        assert part
        return found.serves(part, *top)

    assert served(0.75)
    assert not served(0.65)
