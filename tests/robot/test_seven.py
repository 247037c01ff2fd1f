"""The closed form of seven joints: every solution reaches, and what joints reach is among the solutions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.robot import seven
from basenet_jax.robot.kinematics import Frame, forward_kinematics
from basenet_jax.robot.reading import load_robot

COUNT = 200


@pytest.fixture(scope="module")
def arm():
    return load_robot("panda_mobile")


@pytest.fixture(scope="module")
def joints(arm):
    return np.random.default_rng(3).uniform(arm.joint_lower, arm.joint_upper, (COUNT, 7))


@pytest.fixture(scope="module")
def poses(arm, joints):
    with jax.enable_x64(True):
        return jax.device_get(jax.jit(forward_kinematics)(arm, joints))


def solve(arm, poses, joint_7):
    """Joints (8, N, 7) and shortfalls (8, N) of all branches in float64."""
    position, rotation = poses
    columns = [tuple(rotation[:, row, column] for row in range(3)) for column in range(3)]
    target = Frame(*columns, origin=tuple(position.T))

    def all_branches(target, joint_7):
        return seven.closed_form(arm, target, joint_7, seven.branch_signs(jnp.arange(seven.BRANCHES)[:, None]))

    with jax.enable_x64(True):
        solution = jax.device_get(jax.jit(all_branches)(target, joint_7))
    shape = (seven.BRANCHES, len(position))
    return np.stack([np.broadcast_to(q, shape) for q in solution.joints], -1), np.broadcast_to(
        solution.shortfall, shape
    )


def test_solutions_without_shortfall_reach(arm, poses, joints):
    joint_7 = np.random.default_rng(4).uniform(-2.8, 2.8, COUNT)  # others than those that the poses come from
    found, shortfall = solve(arm, poses, joint_7)
    reached = shortfall < 1e-9
    assert 0.2 < np.mean(reached) < 1.0
    with jax.enable_x64(True):
        position, rotation = jax.device_get(jax.jit(forward_kinematics)(arm, found[reached]))
    which = np.broadcast_to(np.arange(COUNT), reached.shape)[reached]
    np.testing.assert_allclose(position, poses[0][which], atol=1e-7)
    np.testing.assert_allclose(rotation, poses[1][which], atol=1e-7)


def test_the_joints_that_reached_a_pose_are_among_its_solutions(arm, poses, joints):
    found, shortfall = solve(arm, poses, joints[:, 6])
    apart = np.abs((found - joints + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)
    assert np.all(np.min(np.where(shortfall < 1e-6, apart, np.inf), axis=0) < 1e-5)


def test_eight_solutions_differ(arm, poses):
    found, shortfall = solve(arm, poses, np.zeros(COUNT))
    for solutions in found.transpose(1, 0, 2)[np.all(shortfall < 1e-9, axis=0)]:
        apart = np.abs((solutions[:, None] - solutions + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)
        assert np.sum(apart < 1e-6) == 8, "each only equals itself"


def test_arms_are_recognised(arm, robot):
    assert seven.is_spherical_shouldered(arm)
    assert not seven.is_spherical_shouldered(robot)
    moved = np.array(arm.joint_position)
    moved[2] += [0.01, 0.0, 0.0]
    assert not seven.is_spherical_shouldered(arm.replace(joint_position=moved))
