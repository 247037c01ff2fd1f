from functools import partial

import jax
import numpy as np
import pytest

from basenet_jax.robot import ik
from basenet_jax.robot.ik import damped_least_squares, solve_ik
from basenet_jax.robot.kinematics import Frame, components
from tests import compiled
from tests.compiled import forward_kinematics
from tests.oracles import arm as oracle

# float32 knows a pose of the arm to 2e-6 (m or rad); the solver's fixed point moves by no more.
FLOAT32 = 5e-6
POSITION, ORIENTATION = 1e-3, np.radians(0.5)

_solve, fixed_point = jax.jit(solve_ik), jax.jit(damped_least_squares)


def solve(robot, position, rotation, seed, iterations=30):
    """`solve_ik` of any batch of poses, in rows of one number."""
    call = partial(_solve, robot, iterations=iterations)
    return compiled.by_rows(call, position, rotation, seed)


@pytest.fixture(scope="module")
def reachable(robot):
    """Joints well inside the limits and the poses they reach, in float32."""
    joints = np.random.default_rng(5).uniform(-2.5, 2.5, size=(256, 6)).astype(np.float32)
    return joints, *forward_kinematics(robot, joints)


def target(position, rotation):
    """A target with the batch's shape in every component."""
    columns = (tuple(rotation[..., row, column] for row in range(3)) for column in range(3))
    return Frame(*columns, origin=components(position))


def test_trivial_a_fulfilled_target_stays(robot, reachable):
    joints, position, rotation = reachable
    result = solve(robot, position, rotation, joints)
    assert result.converged.all()
    found, turned = forward_kinematics(robot, result.joints)
    np.testing.assert_allclose(found, position, atol=FLOAT32)
    np.testing.assert_allclose(turned, rotation, atol=FLOAT32)
    # Near singular poses joints may wander within float32's error of the pose; elsewhere they stay.
    assert np.median(np.abs(result.joints - joints)) < 1e-5


def test_convergent_from_a_nearby_seed(robot, reachable):
    joints, position, rotation = reachable
    seed = joints + np.random.default_rng(6).uniform(-0.15, 0.15, joints.shape).astype(np.float32)
    result = solve(robot, position, rotation, seed)
    # A seed near a singular pose may lead elsewhere; nearly all don't.
    assert result.converged.mean() > 0.97
    assert np.median(result.position_error) < FLOAT32
    assert np.median(result.orientation_error) < FLOAT32


def test_convergence_is_quadratic_near_the_target(robot, reachable):
    """Gauss-Newton's: each step squares the error, so three steps from 0.05 rad reach float32."""
    joints, position, rotation = reachable
    seed = joints + np.float32(0.05)
    errors = [np.median(solve(robot, position, rotation, seed, iterations=n).position_error) for n in (0, 1, 3)]
    assert errors[1] < 0.2 * errors[0]
    assert errors[2] < FLOAT32


def test_unreachable_target_is_approached_but_not_converged(robot):
    """3 m away: the arm ends up stretched towards it, the error is what is missing."""
    position = np.array([[3.0, 0.0, 0.3]])
    rotation = np.array([[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]])
    result = solve(robot, position, rotation, np.array([[0.2, -0.5, 0.4, -0.3, -1.2, 0.1]]), iterations=200)
    assert not result.converged[0]
    assert 1.9 < result.position_error[0] < 2.3
    assert np.all(np.isfinite(result.joints))


def test_errors_and_flag_are_those_of_the_joints(robot, reachable):
    """Checked by the oracle's matrices; few steps, so that both outcomes appear."""
    joints, position, rotation = reachable
    seed = np.random.default_rng(7).uniform(-2.5, 2.5, joints.shape).astype(np.float32)
    result = solve(robot, position, rotation, seed, iterations=12)
    for index in range(len(joints)):
        wanted = np.eye(4)
        wanted[:3, :3], wanted[:3, 3] = rotation[index], position[index]
        distance, turn = oracle.pose_error(np.asarray(result.joints[index], float), wanted)
        assert result.position_error[index] == pytest.approx(distance, abs=FLOAT32)
        # Near half a turn the angle follows from a small sine of two rounded rotations.
        assert result.orientation_error[index] == pytest.approx(turn, abs=1e-5 if turn < 3.0 else 1e-2)
        assert result.converged[index] == (
            result.position_error[index] <= POSITION and result.orientation_error[index] <= ORIENTATION
        )
    assert 0.05 < result.converged.mean() < 0.95


@pytest.mark.parametrize(
    ("offset", "turn", "converged"),
    [(0.9e-3, 0.0, True), (1.1e-3, 0.0, False)] + [(0.0, np.radians(angle), angle < 0.5) for angle in (0.45, 0.55)],
)
def test_tolerances_decide(robot, reachable, offset, turn, converged):
    joints, position, rotation = (array[:16] for array in reachable)
    twist = np.array(oracle.rotation_z(turn)[:3, :3], np.float32)
    result = solve(robot, position + np.array([0.0, 0.0, offset]), rotation @ twist, joints, iterations=0)
    np.testing.assert_array_equal(result.converged, converged)


def test_limits_are_kept(robot, reachable):
    """With limits cut to 1 rad many targets can't be reached; no iterate leaves them."""
    narrow = robot.replace(joint_lower=np.full(6, -1.0), joint_upper=np.full(6, 1.0))
    _, position, rotation = reachable
    for iterations in (1, 30):
        seed = np.zeros((len(position), 6), np.float32)
        joints = solve(narrow, position, rotation, seed, iterations=iterations).joints
        assert np.all(np.abs(joints) <= 1.0)
        assert np.any(np.abs(joints) == 1.0) or iterations == 1


@pytest.mark.parametrize("max_step", [0.2, 0.01])
def test_no_joint_moves_farther_than_the_step_limit(robot, reachable, max_step):
    joints, position, rotation = reachable
    seed = np.zeros_like(joints)
    after = np.asarray(fixed_point(robot, target(position, rotation), seed.T, 1, max_step=max_step)).T
    largest = np.abs(after - seed).max(axis=1)
    assert largest.max() <= max_step * (1 + 1e-6)
    assert np.any(largest > 0.999 * max_step)  # the limit was met


def test_a_clipped_step_keeps_its_direction(robot, reachable):
    joints, position, rotation = reachable
    goal, seed = target(position, rotation), np.zeros_like(joints).T
    free, clipped = (np.asarray(fixed_point(robot, goal, seed, 1, max_step=limit)).T for limit in (1e3, 0.1))
    inside = np.abs(free).max(axis=1) < 2.5  # else the joint limits cut in
    scale = np.minimum(0.1 / np.abs(free).max(axis=1, keepdims=True), 1.0)
    np.testing.assert_allclose(clipped[inside], (free * scale)[inside], atol=1e-5)


def test_a_large_batch_is_solved_like_its_parts(robot, monkeypatch):
    monkeypatch.setattr(ik, "CHUNK", 8)
    seeds = np.random.default_rng(5).uniform(-1.0, 1.0, (21, robot.dof)).astype(np.float32)
    position, rotation = forward_kinematics(robot, seeds + 0.1)
    whole = _solve(robot, position, rotation, seeds, iterations=5)
    monkeypatch.undo()
    at_once = solve(robot, position, rotation, seeds, iterations=5)
    np.testing.assert_allclose(whole.joints, at_once.joints, atol=1e-5)
    assert whole.converged.shape == (21,)
