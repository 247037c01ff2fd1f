"""The oracles themselves, against known values, other programs and cruder methods."""

import math

import numpy as np
from eaik.IK_DH import DhRobot

from tests.oracles import arm, clearance, navigation, timing


def test_trapezoid_against_a_simulated_profile():
    for distance, speed, acceleration in ((2.0, 0.5, 0.5), (0.1, 0.5, 0.5), (-1.2, 2.0, 1.4), (0.5, 0.5, 0.5)):
        duration = timing.trapezoid(distance, speed, acceleration)
        t = np.linspace(0.0, duration, 100_001)
        covered = np.trapezoid(np.minimum(speed, acceleration * np.minimum(t, duration - t)), t)
        assert abs(covered - abs(distance)) < 1e-7
    assert timing.trapezoid(0.0, 1.0, 1.0) == 0.0


def test_tool_at_home_and_stow():
    # By Universal Robots' DH numbers; stow is over the deck, the tool pointing down.
    np.testing.assert_allclose(arm.chain(arm.HOME)[-1][:3, 3], [0.5694, 0.1246, 0.4034], atol=5e-5)
    stow = arm.pose(*arm.MOUNT, 0.0) @ arm.chain(arm.STOW)[-1]
    np.testing.assert_allclose(stow[:3, 3], [0.15, 0.05, 1.15], atol=1e-4)
    np.testing.assert_allclose(stow[:3, 2], [0.0, 0.0, -1.0], atol=1e-4)


def test_inverse_kinematics_against_eaik():
    rng = np.random.default_rng(0)
    other = DhRobot(np.array(arm.ALPHA), np.array(arm.A), np.array(arm.D))
    for _ in range(100):
        target = arm.chain(rng.uniform(-np.pi, np.pi, 6))[-1]
        own = [arm.inverse_kinematics(target, branch) for branch in arm.BRANCHES]
        own = np.array([q for q in own if max(arm.pose_error(q, target)) < 1e-8])
        found = other.IK(target)
        exact = found.Q[~np.array(found.is_LS)]
        assert len(own) == len(exact)
        for q in exact:
            assert np.abs(np.angle(np.exp(1j * (own - q)))).max(axis=1).min() < 1e-6


def test_clipping_against_samples():
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 1.0, 2001)[:, None]
    for a, b in rng.uniform(-2.0, 2.0, size=(300, 2, 2)):
        points = (1 - t) * a + t * b
        depth = np.max(np.min(np.array([1.249, 0.649]) - np.abs(points), axis=1))
        if abs(depth) > 2e-3:  # the samples' distance
            assert navigation.enters(a, b, (2.0, 0.8), 0.249) == (depth > 0)
    along_the_edge = (-2.0, 0.649), (2.0, 0.649)
    assert not navigation.enters(*along_the_edge, (2.0, 0.8), 0.249)


def test_distances_against_samples():
    rng = np.random.default_rng(2)
    base_pose, table, height = (1.8, 0.4, 0.3), (2.0, 0.8), 0.75
    segments = rng.uniform((-1.5, -1.0, 0.5), (2.5, 1.0, 1.5), size=(40, 2, 3))
    t = np.linspace(0.0, 1.0, 5001)[:, None, None]
    points = (1 - t) * segments[:, 0] + t * segments[:, 1]
    to_table = np.linalg.norm(points - np.clip(points, [-1.0, -0.4, 0.0], [1.0, 0.4, 0.75]), axis=-1)
    local = (points - [1.8, 0.4, 0.0]) @ arm.rotation_z(0.3)[:3, :3]
    to_body = np.linalg.norm(local - np.clip(local, [-0.4, -0.25, 0.0], [0.4, 0.25, 0.75]), axis=-1)
    sampled = np.minimum(to_table, to_body).min(axis=0)
    found = clearance.capsule_clearance(segments, base_pose, table, height)
    # Samples are up to 4.6 m / 10,000 from the nearest point.
    assert np.all((found <= sampled + 1e-9) & (found >= sampled - 5e-4))


def test_base_clearance_of_known_poses():
    assert math.isclose(clearance.base_clearance((0.0, 0.95, 0.0)), 0.2)
    assert math.isclose(clearance.base_clearance((0.0, 1.0, math.pi / 2)), 0.1)
    assert math.isclose(clearance.base_clearance((1.1 + 0.4 + 0.3, 0.5 + 0.25 + 0.4, 0.0)), 0.5)
    assert clearance.base_clearance((1.1, 0.0, 0.3)) == 0.0
