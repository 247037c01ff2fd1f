import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.robot import ur
from basenet_jax.robot.kinematics import Frame
from tests.oracles import arm as oracle

# float64: angles are square roots of lengths near the borders of branches, hence 1e-7 for a last digit of 1e-15.
ANGLE, BORDER = 1e-6, 1e-7


def tops(rng, count):
    """Poses of a tool that points down, in a ring around the arm: some out of reach, some too near."""
    bearing, distance = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.05, 1.1, count)
    height, yaw = rng.uniform(-0.4, 0.9, count), rng.uniform(-np.pi, np.pi, count)
    where = zip(distance * np.cos(bearing), distance * np.sin(bearing), height, yaw, strict=True)
    return np.array([oracle.pose(x, y, z, turn) @ oracle.rotation_x(np.pi) for x, y, z, turn in where])


def reached(rng, count):
    """Poses of random joints."""
    return np.array([oracle.chain(q)[-1] for q in rng.uniform(-np.pi, np.pi, size=(count, 6))])


def scattered(rng, count):
    """Random orientations within and beyond reach."""
    poses = reached(rng, count)
    poses[:, :3, 3] = rng.uniform(-1.0, 1.0, size=(count, 3))
    return poses


SAMPLES = {"top-down": tops, "reachable": reached, "scattered": scattered}


@pytest.fixture(scope="module", params=sorted(SAMPLES))
def targets(request):
    return SAMPLES[request.param](np.random.default_rng(4), 250)


def frame(poses):
    columns = (tuple(jnp.asarray(poses[:, row, column]) for row in range(3)) for column in range(3))
    return Frame(*columns, origin=tuple(jnp.asarray(poses[:, row, 3]) for row in range(3)))


def branches(robot, poses):
    """Joints (8, N, 6) and shortfalls (8, N) of all branches in float64."""
    with jax.enable_x64(True):
        result = ur.closed_form(robot, frame(poses), ur.all_branches(1))
        shape = (ur.BRANCHES, len(poses))
        joints = [np.broadcast_to(q, (2, 2, 2, len(poses))).reshape(shape) for q in result.joints]
        shortfall = np.broadcast_to(result.shortfall, (2, 2, 2, len(poses))).reshape(shape)
    return np.stack(joints, axis=-1), shortfall


