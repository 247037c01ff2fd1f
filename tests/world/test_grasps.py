"""Grasps in their objects' frames and in W, beside SciPy's rotations; which of many are kept."""

from typing import Any

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from basenet_jax.world.grasps import Grasps, from_the_side, in_world, of_class, of_objects, padded, select, top_down
from basenet_jax.world.scene import OBJECT_CLASSES

_in_world = jax.jit(in_world)


def some(count, seed=0):
    """Any grasps of one object, on the host."""
    rng = np.random.default_rng(seed)
    pose = np.concatenate([rng.uniform(-0.3, 0.3, (count, 3)), rng.uniform(-3, 3, (count, 3))], axis=1)
    one: Any = np.ones(count, bool)
    leaves: Any = (pose.astype(np.float32), np.zeros(count, np.float32), one, one)
    return Grasps(*leaves)


def matrices(pose):
    """4 x 4, of poses as grasps have them."""
    result = np.tile(np.eye(4), (*pose.shape[:-1], 1, 1))
    result[..., :3, :3] = (
        Rotation.from_euler("ZYX", pose.reshape(-1, 6)[:, :2:-1]).as_matrix().reshape(*pose.shape[:-1], 3, 3)
    )
    result[..., :3, 3] = pose[..., :3]
    return result


def test_in_the_world_they_are_where_rigid_motions_take_them():
    objects = np.array([[0.4, -0.2, 0.7], [-1.0, 2.0, -2.5]], np.float32)
    size = np.array([[0.1, 0.1, 0.2], [0.05, 0.05, 0.3]], np.float32)
    height = np.array([0.75, 1.2], np.float32)
    grasps = of_objects([some(3), some(3, 1)])
    moved = _in_world(grasps, objects, size, height)
    z = height + size[:, 2] / 2
    frames = matrices(np.column_stack([objects[:, :2], z, np.zeros((2, 2)), objects[:, 2]]))
    expected = frames[:, None] @ matrices(grasps.pose.astype(float))
    np.testing.assert_allclose(matrices(np.asarray(moved.pose, float)), expected, atol=2e-6)
    np.testing.assert_array_equal(moved.there, grasps.there)


def test_top_down_the_tool_points_down():
    grasp = top_down(np.array([0.1, 0.2, 0.9, 0.5], np.float32), np)
    matrix = matrices(grasp.pose.astype(float))[0]
    np.testing.assert_allclose(matrix[:3, 2], [0, 0, -1], atol=1e-6)
    np.testing.assert_allclose(matrix[:3, 0], [np.cos(0.5), np.sin(0.5), 0], atol=1e-6)
    np.testing.assert_array_equal(grasp.planar, np.array([[0.1, 0.2, 0.9, 0.5]], np.float32))


def test_from_the_side_the_tool_points_at_the_centre_and_is_level():
    grasps = from_the_side(8, 0.25)
    matrix = matrices(grasps.pose.astype(float))
    np.testing.assert_allclose(matrix[:, :3, 3] + 0.25 * matrix[:, :3, 2], 0.0, atol=1e-6)
    np.testing.assert_allclose(matrix[:, 2, :3], np.tile([0.0, -1.0, 0.0], (8, 1)), atol=1e-6)
    np.testing.assert_allclose(matrix[0, :3, 2], [0, 1, 0], atol=1e-6)


def test_classes_have_side_grasps_only_where_they_are_asked_for():
    counts = {kind.name: [len(kind.grasps(sides=sides).there) for sides in (False, True)] for kind in OBJECT_CLASSES}
    tall = [1, 9]
    assert counts == {
        "cracker_box": tall,
        "bleach_cleanser": tall,
        "mustard_bottle": tall,
        "mug": [1, 1],
        "bowl": [1, 1],
    }
    kind = OBJECT_CLASSES[0]
    above = of_class(np.array((kind.grasp_x, kind.grasp_z, kind.grasp_yaw), np.float32), np)
    jax.tree.map(np.testing.assert_array_equal, kind.grasps(sides=True)[:1], above)


@pytest.mark.parametrize(("most", "size"), [(1, 1), (2, 4), (5, 16), (16, 16)])
def test_objects_of_a_scene_have_as_many_each(most, size):
    both = of_objects([some(1), some(most)])
    assert both.pose.shape == (2, size, 6)
    assert np.sum(both.there, axis=1).tolist() == [1, most]
    np.testing.assert_array_equal(both.pose[0], np.tile(some(1).pose, (size, 1)))


def test_padding_is_never_there():
    assert padded(some(2), 4).there.tolist() == [True, True, False, False]


def test_few_are_all_kept_in_their_order():
    assert select(some(5), np.arange(5.0), 16).tolist() == [0, 1, 2, 3, 4]


def test_of_many_the_best_comes_first_and_directions_differ():
    """Sixteen kept of 200 in eight directions: every direction, and of each the best score where it stands alone."""
    sides = from_the_side(8, 0.25)
    many = sides[np.tile(np.arange(8), 25)]
    score = np.random.default_rng(2).uniform(size=200)
    kept = select(many, score, 8)
    assert kept[0] == np.argmax(score)
    assert sorted(kept % 8) == list(range(8))
    assert all(score[index] == np.max(score[index % 8 :: 8]) for index in kept)
    np.testing.assert_array_equal(kept, select(many, score, 8))


def test_no_two_kept_are_nearer_than_one_left_out():
    """Farthest first: what is left out is as near to one that is kept as any two kept are to each other."""
    many = some(60, 5)
    kept = select(many, np.zeros(60), 16)
    axis = matrices(many.pose.astype(float))[:, :3, 2]
    apart = np.linalg.norm(many.pose[:, None, :3] - many.pose[:, :3], axis=-1) / 0.25
    apart += np.arccos(np.clip(axis @ axis.T, -1, 1))
    within = apart[np.ix_(kept, kept)] + 9 * np.eye(16)
    rest = np.setdiff1d(np.arange(60), kept)
    assert np.min(apart[np.ix_(rest, kept)], axis=1).max() <= within.min() + 1e-5
