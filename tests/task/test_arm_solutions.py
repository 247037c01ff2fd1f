"""Solutions from seeds: how they are shared out to rounds must not matter."""

import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.config import PickConfig
from basenet_jax.task.arm_solutions import make_picks, solve
from basenet_jax.world.grasps import top_down

CONFIG = PickConfig(lattice_seeds=16, lattice_kept=4)


@pytest.fixture(scope="module")
def solutions(robot, picks, result):
    """By round size, those of 13 picks that can be done."""
    arm, chosen = robot.replace(closed_form=None), np.flatnonzero(result.feasible)[:13]
    base_pose, grasp = (part[chosen] for part in picks[:2])
    some = make_picks(base_pose, top_down(grasp))

    def solved(size):
        return jax.jit(lambda some: solve(arm, some, dataclasses.replace(CONFIG, lattice_chunk=size)))(some)

    with jax.enable_x64(True):  # in float32 steps from far away multiply rounding, and a seed may end elsewhere
        return {size: jax.device_get(solved(size)) for size in (5, 13)}


@pytest.mark.slow
def test_rounds_do_not_matter(solutions):
    few, all_at_once = solutions[5], solutions[13]
    assert few.estimate.shape == (2 * CONFIG.lattice_kept, 13)
    np.testing.assert_array_equal(np.isfinite(few.estimate), np.isfinite(all_at_once.estimate))
    found = np.isfinite(few.estimate)
    assert 0.1 < np.mean(found) < 1.0
    np.testing.assert_allclose(few.estimate[found], all_at_once.estimate[found], rtol=0, atol=1e-6)
    np.testing.assert_allclose(few.pregrasp[:, found], all_at_once.pregrasp[:, found], rtol=0, atol=1e-6)
