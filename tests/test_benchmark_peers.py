"""What the benchmarks set beside ours is the same arm in the same world."""

import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.robot.reading import load_robot
from basenet_jax.world.boxes import Room
from benchmarks import contacts, peer_arms, scaling_picture
from tests.oracles import arm, picking

POSES = 40


@pytest.fixture(scope="module")
def robot():
    return load_robot()


@pytest.fixture(scope="module")
def joints():
    return np.random.default_rng(0).uniform(arm.LOWER, arm.UPPER, (POSES, 6))


@pytest.fixture(scope="module")
def poses(robot, joints):
    return peer_arms.tool_poses(robot, joints)


@pytest.fixture(scope="module")
def pairs():
    """Base poses in front of the table, and grasps near to them: some can be picked, some not."""
    random = np.random.default_rng(1)
    base_pose = random.uniform((-0.6, -1.0, -np.pi), (0.6, -0.85, np.pi), (POSES, 3))
    grasp = random.uniform((-0.4, -0.35, 1.0, -np.pi), (0.4, 0.0, 1.2, np.pi), (POSES, 4))
    return base_pose, grasp + np.pad(base_pose[:, :1], ((0, 0), (0, 3)))


def test_tool_poses_are_exact(joints, poses):
    expected = np.array([arm.chain(each)[-1] for each in joints])
    np.testing.assert_allclose(poses, expected, atol=1e-12)


def test_eaik_has_the_same_arm(robot, joints, poses):
    pytest.importorskip("eaik.IK_DH", reason="needs EAIK")
    eaik = peer_arms.eaik_arm(robot)
    np.testing.assert_allclose([eaik.fwdKin(each) for each in joints], poses, atol=1e-9)
    solutions = peer_arms.solve_by_eaik(eaik, poses)
    assert len(solutions) == POSES
    for solution, expected in zip(solutions, joints, strict=True):
        apart = np.abs((np.asarray(solution.Q) - expected + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
        assert apart.min() < 1e-6
    alone = peer_arms.solve_by_eaik(eaik, poses[:1])
    np.testing.assert_array_equal(alone.Q, solutions[0].Q)


def test_grasps_are_seen_from_the_arm_as_the_oracle_sees_them(robot, pairs):
    expected = [picking.tool_target(base_pose, grasp, 0.0) for base_pose, grasp in zip(*pairs, strict=True)]
    np.testing.assert_allclose(peer_arms.grasp_poses(robot, *pairs), expected, atol=1e-12)


def test_mink_comes_to_the_same_poses(robot, joints, poses):
    pytest.importorskip("mink", reason="needs mink, of the extra `benchmarks`")
    solve = peer_arms.mink_solver(robot, iterations=30, position_tolerance_m=1e-3, orientation_tolerance_rad=1e-2)
    inside = np.clip(joints, arm.LOWER + 0.3, arm.UPPER - 0.3)
    near = solve(peer_arms.tool_poses(robot, inside), inside + 0.1)
    assert near.converged.mean() > 0.95
    assert near.iterations < 10 * POSES
    assert not solve(poses + np.pad([[5.0]], ((0, 3), (3, 0))), joints).converged.any(), "5 m away"


def test_one_pair_at_a_time_is_as_the_oracle_judges(robot, pairs):
    pytest.importorskip("eaik.IK_DH", reason="needs EAIK")
    from benchmarks.one_at_a_time import OneAtATime

    costs = OneAtATime(robot, Room.from_config())
    feasible = 0
    for base_pose, grasp in zip(*pairs, strict=True):
        lenient, strict = (picking.pick(base_pose, grasp, picking.World(slack=slack)) for slack in (1, -1))
        if lenient.reason == "base_collides" or (lenient.reason is None) != (strict.reason is None):
            continue  # rule 1 is the grid's; and where rounding decides
        found = costs.pick_time(base_pose, grasp)
        assert np.isfinite(found) == (strict.reason is None)
        if strict.reason is None:
            assert found == pytest.approx(picking.pick(base_pose, grasp).time, abs=1e-4)
            feasible += 1
    assert 8 <= feasible < POSES


def test_mujoco_and_the_kernels_check_the_same_states(robot, pairs, joints):
    room = Room.from_config()
    states = np.concatenate([pairs[0], joints], axis=1)
    expected = contacts.mujoco_checks(robot, room)(states)
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(contacts.kernel_checks(robot, room)(jnp.asarray(states)), expected)


def test_a_picture_of_scaling_has_every_series(tmp_path):
    series = {"ours": [(1, 2.0, 1.0, 3.0), (64, 20.0, 19.0, 21.0)], "theirs": [(64, 3.0, 3.0, 3.0)]}
    figure = scaling_picture.draw_scaling("title", series, size="batch", value="per second")
    (axes,) = figure.axes
    assert [line.get_label() for line in axes.lines] == ["ours", "theirs"]
    assert axes.get_yscale() == "log"
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), [(1, 2.0), (64, 20.0)])
    figure.savefig(tmp_path / "picture.png")
