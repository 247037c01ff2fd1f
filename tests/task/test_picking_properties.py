"""Symmetries of picks, independence of the batch, and tracing."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.task.picking import Reason, pick
from basenet_jax.world.grasps import top_down
from tests.task.pick_cases import FLOAT32_BOUND, Cases, cases, decided_by_rounding, judge


def moved(picks: Cases, base_pose, grasp) -> Cases:
    """The picks with other base poses and grasps, rounded to float32."""
    return cases(base_pose, grasp, picks.height)


@pytest.mark.parametrize(
    "image",
    [
        pytest.param(
            lambda p: moved(p, p.base_pose * [-1, -1, 1] + [0, 0, np.pi], p.grasp * [-1, -1, 1, 1] + [0, 0, 0, np.pi]),
            id="all turned by half a turn",
        ),
        pytest.param(lambda p: moved(p, p.base_pose, p.grasp + np.array([0, 0, 0, np.pi])), id="gripper turned"),
        pytest.param(lambda p: moved(p, p.base_pose, p.grasp + np.array([0, 0, 0, 2 * np.pi])), id="yaw a turn more"),
        pytest.param(lambda p: moved(p, p.base_pose - np.array([0, 0, 2 * np.pi]), p.grasp), id="heading a turn less"),
    ],
)
def test_symmetries(robot, picks, result, image):
    # Not among them: mirror images, which the arm's sideways elbow and the mount's corner rule out.
    other = judge(robot, image(picks))
    differs = (other.reason != result.reason) | (np.abs(other.time - result.time) > FLOAT32_BOUND)
    assert all(decided_by_rounding(picks, index) for index in np.flatnonzero(differs))
    assert np.mean(differs) <= 0.02


def test_neighbours_in_the_batch_do_not_matter(robot, picks, result):
    order = np.random.default_rng(5).permutation(len(picks.grasp))
    shuffled = judge(robot, Cases(*(part[order] for part in picks)))
    np.testing.assert_array_equal(shuffled.reason, result.reason[order])
    # Loops handle a batch's last elements by other instructions: equal but for rounding.
    np.testing.assert_allclose(shuffled.time, result.time[order], rtol=0, atol=FLOAT32_BOUND)
    np.testing.assert_allclose(shuffled.joints, result.joints[order], rtol=0, atol=FLOAT32_BOUND)
    alone = judge(robot, Cases(*(part[np.flatnonzero(result.feasible)[:1]] for part in picks)))
    np.testing.assert_allclose(alone.time, result.time[result.feasible][:1], rtol=0, atol=FLOAT32_BOUND)


def test_a_batch_of_nothing_feasible(robot, picks, result):
    rows = np.flatnonzero(result.reason == Reason.BASE_COLLIDES)
    assert not np.any(judge(robot, Cases(*(part[rows] for part in picks))).feasible)


def test_shapes_broadcast_and_tracing_is_once(robot, room, picks):
    chex.clear_trace_counter()
    traced = jax.jit(chex.assert_max_traces(pick, n=1))
    for first in (0, 6):
        base_pose, grasp = (jnp.asarray(part[first : first + 6], jnp.float32) for part in picks[:2])
        lowered = traced.lower(robot, base_pose.reshape(2, 1, 3, 3), top_down(grasp[:4, None]), room)
    shapes = jax.tree.map(lambda x: x.shape, lowered.out_info)
    assert (shapes.feasible, shapes.reason, shapes.time) == ((2, 4, 3),) * 3
    assert shapes.joints == (2, 4, 3, 5, 6)
