"""What is said to be in the way is: without it the object could be picked, with it it could not."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from basenet_jax.planners.explanation import InTheWay, count_reasons, in_the_way
from basenet_jax.task.picking import Reason
from basenet_jax.world.boxes import Boxes, Room

NAMES = ("bench", "lid", "moat", "moat", "shelf", "far", "post")


def room_with(*there):
    """A bench; over it a lid, round it a moat of two strips, behind it a shelf, beside it a post; and a pillar."""
    rows = np.array(
        [
            (0.0, 0.0, 0.4, 0.3, 0.0, 0.75, 1, 1),
            (0.0, 0.0, 0.4, 0.3, 0.9, 1.6, 0, 1),
            (0.0, -1.5, 3.0, 1.2, 0.0, 0.01, 1, 0),
            (0.0, 1.5, 3.0, 1.2, 0.0, 0.01, 1, 0),
            (0.0, 0.6, 0.4, 0.1, 0.0, 2.0, 1, 1),
            (9.0, 9.0, 0.1, 0.1, 0.0, 2.0, 1, 1),
            (0.7, 0.0, 0.1, 0.1, 0.0, 2.0, 1, 1),
        ],
        np.float32,
    )
    used = np.isin(NAMES, there)
    pose = np.column_stack([rows[:, :2], 0.0 * rows[:, 0]]).astype(np.float32)
    blocks = [used & (rows[:, column] > 0) for column in (6, 7)]
    leaves: tuple[Any, ...] = (pose, rows[:, 2:4], rows[:, 4], rows[:, 5], *blocks, np.arange(len(rows)) == 0)
    floor: Any = np.array([-4.0, -4.0, 10.0, 10.0], np.float32)
    return Room(Boxes(*leaves), floor)


@pytest.fixture(scope="module")
def explained(setup, random_scene):
    """(names of what is there) -> the setup and a scene with one object in the middle of the bench."""

    def make(*there):
        scene, room = random_scene(1, 1), room_with("bench", *there)
        fields = {"object_pose": 0.0 * scene.object_pose, "robot_start": np.array([3.5, 0.0, 0.0], np.float32)}
        return setup.with_room(room), dataclasses.replace(scene, room=room, **fields)

    return make


def blamed(case):
    setup, scene = case
    return in_the_way(setup, scene, 0, NAMES)


def test_one_thing_is_named(explained):
    assert blamed(explained("lid", "far")) == InTheWay(("lid",), together=False)


def test_boxes_of_one_name_are_one_thing(explained):
    assert blamed(explained("moat", "post", "shelf")) == InTheWay(("moat",), together=False)


def test_things_that_only_together_let_it_be_picked_are_named_together(explained):
    names, together = blamed(explained("lid", "moat"))
    assert together
    assert {"lid", "moat"} <= set(names)
    assert "far" not in names


def test_what_no_room_lets_be_picked_is_nobodys_fault(explained):
    setup, scene = explained("lid")
    high = dataclasses.replace(scene, surface_height=scene.surface_height + 2.0)
    assert blamed((setup, high)) == InTheWay((), together=False)


def test_poses_are_counted_by_what_rules_them_out(explained):
    free, lidded = (count_reasons(*explained(*there)) for there in ((), ("lid",)))
    assert free[0, Reason.NONE] > 0
    assert free[0, Reason.BASE_COLLIDES] > 0
    assert lidded[0, Reason.NONE] == 0
    assert lidded[0, Reason.ARM_COLLIDES] >= free[0, Reason.NONE]
    assert free.sum() == lidded.sum() == free[0].sum()


def test_poses_to_which_no_way_leads_are_counted_apart(explained):
    setup, scene = explained()
    shut = dataclasses.replace(scene, robot_start=np.array([40.0, 0.0, 0.0], np.float32))  # beyond the floor
    counts = count_reasons(setup, shut)[0]
    assert counts[Reason.NONE] == 0
    assert counts[Reason.UNREACHABLE] == count_reasons(setup, scene)[0, Reason.NONE]
