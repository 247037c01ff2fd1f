"""The map holds what an independent solver finds."""

import numpy as np
import pytest

from basenet_jax.config import GridConfig, PickConfig
from basenet_jax.planners import reachability
from basenet_jax.planners.reachability import build_map, map_shape
from tests import compiled
from tests.oracles import arm as oracle
from tests.oracles.picking import tool_target

HEIGHTS = (1.0665, 1.155, 1.4)
# What a tolerance of 1 mm and 0.5 degrees can add to the reach, and more.
DOUBT = 3e-3  # m


@pytest.fixture(scope="module")
def eaik():
    dh = pytest.importorskip("eaik.IK_DH", reason="needs EAIK")
    return dh.DhRobot(np.array(oracle.ALPHA), np.array(oracle.A), np.array(oracle.D))


@pytest.fixture(scope="module")
def maps(robot):
    return build_map(robot, HEIGHTS, compiled.GRID)


def within_limits(q, lower, upper):
    """Whether some 2 pi-equivalent of each joint is inside its limits."""
    turns = 2 * np.pi * np.arange(-2, 3)[:, None]
    return bool(np.all(np.any((q + turns >= lower) & (q + turns <= upper), axis=0)))


def reached(eaik, pose, height, lower, upper, yaws):
    """Whether EAIK finds joints; None where this changes within a few millimetres of the grasp."""
    verdicts = set()
    for shift in (np.zeros(3), *(DOUBT * np.eye(3)), *(-DOUBT * np.eye(3))):
        found = False
        for yaw in yaws:
            solution = eaik.IK(tool_target(pose, (*shift[:2], height + shift[2], yaw), 0.0))
            exact = [q for q, approximate in zip(solution.Q, solution.is_LS, strict=True) if not approximate]
            found = found or any(within_limits(q, lower, upper) for q in exact)
        verdicts.add(found)
    return verdicts.pop() if len(verdicts) == 1 else None


def check_against_eaik(eaik, maps, robot, yaws, count=250):
    """On random bins, half of them reachable by the map."""
    rng = np.random.default_rng(3)
    lower, upper = np.asarray(robot.joint_lower), np.asarray(robot.joint_upper)
    compared = tried = 0
    for layer, height in zip(maps.reachable, maps.height, strict=True):
        bins = np.concatenate([rng.permutation(np.argwhere(layer == value))[:count] for value in (True, False)])
        assert len(bins) > count
        for i, j, t in bins:
            expected = reached(eaik, (maps.axis_m[i], maps.axis_m[j], maps.heading[t]), height, lower, upper, yaws)
            assert expected is None or expected == layer[i, j, t], (height, i, j, t)
            compared += expected is not None
        tried += len(bins)
    assert compared > 0.95 * tried


def test_same_bins_as_eaik(eaik, maps, robot):
    check_against_eaik(eaik, maps, robot, yaws=(0.0,))


def test_joint_limits_count_and_a_symmetric_gripper_has_two_ways(eaik, robot):
    """With wrist 3 kept to half a turn every bin is reached in one of the gripper's yaws at best."""
    limited = robot.replace(
        joint_lower=robot.joint_lower * (1, 1, 1, 1, 1, 0.0), joint_upper=robot.joint_upper * (1, 1, 1, 1, 1, 0.5)
    )
    both = build_map(limited, HEIGHTS[:1], compiled.GRID)
    one = build_map(limited, HEIGHTS[:1], compiled.GRID, PickConfig(gripper_symmetric=False))
    check_against_eaik(eaik, both, limited, yaws=(0.0, np.pi))
    check_against_eaik(eaik, one, limited, yaws=(0.0,))
    assert np.all(both.reachable >= one.reachable)
    assert both.reachable.sum() > 1.2 * one.reachable.sum()


@pytest.mark.slow
def test_an_arm_without_closed_form_has_the_same_map(robot):
    """But for bins at the edge, where solvers may use the tolerances differently."""
    heights, grid = HEIGHTS[1:2], GridConfig(step_m=0.35, turns=2)
    expected = build_map(robot, heights, grid)
    found = build_map(robot.replace(closed_form=None), heights, grid)
    different = int(np.sum(found.reachable != expected.reachable))
    assert expected.reachable.sum() > 15
    assert different <= 1


def test_a_layer_does_not_depend_on_the_others(maps, robot):
    alone = build_map(robot, HEIGHTS[1:2], compiled.GRID)
    np.testing.assert_array_equal(alone.reachable[0], maps.reachable[1])


def test_one_compilation_for_any_number_of_heights(robot):
    programs = reachability._sweep._cache_size  # pyright: ignore[reportAttributeAccessIssue]
    build_map(robot, HEIGHTS[:1], compiled.GRID)
    before = programs()
    for count in (7, 3, 0):
        assert len(build_map(robot, np.linspace(0.8, 1.4, count).tolist(), compiled.GRID).reachable) == count
    assert programs() == before > 0


def test_the_window_has_an_unreachable_border(robot, maps):
    border = np.ones(maps.reachable.shape[1:], bool)
    border[1:-1, 1:-1] = False
    assert maps.reachable.shape[1:] == map_shape(robot, compiled.GRID)
    assert not maps.reachable[:, border].any()
    assert maps.reachable.any(axis=(1, 2, 3)).all()


def test_no_joints_reach_the_border(robot):
    """Also where a joint slides."""
    rng = np.random.default_rng(5)
    for arm in (robot, robot.replace(prismatic=(False, True, *(4 * [False])))):
        half = map_shape(arm, GridConfig(step_m=0.02))[0] // 2
        joints = rng.uniform(arm.joint_lower, arm.joint_upper, (5_000, robot.dof))
        position, _ = compiled.forward_kinematics(arm, joints)
        distance = np.hypot(*(np.asarray(position)[:, :2] + robot.mount_position[:2]).T)
        assert distance.max() < half * 0.02
        assert distance.max() > 0.7 * half * 0.02, "the window is far too large"


def test_centres_are_multiples_of_the_step(maps):
    assert maps.axis_m[maps.origin] == 0.0
    np.testing.assert_allclose(np.diff(maps.axis_m), 0.2)
    assert len(maps.axis_m) == maps.reachable.shape[1] == maps.reachable.shape[2]
    np.testing.assert_allclose(maps.heading, np.arange(4) * np.pi / 2)
