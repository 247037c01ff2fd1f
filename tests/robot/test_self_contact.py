"""The arm against itself: the kernel beside MuJoCo's contacts, and distances beside another formula."""

import functools

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from basenet_jax.robot import arm_shapes
from basenet_jax.robot.distances import segment_distance_square
from basenet_jax.robot.reading import load_robot
from basenet_jax.robot.self_contact import hits_itself
from basenet_jax.world.mujoco_scene import MujocoChecker
from tests import compiled
from tests.oracles import arm as oracle

ROUNDING = 2e-6  # m
coordinate = st.floats(-1.0, 1.0, width=32)
point = st.tuples(coordinate, coordinate, coordinate)

_hits_itself = jax.jit(hits_itself)
_square = jax.jit(segment_distance_square)


def check(robot, room, count):
    """Of so many random arm states: disagreements with MuJoCo are of a depth that is rounding."""
    rng = np.random.default_rng(5)
    turn = np.minimum(np.pi, robot.joint_upper)
    joints = rng.uniform(np.maximum(-np.pi, robot.joint_lower), turn, (count, robot.dof))
    call = functools.partial(_hits_itself, jax.device_get(robot))
    found = compiled.by_rows(lambda rows: call(rows.T), joints.astype(np.float32))
    checker = MujocoChecker(robot, room, scene=compiled.draw_scene(0, 1, room))
    depth = checker.distances(np.tile([0.0, 5.0, 0.0], (count, 1)), joints.astype(np.float32))[:, 3]
    assert 0.02 < np.mean(depth <= 0) < 0.7, "both kinds of states are among them"
    differ = found != (depth <= 0)
    assert np.all(np.abs(depth[differ]) < ROUNDING), depth[differ]


@pytest.mark.parametrize("name", ["ur5e_mobile", "panda_mobile"])
def test_as_mujoco_judges_it(room, name):
    check(load_robot(name), room, 2_048)


@pytest.mark.slow
def test_as_mujoco_judges_it_at_length(robot, room):
    check(robot, room, 100_000)


def test_neither_neighbours_nor_what_always_touches_is_tested(robot):
    """The first and last segment of a UR5e's wrist are 0.0997 m apart at their nearest ends, and 0.1 m thick."""
    links = np.array(robot.capsule_link)
    assert all(links[b] - links[a] >= 2 for a, b in robot.self_pairs)
    assert (4, 6) not in robot.self_pairs
    assert (4, 7) in robot.self_pairs


def test_home_and_stow_are_free(robot):
    assert not np.any(_hits_itself(robot, np.stack([oracle.HOME, oracle.STOW], axis=1)))


@given(point, point, point, point)
def test_distance_of_segments(a, b, c, d):
    vectors = [tuple(np.float32(x) for x in vector) for vector in (a, b, c, d)]
    ends = [np.array(vector, float) for vector in vectors]
    assert np.sqrt(_square(*vectors)) == pytest.approx(float(arm_shapes.segment_distance(*ends)), abs=2e-5)


def test_distance_of_segments_is_the_least_over_both():
    """The other formula by brute force."""
    rng = np.random.default_rng(0)
    start, end, other_start, other_end = rng.uniform(-1, 1, (4, 40, 3))
    s = np.linspace(0.0, 1.0, 201)[:, None, None]
    gap = (start + s * (end - start))[:, None] - (other_start + s * (other_end - other_start))[None]
    least = np.linalg.norm(gap, axis=-1).min(axis=(0, 1))
    found = arm_shapes.segment_distance(start, end, other_start, other_end)
    assert np.all((found <= least + 1e-12) & (found >= least - 0.01))