def distance(first, second):
    """Largest difference of joints, whole turns aside."""
    return np.abs((first - second + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


@pytest.fixture(scope="module")
def eaik():
    dh = pytest.importorskip("eaik.IK_DH", reason="needs EAIK")
    return dh.DhRobot(np.array(oracle.ALPHA), np.array(oracle.A), np.array(oracle.D))


def test_reached_branches_reproduce_the_target(robot, targets):
    joints, shortfall = branches(robot, targets)
    for branch, index in zip(*np.nonzero(shortfall == 0.0), strict=True):
        position, orientation = oracle.pose_error(joints[branch, index], targets[index])
        assert position < BORDER
        assert orientation < BORDER
    assert np.mean(shortfall == 0.0) > 0.2


def test_same_solutions_as_eaik(robot, targets, eaik):
    """None missing, none more; a branch whose border is nearer than float64's root isn't compared."""
    joints, shortfall = branches(robot, targets)
    compared = 0
    for index, pose in enumerate(targets):
        solution = eaik.IK(pose)
        expected = np.array([q for q, approximate in zip(solution.Q, solution.is_LS, strict=True) if not approximate])
        found = joints[shortfall[:, index] == 0.0, index]
        assert len(found) == len(expected)
        for q in expected:
            assert distance(found, q).min() < ANGLE
        for q in found:
            assert distance(expected, q).min() < ANGLE
        compared += len(expected)
    assert compared > 500


def test_shortfall_where_eaik_finds_nothing(robot, targets, eaik):
    _, shortfall = branches(robot, targets)
    nothing = np.array([all(eaik.IK(pose).is_LS) for pose in targets])
    assert np.all(shortfall[:, nothing] > 0.0)
    assert np.all((shortfall == 0.0).any(axis=0)[~nothing])


def test_same_solutions_as_ur_analytic_ik(robot, targets):
    ur_analytic_ik = pytest.importorskip("ur_analytic_ik", reason="its wheels are for Python 3.11 only")
    joints, shortfall = branches(robot, targets)
    for index, pose in enumerate(targets):
        found = joints[shortfall[:, index] == 0.0, index]
        expected = np.array(ur_analytic_ik.ur5e.inverse_kinematics(pose)).reshape(-1, 6)
        assert len(found) == len(expected)
        for q in expected:
            assert distance(found, q).min() < ANGLE


def test_shortfall_is_what_the_stretched_arm_misses(robot):
    """A top-down target 5 cm too far along the arm's plane: the wrist ends 5 cm short of it, stretched."""
    inside = oracle.chain(np.array([0.3, -0.4, 0.0, -1.2, -np.pi / 2, 0.1]))  # elbow straight
    outward = inside[3][:3, 3] - inside[1][:3, 3]
    pose = inside[-1].copy()
    pose[:3, 3] += 0.05 * outward / np.linalg.norm(outward)
    joints, shortfall = branches(robot, pose[None])
    best = np.argmin(shortfall[:, 0])
    assert shortfall[best, 0] == pytest.approx(0.05, abs=1e-9)
    position, orientation = oracle.pose_error(joints[best, 0], pose)
    assert position == pytest.approx(0.05, abs=1e-9)
    assert orientation < 1e-9


def test_shortfall_near_the_shoulder_axis(robot):
    """The wrist can't come nearer to joint 1's axis than d4: at 3 cm from it 10.33 cm are missing."""
    pose = oracle.pose(0.03, 0.0, 0.6, 0.0) @ oracle.rotation_x(np.pi)
    _, shortfall = branches(robot, pose[None])
    assert np.all(shortfall >= 0.1333 - 0.03 - 1e-9)


def test_single_precision(robot, targets):
    """Where the shortfall is 0 in float64, float32's joints reproduce the pose to the solver's tolerance and better.

    A root of float32's last digit near a stretched elbow costs 3e-4 rad, 0.1 mm at the tool.
    """
    _, shortfall = branches(robot, targets)
    result = jax.jit(ur.closed_form)(robot, frame(targets.astype(np.float32)), ur.all_branches(1))
    joints = np.stack([np.broadcast_to(q, (2, 2, 2, len(targets))).reshape(8, -1) for q in result.joints], axis=-1)
    # Where joints 4 and 6 nearly align their shares of the turn are known badly, but not their sum.
    for branch, index in zip(*np.nonzero(shortfall == 0.0), strict=True):
        position, orientation = oracle.pose_error(joints[branch, index].astype(float), targets[index])
        assert position < 3e-4
        assert orientation < 1e-3


def test_branch_numbers_and_axes_agree():
    numbers = ur.branch_signs(jnp.arange(ur.BRANCHES))
    axes = jnp.broadcast_arrays(*ur.all_branches(0))
    for by_number, by_axis in zip(numbers, axes, strict=True):
        np.testing.assert_array_equal(by_number, by_axis.reshape(-1))


def test_where_joints_4_and_6_align_two_wrists_are_chosen(robot):
    """Wrist 2 at 0 or pi: every such pose of the tool is reached, though one of its solutions was free to choose."""
    rng = np.random.default_rng(8)
    joints = rng.uniform(-np.pi, np.pi, (200, 6))
    joints[:, 4] = np.where(rng.uniform(size=200) < 0.5, 0.0, np.pi)
    poses = np.array([oracle.chain(q)[-1] for q in joints])
    found, shortfall = branches(robot, poses)
    errors = np.array([[oracle.pose_error(q, pose) for q, pose in zip(row, poses, strict=True)] for row in found])
    reached = (shortfall < BORDER) & (errors[..., 0] < BORDER) & (errors[..., 1] < ANGLE)
    assert np.all(np.sum(reached, axis=0) >= 2)
