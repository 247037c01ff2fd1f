"""The front door for many scenes."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import basenet_jax as bn
from basenet_jax import api
from basenet_jax.planners import reachability, registry
from tests import compiled
from tests.scene_texts import park_once


@pytest.fixture(scope="module")
def scenes():
    return bn.sample_scenes(jax.random.key(4), count=3, objects=4)


def scene(scenes, index):
    return jax.tree.map(lambda x: x[index], scenes)


def test_scenes_are_drawn_together(scenes):
    assert scenes.mask.shape == (3, 4)
    assert len(np.unique(scenes.robot_start, axis=0)) == 3


def test_a_batch_is_planned_and_judged(scenes):
    plans = bn.plan_batch(scenes, planner="basenet-paper")
    outcomes = bn.execute(scenes, plans)
    assert outcomes.grasped.shape == (3,)
    for index in range(3):
        alone = bn.make_plan(scene(scenes, index), planner="basenet-paper")
        np.testing.assert_array_equal(plans.object_index[index], alone.object_index)
        np.testing.assert_allclose(plans.base_pose[index], alone.base_pose, atol=1e-5)


def test_planners_of_one_scene_plan_one_after_the_other(scenes, monkeypatch):
    keys = []

    def note(one, key):
        keys.append(jax.random.key_data(key))
        return park_once(one, key)

    monkeypatch.setattr(registry, "make_planner", lambda name, setup, options: note)
    api._planner.cache_clear()
    try:
        plans = bn.plan_batch(scenes, planner="dp", key=jax.random.key(8))
    finally:
        api._planner.cache_clear()
    assert plans.object_index.shape == (3, 4)
    np.testing.assert_array_equal(keys, jax.random.key_data(jax.random.split(jax.random.key(8), 3)))


def test_other_robots_plan_and_are_judged_as_themselves(scenes, monkeypatch):
    monkeypatch.setattr(reachability, "check_candidates", compiled.check_candidates)
    plans = bn.plan_batch(scenes, planner="greedy-stops", robot="ur10e_mobile")
    ours = bn.execute(scenes, plans, robot="ur10e_mobile")
    np.testing.assert_array_equal(ours.grasped, 4)
    assert np.all(np.abs(bn.execute(scenes, plans).execution - ours.execution) > 0.1), "judged as another robot"


@pytest.mark.parametrize(("count", "objects", "name"), [(0, 5, "count"), (2, 0, "objects"), (2, 51, "objects")])
def test_numbers_out_of_range_are_refused(count, objects, name):
    with pytest.raises(ValueError, match=f"{name}: found {min(count, objects) if objects < 51 else 51}, allowed are"):
        bn.sample_scenes(jax.random.key(0), count=count, objects=objects)


def test_what_is_no_batch_is_refused(scenes):
    with pytest.raises(ValueError, match=r"found a mask of shape \(4,\)"):
        bn.plan_batch(scene(scenes, 0))
    height = jnp.array([0.75, 0.75, 0.8])
    with pytest.raises(ValueError, match="several tables"):
        bn.plan_batch(dataclasses.replace(scenes, room=bn.Room.of_table(scenes.room.table_half_size, height)))
