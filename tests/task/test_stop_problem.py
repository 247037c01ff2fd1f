"""Which objects of a problem can be had, and why the others can't."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from basenet_jax.task.clutter import Clutter, as_bits
from basenet_jax.task.picking import Reason
from basenet_jax.task.stop_problem import make_problem

NEVER = np.inf
POSES, DRIVE = np.zeros((3, 3)), np.zeros((3, 3))
FIRST = np.array([2.0, 3.0, NEVER])
PICKS = np.array([[9.0, NEVER, NEVER, 9.0], [NEVER, NEVER, NEVER, 9.0], [9.0, NEVER, 9.0, 9.0]])
THERE = np.array([True, True, True, False])
WHY = np.array([Reason.NONE, Reason.ARM_COLLIDES, Reason.NONE, Reason.OUT_OF_REACH])
EXPECTED = [Reason.NONE, Reason.ARM_COLLIDES, Reason.UNREACHABLE, Reason.NONE]


def test_an_object_that_cannot_be_had_has_its_reason():
    problem = make_problem(POSES, DRIVE, PICKS, FIRST, THERE, WHY, np)
    np.testing.assert_array_equal(problem.mask, [True, False, False, False])
    np.testing.assert_array_equal(problem.reason, EXPECTED)


def test_a_batch_is_each_scene_alone():
    pick, first = np.stack([PICKS, PICKS[::-1]]), np.stack([FIRST, FIRST + 1.0])
    batch = make_problem(*map(jnp.asarray, (POSES, DRIVE, pick, first, np.stack([THERE] * 2), np.stack([WHY] * 2))))
    for row in range(2):
        alone = make_problem(POSES, DRIVE, pick[row], first[row], THERE, WHY, np)
        np.testing.assert_array_equal(batch.mask[row], alone.mask)
        np.testing.assert_array_equal(batch.reason[row], alone.reason)


def test_what_stands_in_the_way_for_ever_is_the_reason():
    """Object 0 is had; 1 waits for it; 2 stands behind 3, which no stop serves; 4 is served by a stop without a way."""
    time = np.full((2, 5, 1), NEVER)
    time[0, :3, 0], time[1, 4, 0] = (9.0, 10.0, 11.0), 9.0
    blockers = np.zeros((2, 5, 1, 5), bool)
    blockers[0, 1, 0, 0] = blockers[0, 2, 0, 3] = True
    why = np.full(5, int(Reason.ARM_COLLIDES))
    arrays: tuple[Any, ...] = (time, as_bits(blockers, np))
    clutter, first = Clutter(*arrays), np.array([2.0, NEVER])
    for numpy in (np, jnp):
        problem = make_problem(
            POSES[:2], DRIVE[:2, :2], time.min(axis=-1), first, np.ones(5, bool), why, numpy, clutter=clutter
        )
        np.testing.assert_array_equal(problem.mask, [True, True, False, False, False])
        expected = [Reason.NONE, Reason.NONE, Reason.OBJECT_IN_THE_WAY, Reason.ARM_COLLIDES, Reason.UNREACHABLE]
        np.testing.assert_array_equal(problem.reason, expected)
        assert np.all(np.isinf(problem.pick_time[:, 2]))
        at_first = problem.times_among(np.ones(5, bool))
        np.testing.assert_array_equal(np.isfinite(at_first[0]), [True, False, False, False, False])
