import jax
import numpy as np
import pytest

from basenet_jax.robot.reading import load_robot
from tests.oracles import arm as oracle


def test_arm_has_the_numbers_of_the_manufacturer(robot):
    """DH lengths show up in the joint frames: d1, a2, a3, d4, d5, and d6 before the tool."""
    np.testing.assert_allclose(robot.joint_position[1], [0, 0, oracle.D[0]], atol=1e-15)
    np.testing.assert_allclose(robot.joint_position[2], [oracle.A[1], 0, 0], atol=1e-15)
    np.testing.assert_allclose(robot.joint_position[3], [oracle.A[2], 0, 0], atol=1e-15)
    np.testing.assert_allclose(robot.joint_position[4], [0, 0, oracle.D[3]], atol=1e-15)
    np.testing.assert_allclose(robot.joint_position[5], [0, 0, oracle.D[4]], atol=1e-15)
    np.testing.assert_allclose(robot.tool_position, [0, 0, oracle.D[5]], atol=1e-15)
    np.testing.assert_allclose(robot.joint_lower, oracle.LOWER)
    np.testing.assert_allclose(robot.joint_upper, oracle.UPPER)
    np.testing.assert_allclose(robot.joint_speed, [1, 1, 1, 2, 2, 2])
    np.testing.assert_allclose(robot.joint_acceleration, 1.4)
    np.testing.assert_allclose(robot.home, oracle.HOME)
    np.testing.assert_allclose(robot.stow, oracle.STOW)
    assert robot.closed_form == "ur"
    assert not any(robot.prismatic)


def test_base_has_the_numbers_of_the_release(robot):
    np.testing.assert_allclose(robot.mount_position, oracle.MOUNT, atol=1e-15)
    np.testing.assert_allclose(robot.mount_rotation, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(robot.footprint_half_size, [0.40, 0.25])
    np.testing.assert_allclose(robot.body_half_size, [0.40, 0.25, 0.375])
    np.testing.assert_allclose(robot.body_center, [0.0, 0.0, 0.375])
    np.testing.assert_allclose(robot.base_speed, [0.5, 0.5])
    np.testing.assert_allclose(robot.base_acceleration, [0.5, 1.0])


def test_capsules_are_those_of_the_world(robot):
    """At the stow pose, in W with the base at its origin, capsule by capsule as the DH frames give them."""
    np.testing.assert_allclose(robot.capsule_radius, oracle.RADII)
    x, y, z = robot.mount_position
    frames = [oracle.pose(x, y, z, 0.0)]
    for turn, offset, angle in zip(robot.joint_rotation, robot.joint_position, robot.stow, strict=True):
        fixed = np.eye(4)
        fixed[:3, :3], fixed[:3, 3] = turn, offset
        frames.append(frames[-1] @ fixed @ oracle.rotation_z(angle))
    capsules = zip(robot.capsule_link, robot.capsule_start, robot.capsule_end, strict=True)
    found = [[(frames[link] @ (*end, 1.0))[:3] for end in ends] for link, *ends in capsules]
    for ends, expected in zip(np.array(found), oracle.capsules(oracle.STOW, (0.0, 0.0, 0.0)), strict=True):
        assert min(np.abs(ends - expected).max(), np.abs(ends[::-1] - expected).max()) < 1e-14  # MuJoCo may swap them


def test_leaves_are_double_numpy_arrays(robot):
    """So that one robot serves both precisions."""
    assert all(isinstance(leaf, np.ndarray) and leaf.dtype == np.float64 for leaf in jax.tree.leaves(robot))


def test_unknown_robot():
    with pytest.raises(ValueError, match=r"found 'ur6e', allowed are .*ur5e_mobile"):
        load_robot("ur6e")
