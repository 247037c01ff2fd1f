"""The planning grid and the check of all pairs, against loops over single poses and picks."""

import math

import numpy as np
import pytest

from basenet_jax.config import GridConfig, TableConfig
from basenet_jax.planners.candidates import grid_poses
from basenet_jax.task.picking import Reason
from basenet_jax.world.boxes import Room
from tests import compiled
from tests.oracles import picking as oracle
from tests.oracles.clearance import base_clearance
from tests.task import pick_cases


@pytest.mark.parametrize(
    ("grid", "size"),
    [
        (GridConfig(step_m=0.2, turns=4), (2.0, 0.8)),
        (GridConfig(step_m=0.3, turns=5, half_size_m=(1.9, 1.0)), (1.2, 0.6)),
    ],
)
def test_all_clear_poses_of_the_grid(robot, grid, size):
    """The grid as it is defined: integer multiples, zero included, up to the half sizes; rule 1 by polygons."""
    expected = []
    for i in range(-30, 31):
        for j in range(-30, 31):
            x, y = i * grid.step_m, j * grid.step_m
            if abs(x) > grid.half_size_m[0] + 1e-9 or abs(y) > grid.half_size_m[1] + 1e-9:
                continue
            poses = [(x, y, t * 2 * math.pi / grid.turns) for t in range(grid.turns)]
            expected += [pose for pose in poses if base_clearance(pose, size) > 1e-5]
    found = grid_poses(robot, Room.from_config(TableConfig(length_m=size[0], width_m=size[1])), grid)
    assert found.shape == (len(expected), 3)
    assert found.dtype == np.float32
    assert found[:, 2].min() > -math.pi - 1e-6
    assert found[:, 2].max() < math.pi + 1e-6
    turn = 2 * math.pi

    def keys(poses):
        return {(round(x, 3), round(y, 3), round((h + 1e-4) % turn, 2)) for x, y, h in np.asarray(poses, float)}

    assert keys(found) == keys(expected)


def test_the_papers_grid(robot, room):
    poses = grid_poses(robot, room)
    assert len(poses) == 7736
    assert np.abs(poses[:, 0]).max() == pytest.approx(2.2)
    assert np.abs(poses[:, 1]).max() == pytest.approx(1.6)


@pytest.fixture(scope="module")
def scene(random_scene, hopeless):
    """Five objects, the last of them out of reach, and an empty slot."""
    return hopeless(random_scene(7, count=5), [4])


@pytest.fixture(scope="module")
def candidates(setup, scene):
    return compiled.check_candidates(setup.robot, scene, setup.grid_poses, setup.world)


def test_pairs_are_as_picked_one_by_one(setup, robot, scene, candidates):
    """Against `pick` without the sorting out of far pairs, on a sample of them and on all served ones."""
    rng = np.random.default_rng(2)
    for slot in range(5):
        served = np.flatnonzero(candidates.serves[:, slot])
        rows = np.concatenate([served, rng.permutation(len(setup.grid_poses))[:256]])
        grasp = np.asarray(scene.first_grasp)[slot]
        expected = pick_cases.judge(robot, pick_cases.cases(setup.grid_poses[rows], grasp))
        np.testing.assert_array_equal(candidates.serves[rows, slot], expected.feasible)
        time = np.where(expected.feasible, expected.time, np.inf)
        np.testing.assert_allclose(candidates.pick_time[rows, slot], time, atol=pick_cases.FLOAT32_BOUND)
    assert candidates.serves[:, :4].any(axis=0).all()
    np.testing.assert_array_equal(candidates.base_pose, setup.grid_poses)


def test_pairs_are_the_oracles(scene, candidates):
    """A sample against the enumeration in plain Python: served ones, and ones near by that are not."""
    rng = np.random.default_rng(1)
    grasps = np.asarray(scene.first_grasp, float)
    compared = 0
    for slot in range(4):
        near = np.hypot(*(candidates.base_pose[:, :2] - grasps[slot, :2]).T) < 1.2
        served = candidates.serves[:, slot]
        rows = [rng.permutation(np.flatnonzero(kind))[:5] for kind in (served, near & ~served)]
        for row in np.concatenate(rows):
            pose = candidates.base_pose[row].astype(float)
            strict, generous = (oracle.pick(pose, grasps[slot], oracle.World(slack=slack)) for slack in (-1, 1))
            if (strict.reason is None) != (generous.reason is None):
                continue  # decided by rounding
            assert served[row] == (strict.reason is None)
            compared += 1
    assert compared > 30


def test_empty_slots_are_never_served(candidates):
    assert not candidates.serves[:, 5].any()
    assert np.isinf(candidates.pick_time[:, 5]).all()


def test_the_reason_is_the_rule_reached_farthest(candidates):
    assert candidates.reason[4] == Reason.OUT_OF_REACH
    assert not candidates.serves[:, 4].any()
