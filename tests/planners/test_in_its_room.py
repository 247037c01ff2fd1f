"""Planners refuse other rooms than their own, and robots that can't rest beside it."""

import dataclasses
import re

import jax
import numpy as np
import pytest

from basenet_jax.planners.in_its_room import hold_to
from basenet_jax.planners.protocol import BatchPlanner, PlannerSetup, PreparedPlanner, plan_batch
from basenet_jax.planners.registry import make_planner
from basenet_jax.robot.reading import load_robot
from basenet_jax.world.boxes import Room
from tests.scene_texts import park_once

KEY = jax.random.key(0)
OTHER = re.escape(
    "room: found a table of 2.000 x 0.800 m, 0.900 m high, allowed is the planner's, a table of 2.000 x 0.800 m, 0.75"
)


class Ready:
    """Plans one scene, and has something to prepare."""

    def __call__(self, scene, key):
        return park_once(scene, key)

    def preparations(self, scene):
        return [lambda: None] * len(scene.mask)


class Together(Ready):
    """Plans batches too."""

    def plan_batch(self, scenes, key):
        return jax.tree.map(lambda x: np.stack([x] * len(scenes.mask)), park_once(on_row(scenes, 0), key))


def on_row(scenes, row):
    return jax.tree.map(lambda x: x[row], scenes)


def in_other_room(scene):
    return dataclasses.replace(scene, room=Room.of_table(scene.room.table_half_size, np.float32(0.9), np))


def stacked(*scenes):
    return jax.tree.map(lambda *x: np.stack(x), *scenes)


@pytest.mark.parametrize("name", ["dp", "greedy-stops", "basenet", "basenet-paper"])
def test_planners_of_a_name_refuse_another_room_by_name(setup, four_objects, name):
    planner = make_planner(name, setup)
    with pytest.raises(ValueError, match=OTHER):
        planner(in_other_room(four_objects), KEY)
    with pytest.raises(ValueError, match=OTHER):
        plan_batch(planner, stacked(in_other_room(four_objects), four_objects), KEY)


def test_one_scene_of_a_batch_on_another_room_is_enough(setup, four_objects):
    planner = hold_to(setup, Together())
    assert isinstance(planner, BatchPlanner)
    assert len(planner.plan_batch(stacked(four_objects, four_objects), KEY).served) == 2
    with pytest.raises(ValueError, match=r"room: found a table of .*, allowed is the planner's"):
        planner.plan_batch(stacked(four_objects, in_other_room(four_objects)), KEY)


@pytest.mark.parametrize(
    ("inner", "together", "prepared"), [(park_once, False, 0), (Ready(), False, 6), (Together(), True, 6)]
)
def test_a_planner_keeps_what_it_can(setup, four_objects, inner, together, prepared):
    planner = hold_to(setup, inner)
    assert isinstance(planner, BatchPlanner) == together
    assert isinstance(planner, PreparedPlanner)
    assert len(planner.preparations(four_objects)) == prepared
    np.testing.assert_array_equal(planner(four_objects, KEY).served, four_objects.mask)


def test_a_table_that_a_resting_arm_may_touch_is_refused_with_the_robots_name():
    high = PlannerSetup(
        robot=load_robot("panda_mobile"), room=Room.of_table(np.ones(2, np.float32), np.float32(1.5), np)
    )
    message = (
        r"^robot panda_mobile: home_degrees: found at home \(joint1 20, .* 0\.120 m beyond the footprint below a tab"
    )
    with pytest.raises(ValueError, match=message):
        make_planner("dp", high)


def test_a_robot_whose_arm_rests_in_its_body_is_refused_by_name(setup, robot):
    low = dataclasses.replace(robot, stow=np.radians([0.0, 60.0, 60.0, 0.0, 0.0, 0.0]))
    with pytest.raises(
        ValueError, match=r"^robot ur5e_mobile: stow_degrees: found at stow .* touches the robot's body"
    ):
        make_planner("dp", dataclasses.replace(setup, robot=low))
