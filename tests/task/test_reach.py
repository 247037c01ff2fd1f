"""The arm-solution search finds what there is, on random top-down targets, with and without the closed form.

What there is, is known from the closed form in float64 (itself compared with other libraries in the robot's tests):
a pick is reachable if some branch reaches grasp and pre-grasp, and provably not if every branch misses one of them by
more than the tolerances allow.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.config import PickConfig
from basenet_jax.robot import ur
from basenet_jax.task import arm_solutions
from basenet_jax.task.picking import Reason
from basenet_jax.world.grasps import top_down
from tests import compiled

CONFIG = PickConfig()

# A solution may be off by 1 mm, and float32 knows the arm's lengths to 2e-6 m. The closed form keeps the orientation;
# damped least squares may also use the allowed 0.5 degrees, which shift the wrist's links (0.2 m with the tool) by
# 1.7 mm.
SHELL = {"ur": 1e-3 + 5e-6, None: 1e-3 + 1.8e-3}


def random_picks(count):
    """Tool positions in a cylinder of radius 1.1 m about the arm, from knee to head height, from any base pose."""
    rng = np.random.default_rng(12)
    base = rng.uniform([-2.0, -1.5, -np.pi], [2.0, 1.5, np.pi], size=(count, 3))
    bearing, distance = rng.uniform(-np.pi, np.pi, count), 1.1 * np.sqrt(rng.uniform(0.0, 1.0, count))
    x, y = distance * np.cos(bearing) - 0.299, distance * np.sin(bearing) - 0.158
    cosine, sine = np.cos(base[:, 2]), np.sin(base[:, 2])
    where = [base[:, 0] + cosine * x - sine * y, base[:, 1] + sine * x + cosine * y, rng.uniform(0.4, 1.7, count)]
    return base.astype(np.float32), np.column_stack([*where, rng.uniform(-np.pi, np.pi, count)]).astype(np.float32)


def shortfall(robot, base, grasp):
    """By how much (m) the best branch misses the worse of grasp and pre-grasp, in float64."""

    def best(base, grasp):
        picks = arm_solutions.make_picks(base, top_down(grasp)).by(jnp.zeros(len(base), int))
        ends = [
            ur.closed_form(robot, arm_solutions.tool_target(robot, picks, height, 0.0), ur.all_branches(1)).shortfall
            for height in (CONFIG.pregrasp_height_m, 0.0)
        ]
        return jnp.min(jnp.maximum(*ends), axis=(0, 1, 2))

    with jax.enable_x64(True):
        return np.asarray(jax.jit(best)(base.astype(float), grasp.astype(float)))


def found(robot, room, base, grasp):
    """Whether the search finds a solution that reaches: all 4 m away from the table, where the base hits nothing."""
    away = np.array([0.0, 4.0, 0.0], np.float32)
    return compiled.pick(robot, base + away, grasp + np.append(away, np.float32(0)), room).reason != Reason.OUT_OF_REACH


def check(robot, room, count):
    """Of so many random picks (about half of them reachable)."""
    base, grasp = random_picks(count)
    missing = shortfall(robot, base, grasp)
    reachable, hopeless = missing == 0.0, missing > SHELL[robot.closed_form]
    assert min(reachable.mean(), hopeless.mean()) > 0.2
    solved = found(robot, room, base, grasp)
    assert solved[reachable].mean() >= 0.999
    assert not solved[hopeless].any()
    return int(reachable.sum())


def test_closed_form_finds_what_there_is(robot, room):
    check(robot, room, 2000)


def test_lattice_finds_what_there_is(robot, room):
    check(robot.replace(closed_form=None), room, 500)


@pytest.mark.slow
def test_closed_form_finds_what_there_is_on_100_000_targets(robot, room):
    assert check(robot, room, 200_000) >= 100_000


@pytest.mark.slow
def test_lattice_finds_what_there_is_on_4_000_targets(robot, room):
    """Fewer: 64 seeds, two turns and 50 iterations each make a thousand times the work."""
    assert check(robot.replace(closed_form=None), room, 8_000) >= 4_000
