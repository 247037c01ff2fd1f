"""Arms like Universal Robots', recognised in frames of any kind; what damped least squares makes of calibrated ones."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.robot import ur
from basenet_jax.robot.ik import damped_least_squares, residual
from basenet_jax.robot.kinematics import Frame, components, forward_kinematics
from basenet_jax.robot.reading import find_source, read_source
from basenet_jax.robot.ur_frames import find_ur_frames, with_closed_form
from tests.robot import mini

COUNT = 64


def rotation(rng, angle=np.pi):
    """By up to an angle about a random axis (Rodrigues)."""
    axis = rng.normal(size=3)
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = rng.uniform(-angle, angle)
    return np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross


def about_z(angle):
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def pose(turn, place):
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = turn, place
    return result


def reframed(robot, rng):
    """The same arm with each joint frame turned about its axis, shifted along it and, at random, upside down."""
    steps = [pose(*step) for step in zip(robot.joint_rotation, robot.joint_position, strict=True)]
    at = list(itertools.accumulate(steps, np.matmul))
    tool = at[-1] @ pose(robot.tool_rotation, robot.tool_position)
    base, hand = pose(rotation(rng), rng.uniform(-1, 1, 3)), pose(rotation(rng), rng.uniform(-0.1, 0.1, 3))
    new = [np.eye(4)]
    for frame in at:
        flip = np.diag([1.0, -1.0, -1.0]) if rng.random() < 0.5 else np.eye(3)
        new.append(base @ frame @ pose(about_z(rng.uniform(-3, 3)) @ flip, [0.0, 0.0, rng.uniform(-1, 1)]))
    steps = [np.linalg.inv(before) @ after for before, after in itertools.pairwise([*new, base @ tool @ hand])]
    return dataclasses.replace(
        robot,
        joint_rotation=np.stack([step[:3, :3] for step in steps[:-1]]),
        joint_position=np.stack([step[:3, 3] for step in steps[:-1]]),
        tool_rotation=steps[-1][:3, :3],
        tool_position=steps[-1][:3, 3],
    )


def calibrated(robot, rng):
    """Each joint a fraction of a millimetre and of a degree away from where it should be."""
    turned = np.stack([turn @ rotation(rng, 0.01) for turn in np.asarray(robot.joint_rotation)])
    moved = np.asarray(robot.joint_position) + rng.uniform(-2e-3, 2e-3, (6, 3))
    return dataclasses.replace(robot, joint_rotation=turned, joint_position=moved)


@jax.jit
def solved(robot, joints):
    """For poses of joints: the joints of all branches (8 n 6), the poses, and what misses them before and after."""
    position, turn = forward_kinematics(robot, joints)
    columns = (tuple(turn[:, row, column] for row in range(3)) for column in range(3))
    target = Frame(*columns, origin=components(position))
    found = ur.closed_form(robot, target, ur.all_branches(1))
    seeds = jnp.stack([jnp.broadcast_to(q, (2, 2, 2, COUNT)).reshape(8, COUNT) for q in found.joints])
    free = robot.replace(joint_lower=jnp.full(6, -10.0), joint_upper=jnp.full(6, 10.0))
    after = damped_least_squares(free, target, seeds, 5)
    return seeds, found.shortfall.reshape(-1), residual(robot, target, seeds), residual(robot, target, after)


def solve(robot, seed=0):
    joints = np.random.default_rng(seed).uniform(-3.0, 3.0, (COUNT, 6))
    with jax.enable_x64(True):
        seeds, _, before, after = jax.tree.map(np.asarray, solved(robot, jnp.asarray(joints)))
    apart = np.abs((np.moveaxis(seeds, 0, -1) - joints + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)
    return apart.min(axis=0), before, after


@pytest.fixture(scope="module")
def ur5e():
    return find_source("ur5e_mobile").robot


@pytest.mark.parametrize("seed", range(4))
def test_any_frames_of_an_arm_have_its_solutions(ur5e, seed):
    """Joints that a pose was made from are among those that are found for it."""
    robot = with_closed_form(reframed(ur5e, np.random.default_rng(seed)))
    assert robot.closed_form == "ur"
    assert robot.ur_frames is not None
    apart, _, _ = solve(robot, seed)
    assert np.max(apart) < 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_of_a_calibrated_arm_least_squares_has_the_last_word(ur5e, seed):
    rng = np.random.default_rng(seed)
    robot = with_closed_form(reframed(calibrated(ur5e, rng), rng))
    assert robot.closed_form == "ur"
    apart, _, (position, orientation) = solve(robot, seed)
    assert np.median(apart) < 0.1
    best = (position + orientation).min(axis=0)
    assert np.mean(best < 1e-3) > 0.9  # near singular poses it takes more than five steps


def test_a_urdf_of_such_an_arm_is_recognised_and_an_exact_one_keeps_its_own_frames(tmp_path, ur5e):
    assert ur5e.closed_form == "ur"
    assert ur5e.ur_frames is None
    robot = read_source(mini.write(tmp_path)).robot
    assert robot.ur_frames is not None
    np.testing.assert_allclose(robot.ur_frames.lengths, [0.0, 0.42, 0.39, 0.11, 0.09, 0.0], atol=1e-12)
    apart, _, _ = solve(robot)
    assert np.max(apart) < 1e-6
    off = read_source(mini.write(tmp_path, closed_form="none")).robot
    assert (off.closed_form, off.ur_frames) == (None, None)


OTHERS = {
    "elbow askew": ("j3", "0 1 0", "0.2 1 0"),
    "wrist apart": ("j5", "0 0 1", None),
    "roll": ("j4", "0 1 0", "0 0 1"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_other_arms_are_not(tmp_path, what):
    name, axis, other = OTHERS[what]
    element = mini.joint(name)
    element = element.replace('xyz="0 0.09 0"', 'xyz="0.05 0.09 0"') if other is None else element.replace(axis, other)
    assert find_ur_frames(read_source(mini.write(tmp_path, mini.urdf(**{name: element}))).robot) is None
    assert find_ur_frames(find_source("panda_mobile").robot) is None
