"""Planners are run, timed and judged on every scene, and what they refuse or get wrong is said."""

import dataclasses
import gc
import io
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.evaluation.planning import Planners, own_options, plan_all
from basenet_jax.evaluation.scene_sets import SceneSet, random_set
from basenet_jax.evaluation.table import compare
from basenet_jax.planners import protocol
from basenet_jax.planners.registry import PLANNERS
from basenet_jax.progress import PlainReporter
from basenet_jax.world.boxes import Room
from tests import judged
from tests.evaluation.fake_planners import FAKES, Double, Fixed


@pytest.fixture(scope="module")
def scenes(batch):
    return SceneSet(("a", "b", "c"), batch)


@pytest.fixture(scope="module")
def progress():
    return io.StringIO()


@pytest.fixture(scope="module")
def rows(setup, scenes, progress):
    return compare(Planners(FAKES, setup), [scenes], repeats=2, seed=0, reporter=PlainReporter(progress))


def test_there_is_a_row_for_every_planner_in_order(rows):
    assert [(row.planner, row.objects, row.labels) for row in rows] == [(name, 2, ("a", "b", "c")) for name in FAKES]


def test_figures_are_those_of_the_judge(rows, outcomes):
    scores = rows[0].scores
    np.testing.assert_array_equal(scores.grasped, [2, 2, 2])
    # The first and the third plan of `judged` are those of `Fixed`; the second picks in another order.
    for scene in (0, 2):
        assert scores.navigation_s[scene] == pytest.approx(float(outcomes.navigation[scene]), abs=1e-3)
        assert scores.grasping_s[scene] == pytest.approx(float(outcomes.picking[scene]), abs=1e-3)
    np.testing.assert_allclose(scores.execution_s, scores.navigation_s + scores.grasping_s)
    np.testing.assert_allclose(scores.total_s, scores.planning_s + scores.execution_s)
    np.testing.assert_array_equal(scores.disagreements, 0)
    assert scores.reasons == ({}, {}, {})


def test_what_is_not_grasped_is_counted_by_reason(rows):
    scores = rows[1].scores
    np.testing.assert_array_equal(scores.grasped, [1, 1, 1])
    assert scores.reasons == ({"out_of_reach": 1},) * 3
    assert np.all(scores.navigation_s > rows[0].scores.navigation_s)


def test_a_refusal_is_a_row_and_a_line_of_progress(rows, progress):
    message = "scene a: objects: found 2, picky plans at most 1; use fixed"
    assert (rows[2].scores, rows[2].refused) == (None, message)
    assert f"2 objects, picky: refused: {message}" in progress.getvalue()
    assert rows[3].scores is not None, "the others go on"


def test_progress_tells_of_every_planner(progress):
    assert all(f"2 objects, {name}: 3/3 (100 %)" in progress.getvalue() for name in ("fixed", "lazy", "dp"))


def test_a_disagreement_with_mujoco_is_counted_and_not_grasped(setup, scenes, monkeypatch):
    from basenet_jax.evaluation import table

    def find_fault(robot, scenes, plans, outcomes, config):
        broken = np.zeros(outcomes.feasible.shape, int)
        broken[1, 0] = 4
        return broken

    monkeypatch.setattr(table, "replay", find_fault)
    rows = compare(Planners(FAKES, setup), [scenes], repeats=1, seed=0, reporter=PlainReporter(io.StringIO()))
    row: Any = rows[0]
    np.testing.assert_array_equal(row.scores.disagreements, [0, 1, 0])
    np.testing.assert_array_equal(row.scores.grasped, [2, 1, 2])
    assert row.scores.reasons == ({}, {"arm_collides": 1}, {})


def test_a_plan_that_picks_an_object_twice_is_an_error(setup, scenes):
    planners = Planners({"double": Double}, setup)
    with pytest.raises(RuntimeError, match=r"double, scene a: found steps for the slots \[0, 0\]"):
        plan_all(planners, "double", scenes, repeats=1, seed=0, reporter=PlainReporter(io.StringIO()))


def test_calls_are_counted_and_timed_without_garbage_collection(setup, scenes):
    enabled, keys = [], []

    class Watched(Fixed):
        def __call__(self, scene, key):
            enabled.append(gc.isenabled())
            keys.append(tuple(jax.random.key_data(key).tolist()))
            return super().__call__(scene, key)

    planned = plan_all(
        Planners({"watched": Watched}, setup),
        "watched",
        scenes,
        repeats=3,
        seed=7,
        reporter=PlainReporter(io.StringIO()),
    )
    assert enabled == [False] * 3 * (1 + 3)
    assert gc.isenabled()
    assert len(set(keys)) == 3, "each scene has a key of its own, the same for all calls"
    assert np.all(planned.planning_s > 0)
    assert np.all(planned.compile_s >= 0)


def test_scenes_beyond_the_timed_ones_are_planned_once_and_together_where_the_planner_can(setup, scenes):
    calls = []

    class Counted(Fixed):
        def __call__(self, scene, key):
            calls.append(1)
            return super().__call__(scene, key)

    class Many(Counted):
        def plan_batch(self, scenes, key):
            calls.append(len(scenes.mask))
            return protocol.plan_batch(Fixed(self.setup), scenes, key)

    def plan(planner, timed):
        calls.clear()
        reporter = PlainReporter(io.StringIO())
        planned = plan_all(
            Planners({"it": planner}, setup), "it", scenes, repeats=1, seed=7, reporter=reporter, timed=timed
        )
        return planned, sum(calls)

    (every, n_every), (alone, n_alone), (together, n_together) = plan(Many, 3), plan(Counted, 2), plan(Many, 2)
    assert (n_every, n_alone, n_together) == (2 * 3, 2 * 2 + 1, 2 * 2 + 3)
    assert not np.any(np.isnan(every.planning_s))
    for some in (alone, together):
        jax.tree.map(np.testing.assert_array_equal, some.plans, every.plans)
        np.testing.assert_array_equal(np.isnan(some.planning_s), [False, False, True])
        np.testing.assert_array_equal(np.isnan(some.compile_s), [False, False, True])


def test_every_table_has_its_own_planner(setup, batch):
    heights = jnp.array([0.75, 0.6, 0.75])
    scenes = SceneSet(
        ("a", "b", "c"), dataclasses.replace(batch, room=Room.of_table(batch.room.table_half_size, heights))
    )
    planners = Planners({"fixed": Fixed}, setup)
    made: list[Any] = [planners.get("fixed", scenes.scene(index).room) for index in range(3)]
    assert made[0] is made[2]
    assert made[0] is not made[1]
    assert float(made[1].setup.room.table_height) == pytest.approx(0.6)


def test_all_planners_or_those_named():
    assert tuple(own_options(("all",), {})) == tuple(PLANNERS)
    assert tuple(own_options(("dp", "basenet", "dp"), {})) == ("dp", "basenet")
    with pytest.raises(ValueError, match="--planners: found 'best', allowed are all, pbg, pbg-gc"):
        own_options(("dp", "best"), {})


def test_random_sets_depend_on_seed_and_number_of_objects_alone():
    first, second, other = (random_set(2, 3, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.scenes.object_pose, second.scenes.object_pose)
    assert not np.array_equal(first.scenes.object_pose, other.scenes.object_pose)
    assert (first.objects, len(first), first.labels) == (2, 3, ("0", "1", "2"))
    assert judged.first(first.scenes).mask.all()
