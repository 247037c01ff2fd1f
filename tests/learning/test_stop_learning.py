"""The stop learner on a tiny library: its problems, imitation, reinforcement, one trace."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import AlignedConfig
from basenet_jax.learning.stop_learning import StopLearning, StopLearningConfig, advantages, draw_many
from basenet_jax.learning.stop_problems import draw_problem, half_turn_of, problem_of, turned_draw
from basenet_jax.policies.stop_policy import access_time
from basenet_jax.policies.stop_rollout import END, choose_best, plans_of, play

TINY = StopLearningConfig(
    objects=4,
    features=8,
    layers=1,
    library_objects=32,
    examples=16,
    search_iterations=40,
    imitation_intervals=1,
    imitations_per_update=16,
    problems_per_update=4,
    samples=4,
    updates_per_interval=3,
    intervals=2,
    learning_rate=5e-3,
    evaluation_problems=16,
)


@pytest.fixture(scope="module")
def learner(robot):
    return StopLearning(robot, TINY, aligned=AlignedConfig(step_m=0.4))


@pytest.fixture(scope="module")
def begun(learner):
    """The first state."""
    return jax.jit(learner.init)(jax.random.key(0))


@pytest.fixture(scope="module")
def examples(learner, begun):
    return jax.jit(problem_of)(learner.prepared, begun.library, begun.examples)


def test_drawn_objects_do_not_overlap(begun):
    library, slots = begun.library, 8
    draw = jax.jit(lambda key, count: draw_problem(key, library, count, slots))
    for seed, count in enumerate((1, 3, 8)):
        objects = np.asarray(draw(jax.random.key(seed), count).objects)
        chosen = objects[objects >= 0]
        assert len(chosen) == count
        assert np.all(objects[count:] == -1)
        position, radius = np.asarray(library.position)[chosen], np.asarray(library.radius)[chosen]
        gap = np.linalg.norm(position[:, None] - position, axis=-1) - radius[:, None] - radius
        assert np.all(gap[~np.eye(count, dtype=bool)] >= 0)


def test_problems_hold_what_the_library_does(learner, begun, examples):
    library, objects = begun.library, np.asarray(begun.examples.objects)
    assert set(np.sum(objects >= 0, axis=1)) == {1, 2, 3, 4}
    access = jax.jit(jax.vmap(access_time, in_axes=(None, 0)))(learner.prepared.drive, examples.problem.pick_time)
    for e, slot in zip(*np.nonzero(examples.problem.mask), strict=True):
        np.testing.assert_array_equal(examples.grasps[e, slot], library.grasps[objects[e, slot]])
        np.testing.assert_array_equal(examples.problem.pick_time[e, :, slot], library.pick_time[objects[e, slot]])
        np.testing.assert_allclose(examples.access[e, :, slot], access[e, :, slot], atol=1e-2)


def test_turning_a_problem_turns_its_plans(learner, begun, examples):
    """The turned stops cost the same in the turned problem, up to rounding of turns that vanish."""
    turned = problem_of(learner.prepared, begun.library, turned_draw(begun.examples, begun.library))
    answers = jnp.where(begun.answers == END, END, jnp.asarray(learner.half_turn)[begun.answers])
    cost = plans_of(examples.problem, begun.answers).cost
    assert np.all(np.isfinite(cost))
    np.testing.assert_allclose(plans_of(turned.problem, answers).cost, cost, atol=0.05)


def test_stops_that_are_not_symmetric_are_refused():
    with pytest.raises(ValueError, match="must be symmetric about the table"):
        half_turn_of(np.array([[1.0, 0.0, 0.0], [-1.0, 0.1, np.pi]]))


def test_searched_answers_are_no_worse_than_the_rules(learner, begun, examples):
    rule = play(learner.policy, begun.params, examples, choose_best)
    searched = plans_of(examples.problem, begun.answers).cost
    assert float(jnp.mean(searched)) <= float(jnp.mean(plans_of(examples.problem, rule).cost))


def test_imitation_lowers_the_loss(robot, begun):
    learner = StopLearning(robot, dataclasses.replace(TINY, intervals=40), aligned=AlignedConfig(step_m=0.4))
    step = jax.jit(lambda state: learner._update(state, learner.imitation))
    state, losses = begun, []
    for _ in range(60):
        state, metrics = step(state)
        losses.append(float(metrics["loss"]))
    assert np.mean(losses[-10:]) < 0.7 * np.mean(losses[:5])


def test_advantages_leave_the_own_cost_out():
    cost = jnp.array([3.0, 5.0, 10.0, 1.0, 1.0, 4.0])
    expected = [3 - 7.5, 5 - 6.5, 10 - 4, 1 - 2.5, 1 - 2.5, 4 - 1]
    np.testing.assert_allclose(advantages(cost, 3), expected, atol=1e-6)


def test_one_interval_is_reproducible_and_traced_once(learner, begun):
    """The first interval imitates, the second reinforces; one program does both."""
    chex.clear_trace_counter()
    interval = jax.jit(chex.assert_max_traces(learner.interval, n=1))
    first, metrics = interval(begun)
    again, same = interval(begun)
    chex.assert_trees_all_equal(first.params, again.params)
    chex.assert_trees_all_equal(metrics, same)
    second, later = interval(first)
    assert (float(metrics["imitates"]), float(later["imitates"])) == (1.0, 0.0)
    assert int(second.update) == 2 * TINY.updates_per_interval
    assert not np.array_equal(jax.random.key_data(second.key), jax.random.key_data(first.key))
    chex.assert_tree_all_finite((second.params, metrics, later))


def test_batches_have_all_numbers_of_objects(begun):
    draws = jax.jit(lambda key: draw_many(key, begun.library, 64, 4))(jax.random.key(3))
    assert set(np.sum(np.asarray(draws.objects) >= 0, axis=1)) == {1, 2, 3, 4}
