"""Looking a base pose up in the map is rounding its pose in the tool's frame."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from basenet_jax.planners.reachability import ReachabilityMap, build_map, map_candidates
from basenet_jax.task.picking import Reason
from tests.regrasp import regrasp


def one_object(scene, x, y, yaw):
    """The scene with every object at this pose, and the grasp in its centre."""
    pose = np.tile(np.array([x, y, yaw], np.float32), (len(scene.mask), 1))

    def center(grasps: np.ndarray) -> None:
        grasps[..., [0, 1, 2, 5]] = 0

    return dataclasses.replace(regrasp(scene, center), object_pose=pose)


def in_world(tool, pose):
    """A pose in the tool's planar frame, in W."""
    cosine, sine = math.cos(tool[2]), math.sin(tool[2])
    return (
        tool[0] + cosine * pose[0] - sine * pose[1],
        tool[1] + sine * pose[0] + cosine * pose[1],
        tool[2] + pose[2],
    )


inside = st.floats(-0.499, 0.499)


@settings(max_examples=60)
@given(
    cell=st.tuples(st.integers(1, 13), st.integers(1, 13), st.integers(0, 7)),
    offset=st.tuples(inside, inside, inside),
    axis=st.integers(0, 2),
    sign=st.sampled_from([-1.0, 1.0]),
    tool=st.tuples(st.floats(-1, 1), st.floats(-0.4, 0.4), st.floats(-3.2, 3.2)),
)
def test_a_pose_belongs_to_the_bin_of_the_nearest_centre(random_scene, cell, offset, axis, sign, tool):
    """The same on either side of a centre, for negative cells as for positive ones, and round the circle."""
    reachable = np.zeros((6, 15, 15, 8), bool)
    reachable[(slice(None), *cell)] = True
    reach_map = ReachabilityMap(reachable, np.ones(6, np.float32), 0.1)
    beyond = np.array(offset)
    beyond[axis] = sign * 0.501
    step = np.array([0.1, 0.1, np.pi / 4])
    poses = [(np.array([cell[0] - 7, cell[1] - 7, cell[2]]) + shift) * step for shift in (np.array(offset), beyond)]
    scene = one_object(random_scene(0), *tool)
    world = np.array([in_world(tool, pose) for pose in poses], np.float32)
    serves = np.asarray(map_candidates(reach_map, scene, jnp.asarray(world)).serves)
    assert serves[0].all()
    assert not serves[1].any()


def look_up(reach_map, layer, grasp, pose):
    """The definition in plain Python; None where a coordinate is too near to the middle between two bins."""
    dx, dy, turn = pose[0] - grasp[0], pose[1] - grasp[1], pose[2] - grasp[3]
    cosine, sine = math.cos(grasp[3]), math.sin(grasp[3])
    turns = reach_map.reachable.shape[3]
    along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
    place = [along / reach_map.step_m, across / reach_map.step_m, turn * turns / (2 * math.pi)]
    if any(abs(value % 1 - 0.5) < 1e-4 for value in place):
        return None
    i, j, t = (round(value) for value in place)
    i, j = i + reach_map.origin, j + reach_map.origin
    side = len(reach_map.axis_m)
    return bool(0 <= i < side and 0 <= j < side and reach_map.reachable[layer, i, j, t % turns])


def test_candidates_are_looked_up_in_the_map(robot, random_scene, setup):
    scene = random_scene(1, count=5)
    heights = scene.first_grasp[:, 2].tolist()
    reach_map = build_map(robot, heights, setup.grid)
    poses = setup.grid_poses
    candidates = map_candidates(reach_map, scene, jnp.asarray(poses))
    grasps = np.asarray(scene.first_grasp, float)
    expected = [[look_up(reach_map, m, grasps[m], pose) for m in range(6)] for pose in poses.astype(float)]
    clear = np.array([[value is not None for value in row] for row in expected])
    expected = np.array([[bool(value) for value in row] for row in expected]) & scene.mask
    assert clear.mean() > 0.99
    np.testing.assert_array_equal(np.asarray(candidates.serves)[clear], expected[clear])
    assert 0.01 < expected.mean() < 0.5
    np.testing.assert_array_equal(candidates.base_pose, poses)
    np.testing.assert_array_equal(candidates.pick_time, np.where(candidates.serves, 0.0, np.inf))


def test_what_no_pose_serves_is_out_of_reach(robot, random_scene, hopeless, setup):
    scene = hopeless(random_scene(1, count=5), [1, 3])
    candidates = map_candidates(
        build_map(robot, scene.first_grasp[:, 2].tolist(), setup.grid), scene, jnp.asarray(setup.grid_poses)
    )
    lost = Reason.OUT_OF_REACH
    assert np.asarray(candidates.reason).tolist() == [0, lost, 0, lost, 0, 0], "an empty slot has no reason"
    assert not np.asarray(candidates.serves)[:, [1, 3, 5]].any()


def test_a_map_needs_one_layer_per_slot(robot, random_scene, setup):
    with pytest.raises(ValueError, match="found 3 layers, needs one for each of the scene's 6 slots"):
        map_candidates(build_map(robot, [1.0, 1.1, 1.2], setup.grid), random_scene(0), jnp.zeros((2, 3)))
