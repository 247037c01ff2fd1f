import dataclasses
import itertools

import jax
import numpy as np
import pytest

from basenet_jax.config import GridConfig
from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.dp import MAX_OBJECTS, Dp, plan_exactly
from basenet_jax.planners.protocol import PlanningError
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Plan
from tests import compiled
from tests.regrasp import regrasp

judge, check_candidates = compiled.execute, compiled.check_candidates


@pytest.fixture(scope="module")
def setup(robot):
    """A coarse grid, so that few poses are left to enumerate."""
    return compiled.make_setup(robot, grid=GridConfig(step_m=0.45, turns=4))


@pytest.fixture(scope="module")
def scenes(room):
    """Of three objects, in three slots."""
    drawn = (compiled.draw_scene(seed, 3, room, slots=3) for seed in (0, 1, 2))
    return jax.tree.map(lambda *x: np.stack(x), *drawn)


def one_of(scenes, index):
    return jax.tree.map(lambda x: x[index], scenes)


def every_plan(candidates, slots):
    """All plans that pick every object from candidate poses, as one batch."""
    serves, poses = np.asarray(candidates.serves), np.asarray(candidates.base_pose)
    options = [np.flatnonzero(serves[:, slot]) for slot in range(slots)]
    order, stops = [], []
    for permutation in itertools.permutations(range(slots)):
        for choice in itertools.product(*(options[slot] for slot in permutation)):
            order.append(permutation)
            stops.append(poses[list(choice)])
    count = len(order)
    leaves = (np.array(order), np.array(stops), np.ones((count, slots), bool), np.zeros((count, slots), int))
    return Plan(*leaves)  # pyright: ignore[reportArgumentType]


def test_no_plan_is_judged_cheaper(setup, scenes):
    scene = one_of(scenes, 0)
    candidates = check_candidates(setup.robot, scene, setup.grid_poses)
    serving = np.flatnonzero(np.any(candidates.serves, axis=1))
    kept = np.unique(np.concatenate([np.flatnonzero(candidates.serves[:, slot])[:3] for slot in range(3)]))
    assert len(serving) >= len(kept) > 0
    few = Candidates(candidates.base_pose[kept], candidates.serves[kept], candidates.pick_time[kept], candidates.reason)
    plan = plan_exactly(setup.robot, setup.drives, scene, few)
    plans = every_plan(few, 3)
    batch = jax.tree.map(lambda x: np.broadcast_to(x, (len(plans.served), *x.shape)), scene)
    outcomes = judge(setup.robot, batch, plans)
    best = float(np.min(np.where(outcomes.grasped == 3, outcomes.execution, np.inf)))
    outcome = judge(setup.robot, scene, plan)
    assert int(outcome.grasped) == 3
    assert float(outcome.execution) == pytest.approx(best, abs=1e-3)


def test_its_costs_are_the_judges(setup, scenes):
    scene = one_of(scenes, 0)
    candidates = check_candidates(setup.robot, scene, setup.grid_poses)
    plan = Dp(setup)(scene, jax.random.key(0))
    outcome = judge(setup.robot, scene, plan)
    for step in range(3):
        pose = np.flatnonzero((np.asarray(candidates.base_pose) == np.asarray(plan.base_pose[step])).all(axis=1))
        assert float(outcome.pick_time[step]) == pytest.approx(
            float(candidates.pick_time[pose[0], int(plan.object_index[step])]), abs=1e-4
        )


def test_an_object_out_of_reach_comes_last_with_its_reason(setup, scenes):
    scene = one_of(scenes, 1)
    high = regrasp(scene, lambda pose: pose[1, :, 2].fill(2.0))
    plan = Dp(setup)(high, jax.random.key(0))
    assert int(plan.object_index[2]) == 1
    assert np.asarray(plan.served).tolist() == [True, True, False]
    assert int(plan.reason[2]) == Reason.OUT_OF_REACH


def test_nothing_in_reach_gives_a_plan_without_stops(setup, scenes):
    scene = one_of(scenes, 2)
    plan = Dp(setup)(regrasp(scene, lambda pose: pose[..., 2].fill(2.5)), jax.random.key(0))
    assert not np.any(plan.served)
    assert sorted(np.asarray(plan.object_index)) == [0, 1, 2]


def test_empty_slots_change_nothing(setup, scenes):
    scene = one_of(scenes, 0)
    plan, wide = (Dp(setup)(each, jax.random.key(0)) for each in (scene, compiled.with_slots(scene, 5)))
    np.testing.assert_array_equal(plan.base_pose, wide.base_pose[:3])
    np.testing.assert_array_equal(plan.object_index, wide.object_index[:3])
    assert np.asarray(wide.object_index[3:]).tolist() == [-1, -1]


def test_too_many_objects_are_refused_with_what_else_to_use(setup, room):
    count = MAX_OBJECTS + 1
    scene = compiled.with_slots(compiled.draw_scene(0, 3, room), count)
    scene = dataclasses.replace(scene, mask=np.ones(count, bool))
    with pytest.raises(PlanningError, match=f"objects: found {count}.*basenet"):
        Dp(setup)(scene, jax.random.key(0))
