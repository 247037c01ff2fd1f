# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from basenet_jax.robot.kinematics import chain, forward_kinematics, geometric_jacobian, mount_frame
from basenet_jax.robot.reading import read_source
from tests.oracles import arm as oracle
from tests.robot.conftest import ASSETS

# float32 after six turns of an arm of 1 m; float64 likewise.
FLOAT32, FLOAT64 = 2e-6, 1e-14


@pytest.fixture(scope="module")
def joints(robot):
    return np.random.default_rng(2).uniform(robot.joint_lower, robot.joint_upper, size=(500, 6))


def in_double(function, *arguments):
    """Evaluated in float64."""
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, jax.jit(function)(*(np.asarray(argument, float) for argument in arguments)))


def poses(position, rotation):
    """As 4x4 matrices."""
    result = np.tile(np.eye(4), (len(position), 1, 1))
    result[:, :3, :3], result[:, :3, 3] = rotation, position
    return result


def test_agrees_with_mujoco(robot, joints):
    model = read_source(ASSETS / "ur5e_mobile.yaml", packaged=True).model
    data = mujoco.MjData(model)
    position, rotation = in_double(lambda q: forward_kinematics(robot, q), joints)
    addresses = [model.joint(name).qposadr[0] for name in robot.joint_names]
    base = data.body("arm_base")
    for index, state in enumerate(joints):
        data.qpos[addresses] = state
        mujoco.mj_kinematics(model, data)
        turn = base.xmat.reshape(3, 3)
        tool = data.site("tool0")
        np.testing.assert_allclose(position[index], turn.T @ (tool.xpos - base.xpos), atol=FLOAT64)
        np.testing.assert_allclose(rotation[index], turn.T @ tool.xmat.reshape(3, 3), atol=FLOAT64)


def test_agrees_with_the_dh_parameters(robot, joints):
    found = poses(*in_double(lambda q: forward_kinematics(robot, q), joints))
    np.testing.assert_allclose(found, [oracle.chain(q)[-1] for q in joints], atol=FLOAT64)


def test_single_precision(robot, joints):
    found = poses(*jax.jit(forward_kinematics)(robot, joints.astype(np.float32)))
    expected = [oracle.chain(q)[-1] for q in joints.astype(np.float32).astype(float)]
    np.testing.assert_allclose(found, expected, atol=FLOAT32)


def test_agrees_with_eaik(robot, joints):
    dh = pytest.importorskip("eaik.IK_DH", reason="needs EAIK")
    other = dh.DhRobot(np.array(oracle.ALPHA), np.array(oracle.A), np.array(oracle.D))
    found = poses(*in_double(lambda q: forward_kinematics(robot, q), joints))
    np.testing.assert_allclose(found, [other.fwdKin(q) for q in joints], atol=FLOAT64)


def test_agrees_with_ur_analytic_ik(robot, joints):
    ur_analytic_ik = pytest.importorskip("ur_analytic_ik", reason="its wheels are for Python 3.11 only")
    found = poses(*in_double(lambda q: forward_kinematics(robot, q), joints))
    expected = [ur_analytic_ik.ur5e.forward_kinematics(*q) for q in joints]
    np.testing.assert_allclose(found, expected, atol=FLOAT64)


def test_home_is_where_the_release_has_it(robot):
    """By the DH numbers to the last given digit, and 0.7 mm from the position the release gives, turned by pi."""
    position, _ = in_double(lambda q: forward_kinematics(robot, q), robot.home)
    np.testing.assert_allclose(position, [0.5694, 0.1246, 0.4034], atol=5e-5)
    assert np.linalg.norm(position - [0.5697, 0.1253, 0.4036]) == pytest.approx(0.7e-3, abs=2e-4)


def test_stow_holds_the_tool_down_over_the_deck(robot):
    """The stow joints are given to 0.001 degrees, the pose in the base frame follows from them to 0.1 mm."""
    position, rotation = in_double(lambda q: forward_kinematics(robot, q), robot.stow)
    np.testing.assert_allclose(robot.mount_rotation @ position + robot.mount_position, [0.15, 0.05, 1.15], atol=1e-4)
    np.testing.assert_allclose(robot.mount_rotation @ rotation[:, 2], [0.0, 0.0, -1.0], atol=1e-4)


def test_jacobian_is_the_derivative(robot, joints):
    """Central differences in float64: their error is about 1e-10 for steps of 1e-5."""
    joints, step = joints[:100], 1e-5
    jacobian = in_double(lambda q: geometric_jacobian(robot, q), joints)
    _, rotation = in_double(lambda q: forward_kinematics(robot, q), joints)
    for joint in range(robot.dof):
        move = step * np.eye(robot.dof)[joint]
        ahead, behind = (in_double(lambda q: forward_kinematics(robot, q), joints + s * move) for s in (1, -1))
        velocity = (ahead[0] - behind[0]) / (2 * step)
        spin = (ahead[1] - behind[1]) / (2 * step) @ np.swapaxes(rotation, 1, 2)  # the cross product's matrix
        angular = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(jacobian[:, :3, joint], velocity, atol=1e-9)
        np.testing.assert_allclose(jacobian[:, 3:, joint], angular, atol=1e-9)


def test_a_sliding_joint_slides_along_its_axis(robot):
    """The same arm with its elbow sliding: displacement and Jacobian column are the joint's z axis."""
    sliding = robot.replace(prismatic=(False, False, True, False, False, False))
    joints = np.array([0.3, -1.0, 0.0, -0.5, 0.7, 0.2])
    axis = in_double(lambda q: jnp.stack(chain(sliding, q).axes)[:, 2], joints)
    near, _ = in_double(lambda q: forward_kinematics(sliding, q), joints)
    far, _ = in_double(lambda q: forward_kinematics(sliding, q), joints + 0.25 * np.eye(6)[2])
    np.testing.assert_allclose(far - near, 0.25 * axis, atol=FLOAT64)
    column = in_double(lambda q: geometric_jacobian(sliding, q), joints)[:, 2]
    np.testing.assert_allclose(column, [*axis, 0.0, 0.0, 0.0], atol=FLOAT64)


def test_arm_stands_at_its_mount(robot):
    np.testing.assert_allclose(jnp.stack(mount_frame(robot).origin), oracle.MOUNT, atol=1e-7)


def test_shapes_of_batches(robot):
    position, rotation = jax.eval_shape(lambda: forward_kinematics(robot, jnp.zeros((3, 2, 6))))
    assert position.shape == (3, 2, 3)
    assert rotation.shape == (3, 2, 3, 3)
    assert jax.eval_shape(lambda: geometric_jacobian(robot, jnp.zeros((4, 6)))).shape == (4, 6, 6)
