"""Planning again what is left of a scene: nothing is compiled, and plans are those of the problem without padding."""

import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.compilation import programs_of_this_thread
from basenet_jax.planners.dp import Dp, plan_exactly
from basenet_jax.planners.refined import Refined
from basenet_jax.planners.stop_problem import Sizes
from tests import compiled

KEY = jax.random.key(0)


def left_of(scene, plan, picked):
    """The scene after some steps of its plan, with the robot where it parked last."""
    mask = np.array(scene.mask)
    mask[np.asarray(plan.object_index)[:picked]] = False
    return dataclasses.replace(scene, mask=mask, robot_start=np.asarray(plan.base_pose)[picked - 1])


@pytest.mark.parametrize("kind", [Dp, Refined])
def test_replanning_after_each_pick_compiles_nothing(setup, random_scene, kind):
    scene = random_scene(5)
    planner = kind(setup)
    first = jax.device_get(planner(scene, KEY))
    assert np.all(first.served)
    before = programs_of_this_thread()
    for picked in range(1, compiled.SLOTS):
        left = left_of(scene, first, picked)
        again = jax.device_get(planner(left, KEY))
        assert sorted(again.object_index[: compiled.SLOTS - picked].tolist()) == np.flatnonzero(left.mask).tolist()
        assert np.all(again.served[: compiled.SLOTS - picked])
    assert programs_of_this_thread() == before


@pytest.mark.parametrize("picked", [1, 3, 5])
def test_what_is_left_is_planned_as_without_padding(setup, random_scene, picked):
    scene, planner = random_scene(5), Dp(setup)
    left = left_of(scene, planner(scene, KEY), picked)
    candidates = compiled.check_candidates(setup.robot, left, setup.grid_poses)
    bare = plan_exactly(setup.robot, setup.drives, left, candidates)
    for found, expected in zip(jax.tree.leaves(planner(left, KEY)), jax.tree.leaves(bare), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_sizes_are_those_of_earlier_problems_where_slots_are_empty():
    sizes, full, some = Sizes(exact_objects=4), np.ones(6, bool), np.arange(6) < 3
    assert sizes.fit(full, 6, 600) == (6, 768)
    assert sizes.fit(some, 3, 500) == (4, 512), "the first of its columns"
    assert sizes.fit(some, 2, 10) == (4, 512)
    assert sizes.fit(some, 4, 513) == (4, 768)
    assert sizes.fit(some, 5, 600) == (6, 768)
    assert sizes.fit(full, 6, 100) == (6, 256), "a whole scene costs what it needs"
    assert sizes.fit(np.ones(3, bool), 2, 100) == (3, 256)
