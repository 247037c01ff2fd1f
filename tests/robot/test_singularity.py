"""Nearly singular poses, beside NumPy's singular values."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.robot.kinematics import geometric_jacobian
from basenet_jax.robot.reading import load_robot
from basenet_jax.robot.singularity import near_singular

_near_singular = jax.jit(near_singular)
_jacobian = jax.jit(geometric_jacobian)


@pytest.mark.parametrize("name", ["ur5e_mobile", "panda_mobile"])
def test_as_by_singular_values(name):
    robot = load_robot(name)
    joints = np.random.default_rng(1).uniform(robot.joint_lower, robot.joint_upper, (2_048, robot.dof))
    joints = joints.astype(np.float32)
    least = np.linalg.svd(np.asarray(_jacobian(robot, joints), float), compute_uv=False)[:, -1]
    for bound in (0.02, 0.05, 0.2):
        found = np.asarray(_near_singular(robot, joints.T, bound))
        clear = np.abs(least / bound - 1) > 2e-3
        np.testing.assert_array_equal(found[clear], (least < bound)[clear])
    assert 0.01 < np.mean(least < 0.05) < 0.9, "both kinds are among them"


def test_a_stretched_elbow_is_singular(robot):
    straight = jnp.array([0.3, -1.0, 0.0, -1.2, 1.5, 0.2])[:, None]
    assert bool(_near_singular(robot, straight, 0.02)[0])
    assert not bool(_near_singular(robot, straight.at[2].set(1.2), 0.02)[0])
