"""The routing solver that many objects are compared with gets the right problem: on small ones it finds the optimum."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.planners.exact_sequence import best_sequence
from basenet_jax.planners.stop_problem import SizedProblem
from basenet_jax.task.stop_problem import make_problem
from benchmarks.routing import solve


def problem_of(seed, stops=9, objects=5):
    """A problem with random costs; the last two stops only fill up, and there is no way between two others."""
    random = np.random.default_rng(seed)
    place = random.uniform(0, 5, (stops, 2))
    drive = np.linalg.norm(place[:, None] - place, axis=-1).astype(np.float32)
    drive[1, 2] = drive[2, 1] = np.inf
    first = (np.linalg.norm(place, axis=-1) + 3).astype(np.float32)
    pick = random.uniform(9, 12, (stops, objects)).astype(np.float32)
    pick[random.random(pick.shape) < 0.5] = np.inf
    pick[np.arange(objects), np.arange(objects)] = 10.0  # every object has a stop
    pick[-2:], first[-2:] = np.inf, np.inf
    poses, there = np.zeros((stops, 3), np.float32), np.ones(objects, bool)
    problem = make_problem(*map(jnp.array, (poses, drive, pick, first, there)))
    return SizedProblem(problem, np.arange(objects), np.zeros(objects, int))


def cost_of(problem, order, stops):
    pick, first, drive = map(np.asarray, problem.costs)
    legs = [first[stops[0]], *(drive[a, b] for a, b in itertools.pairwise(stops))]
    return sum(legs) + sum(pick[stop, slot] for stop, slot in zip(stops, order, strict=True))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_small_problems_are_solved_to_the_optimum(seed):
    problem = problem_of(seed)
    order, stops = solve(problem, 0.5, seed)
    assert sorted(order) == [0, 1, 2, 3, 4]
    exact = jax.device_get(jax.jit(best_sequence)(*problem.costs))
    assert cost_of(problem, order, stops) == pytest.approx(cost_of(problem, *exact), abs=5e-3)
