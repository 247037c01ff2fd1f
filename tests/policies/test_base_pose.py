"""The base-pose policy: its frames, and what it sees."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.policies.base_pose import BasePosePolicy, base_pose_from_action, observe

GRASP = jnp.array([0.3, -0.1, 1.15, 0.7])


def tiny_policy(frame):
    keys = jax.random.split(jax.random.key(0), 2)
    kernels = (0.3 * jax.random.normal(keys[0], (15, 8)), jax.random.normal(keys[1], (8, 8)))
    return BasePosePolicy(kernels, (jnp.zeros(8), jnp.zeros(8)), jnp.zeros(15), jnp.ones(15), frame)


def turn(points, angle):
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.asarray(points) @ np.array([[cosine, sine], [-sine, cosine]])


def test_an_action_in_the_objects_frame_turns_and_moves_with_the_object():
    action = jnp.array([0.4, -0.2, 0.6, 0.8])
    pose = base_pose_from_action(action, GRASP, "object")
    at_origin = base_pose_from_action(action, GRASP.at[jnp.array([0, 1, 3])].set(0.0), "object")
    np.testing.assert_allclose(pose[:2], turn(at_origin[:2], 0.7) + np.asarray(GRASP[:2]), atol=1e-6)
    assert pose[2] == pytest.approx(float(at_origin[2]) + 0.7, abs=1e-6)
    assert float(at_origin[2]) == pytest.approx(np.arctan2(0.8, 0.6), abs=1e-6)


def test_an_action_in_the_tables_frame_ignores_the_object():
    action = jnp.array([0.4, -0.2, 0.6, 0.8])
    pose = base_pose_from_action(action, GRASP, "table")
    np.testing.assert_array_equal(pose, base_pose_from_action(action, 2 * GRASP, "table"))


def test_equal_grasps_are_seen_alike_whatever_the_turns_of_their_angles():
    robot_pose = jnp.array([1.0, -1.2, 0.4])
    turned = observe(GRASP.at[3].add(2 * jnp.pi), robot_pose.at[2].add(-2 * jnp.pi))
    np.testing.assert_allclose(turned, observe(GRASP, robot_pose), atol=2e-6)


def test_observation_holds_the_grasp_and_the_robot_and_nothing_is_lost():
    seen = observe(GRASP, jnp.array([1.0, -1.2, 0.4]))
    np.testing.assert_allclose(seen[:5], [0.3, -0.1, 1.15, 1.0, -1.2], atol=1e-6)
    angles = np.arctan2(seen[9::2], seen[10::2])
    np.testing.assert_allclose(angles, [0.7, 0.4, 0.4 - 0.7], atol=1e-6)


@pytest.mark.parametrize("frame", ["object", "table"])
def test_policy_takes_any_batch_and_stays_within_reach(frame):
    keys = jax.random.split(jax.random.key(1), 2)
    grasps, poses = jax.random.normal(keys[0], (3, 7, 4)), jax.random.normal(keys[1], (3, 7, 3))
    policy = tiny_policy(frame)
    goals = policy(grasps, poses)
    assert goals.shape == (3, 7, 3)
    np.testing.assert_allclose(goals[1, 2], policy(grasps[1, 2], poses[1, 2]), atol=1e-5)
    offset = goals[..., :2] - (grasps[..., :2] if frame == "object" else 0.0)
    assert float(jnp.max(jnp.abs(offset))) <= 1.4 * np.sqrt(2) + 1e-5 if frame == "object" else 2.2
