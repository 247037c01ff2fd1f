import dataclasses
from typing import Any

import numpy as np
import pytest

from basenet_jax.task.picking import Reason
from basenet_jax.viewer import asking, furnishing
from basenet_jax.viewer.asking import ask
from basenet_jax.viewer.editing import add_object
from tests.oracles.picking import pick
from tests.regrasp import regrasp


def test_the_heading_is_taken_from_which_most_can_be_picked_soonest(scene):
    """Both objects can be picked from there, with several headings: times are the oracle's, and the least."""
    answer = ask(scene, (0.35, -0.9))
    assert answer.base_pose[:2] == pytest.approx([0.35, -0.9])
    assert answer.reasons == (Reason.NONE, Reason.NONE)
    grasps = np.asarray(scene.arrays.first_grasp[:2], float)
    headings = np.arange(8) * np.pi / 4
    picks = [[pick((*answer.base_pose[:2], heading), grasp) for grasp in grasps] for heading in headings]
    feasible = np.array([all(each.reason is None for each in both) for both in picks])
    totals = np.where(feasible, [sum(each.time for each in both) for both in picks], np.inf)
    best = int(np.argmin(totals))
    assert feasible.sum() > 1
    assert answer.base_pose[2] == pytest.approx(headings[best])
    assert list(answer.times) == pytest.approx([each.time for each in picks[best]], abs=5e-3)


def test_far_away_nothing_is_in_reach(scene):
    answer = ask(scene, (3.0, 3.0))
    assert (answer.count, answer.times) == (0, (None, None))
    assert answer.reasons == (Reason.OUT_OF_REACH, Reason.OUT_OF_REACH)
    assert not answer.collides


def test_at_the_table_there_is_no_room(scene):
    assert ask(scene, (0.0, -0.45)).collides


def test_where_one_heading_collides_and_nothing_can_be_picked_the_others_are_heard(scene):
    """Beside the table's short end the base has room lengthwise, not crosswise."""

    def raise_all(pose: np.ndarray) -> None:
        pose[..., 2] += 5.0  # m: higher than any arm reaches

    high = dataclasses.replace(scene, arrays=regrasp(scene.arrays, raise_all))
    answer = ask(high, (1.4, 0.0))
    assert pick((1.4, 0.0, 0.0), np.asarray(high.arrays.first_grasp[0], float)).reason == "base_collides"
    assert (answer.count, answer.collides) == (0, False)
    assert answer.reasons == (Reason.OUT_OF_REACH, Reason.OUT_OF_REACH)
    shown = pick(tuple(answer.base_pose), np.asarray(high.arrays.first_grasp[0], float))
    assert shown.reason == "out_of_reach", "the pose that is drawn collides"


def test_in_rooms_it_is_said_which_box_is_in_the_way(room):
    """The bench, the pillar, the floor's end; the lamp hangs over where the mug is reached for."""
    assert ask(room, (2.0, 3.0)).at_base == ("bench",)
    assert ask(room, (4.0, 3.0)).at_base == ("pillar",)
    assert not ask(room, (0.1, 5.9)).on_floor
    free = ask(room, (2.75, 3.3))
    assert (free.times[0] is not None, free.way, free.in_the_way) == (True, True, {})
    lamp = furnishing.pieces(room.furniture)["lamp"].boxes.start
    low = np.array(room.arrays.room.boxes.low)
    low[lamp] = 0.9
    boxes = dataclasses.replace(
        room.arrays.room.boxes,
        low=low,
        half_size=np.where(np.arange(16)[:, None] == lamp, 0.9, room.arrays.room.boxes.half_size),
    )
    lamp_low = dataclasses.replace(
        room, arrays=dataclasses.replace(room.arrays, room=dataclasses.replace(room.arrays.room, boxes=boxes))
    )
    hindered = ask(lamp_low, (2.75, 3.3))
    assert (hindered.times[0], hindered.reasons[0]) == (None, Reason.ARM_COLLIDES)
    assert "lamp" in hindered.in_the_way["mug_1"]


def test_another_scene_with_as_many_slots_compiles_nothing(scene):
    program: Any = asking._pick_all
    ask(scene, (0.35, -0.9))
    before = program._cache_size()
    assert len(ask(add_object(scene, "bowl"), (0.2, -0.8)).names) == 3
    assert program._cache_size() == before
