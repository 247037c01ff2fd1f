"""Pairs of base poses to navigate between, and the package's times for them."""

import numpy as np

from basenet_jax.config import NavigationConfig
from tests import compiled
from tests.oracles import navigation as oracle

# In float32 a direction is known to about 5e-7 rad: coordinates of 3 m are rounded by 1.2e-7 m, the arctangent errs by
# 4e-7 rad. T's slope at 0 is infinite, so a turn of 0 may be timed as one of 5e-7 rad, 2 sqrt(5e-7) = 1.4e-3 s, and a
# way has up to four turns. In float64 the same reasoning with 1e-15 rad gives 2.5e-7 s.
FLOAT32_BOUND, FLOAT64_BOUND = 6e-3, 3e-7
ROUNDING = 1e-6  # m: a way that passes the grown table this near may be decided either way in float32
HALF = np.array([1.0, 0.4])

PAIRS = 2000


def navigate(robot, room, starts, goals, config=NavigationConfig()):
    """Times of pairs."""
    return compiled.navigation_time(robot, np.atleast_2d(starts), np.atleast_2d(goals), room, config)


def rounded(poses):
    """Poses as float32 has them, so that both sides see the same numbers."""
    return np.asarray(poses, np.float32).astype(float)


def free_poses(rng, count):
    """Uniform poses outside the grown table."""
    poses = rng.uniform((-3.2, -3.2, -np.pi), (3.2, 3.2, np.pi), size=(4 * count, 3))
    return poses[np.any(np.abs(poses[:, :2]) > HALF + oracle.PATH_MARGIN + ROUNDING, axis=1)][:count]


def near_poses(rng, count):
    """Poses just outside the grown table, on any of its sides."""
    outside = HALF + oracle.PATH_MARGIN + rng.choice([1e-5, 1e-3, 0.05, 0.15], size=(count, 1))
    point = rng.uniform(-outside, outside)
    axis, rows = rng.integers(2, size=count), np.arange(count)
    point[rows, axis] = outside[rows, axis] * rng.choice([-1, 1], size=count)
    return np.column_stack([point, rng.uniform(-np.pi, np.pi, count)])


def grid_poses(rng, count):
    """Poses of the planning grid outside the grown table."""
    poses = np.column_stack([rng.integers(-22, 23, 4 * count), rng.integers(-16, 17, 4 * count)]) * 0.1
    poses = poses[np.any(np.abs(poses) > HALF + 0.3, axis=1)][:count]
    return np.column_stack([poses, rng.integers(-4, 5, count) * (np.pi / 4)])


def via_poses(rng, count):
    """Poses at via points, some of which look along the table."""
    vias = np.array(oracle.via_points(2 * HALF))[rng.integers(4, size=count)]
    heading = np.where(rng.random(count) < 0.5, rng.integers(-2, 3, count) * np.pi / 2, rng.uniform(-3, 3, count))
    return np.column_stack([vias, heading])


def sample_pairs():
    """2,000 pairs: every kind of pose with every kind, then pure turns and pairs of one pose."""
    rng = np.random.default_rng(7)
    kinds = [free_poses, near_poses, grid_poses, via_poses]
    starts = np.concatenate([kind(rng, 475) for kind in kinds])
    goals = np.concatenate([kind(rng, 475) for kind in kinds])[rng.permutation(4 * 475)]
    turns = free_poses(rng, 100)
    turned = turns + np.column_stack([np.zeros((100, 2)), np.where(np.arange(100) < 50, rng.uniform(-4, 4, 100), 0.0)])
    return rounded(np.concatenate([starts, turns])), rounded(np.concatenate([goals, turned]))


def on_the_edge(start, goal):
    """Whether rounding may decide which ways are allowed."""
    times = [oracle.navigate(start, goal, margin=oracle.PATH_MARGIN + shift).time for shift in (-ROUNDING, ROUNDING)]
    return times[0] != times[1]
