"""Ways to pick among objects that stand close, beside picks with some of them gone: all subsets."""

import dataclasses
import functools
import itertools

import jax
import numpy as np
import pytest

from basenet_jax.config import PickConfig
from basenet_jax.task.gripper_blockers import gripper_blockers
from basenet_jax.task.picking import Ways, pick, ways_to_pick
from basenet_jax.world.boxes import Room
from basenet_jax.world.grasps import from_the_side, of_class, of_objects, together
from tests import compiled

OBJECTS, WAYS, ROWS = 4, 5, 64
CONFIG = PickConfig(object_in_the_way="on", arm_hits_itself="on", near_singular="on")

_ways = jax.jit(ways_to_pick, static_argnames=("config", "ways"))
_pick = jax.jit(pick, static_argnames="config")
_gripper_blockers = jax.jit(gripper_blockers, static_argnames="config")


@pytest.fixture(scope="module")
def crowd(room):
    """Four bottles in a row along the table's edge, which can be held from above and from four sides."""
    scene = compiled.draw_scene(0, OBJECTS, room, slots=OBJECTS)
    pose = np.array([[0.0, -0.3, 0.1], [0.1, -0.3, 0.0], [0.05, -0.2, 0.4], [0.18, -0.24, 1.0]], np.float32)
    size = np.tile(np.array([0.06, 0.06, 0.26], np.float32), (OBJECTS, 1))
    size[2, 2] = 0.36
    above = of_class(np.array([0.0, 0.34, 0.0], np.float32), np)
    grasps = of_objects([together([above, from_the_side(3, 0.25)])] * OBJECTS)
    return dataclasses.replace(scene, object_pose=pose, object_size=size, object_grasps=grasps)


@pytest.fixture(scope="module")
def base_poses():
    """Beside the table's long side, more or less in line with it."""
    rng = np.random.default_rng(3)
    poses = rng.uniform([-0.6, -0.95, -0.4], [0.8, -0.78, 0.4], (ROWS // OBJECTS, 3))
    poses[::2, 2] += np.pi
    return poses.astype(np.float32)


def pairs(crowd, base_poses):
    """Base poses, grasps and other objects of all pairs, as rows."""
    pose = np.repeat(base_poses, OBJECTS, axis=0)
    slot = np.tile(np.arange(OBJECTS), len(base_poses))
    boxes = jax.tree.map(lambda x: np.broadcast_to(x, (ROWS, *x.shape)), jax.device_get(crowd.object_boxes))
    boxes = dataclasses.replace(boxes, blocks_arm=boxes.blocks_arm & (np.arange(OBJECTS) != slot[:, None]))
    return pose, jax.device_get(crowd.grasps)[slot], boxes


@pytest.fixture(scope="module")
def ways(robot, room, crowd, base_poses) -> Ways:
    pose, grasps, boxes = pairs(crowd, base_poses)
    return jax.device_get(_ways(robot, pose, grasps, room, boxes, config=CONFIG, ways=WAYS))


def test_whatever_is_gone_the_best_way_left_is_the_fastest_pick(robot, room, crowd, base_poses, ways):
    pose, grasps, boxes = pairs(crowd, base_poses)
    for gone in itertools.product((False, True), repeat=OBJECTS):
        left = dataclasses.replace(boxes, blocks_arm=boxes.blocks_arm & ~np.array(gone))
        picks = _pick(robot, pose, grasps, room, config=CONFIG, neighbours=left)
        open_ways = ~np.any(ways.blockers & ~np.array(gone), axis=-1)
        best = np.min(np.where(open_ways, ways.time, np.inf), axis=-1)
        np.testing.assert_allclose(best, np.where(picks.feasible, picks.time, np.inf), atol=0.02)


def test_the_scene_is_what_these_tests_need(ways):
    several = np.sum(np.isfinite(ways.time), axis=-1)
    assert np.sum(several > 1) >= 5
    assert np.sum(np.all(np.any(ways.blockers, -1) | ~np.isfinite(ways.time), -1) & (several > 0)) >= 3, (
        "some must wait"
    )


def test_each_way_needs_something_less_than_all_before(ways):
    for time, blockers in zip(ways.time, ways.blockers, strict=True):
        there = int(np.sum(np.isfinite(time)))
        assert np.all(np.diff(time[:there]) >= -0.02)
        for first, second in itertools.combinations(blockers[:there], 2):
            assert np.any(first & ~second)


def test_fewer_ways_keep_the_fastest_and_the_one_that_needs_fewest(robot, room, crowd, base_poses, ways):
    pose, grasps, boxes = pairs(crowd, base_poses)
    two = jax.device_get(_ways(robot, pose, grasps, room, boxes, config=CONFIG, ways=2))
    np.testing.assert_allclose(two.time[:, 0], ways.time[:, 0], atol=1e-5)
    needs = np.where(np.isfinite(ways.time), ways.blockers.sum(-1), 99)
    kept = np.where(np.isfinite(two.time), two.blockers.sum(-1), 99)
    np.testing.assert_array_equal(kept.min(axis=1), needs.min(axis=1))
    np.testing.assert_array_equal(two.reason, ways.reason)


def test_a_room_says_whether_the_rules_hold(robot, room, crowd, base_poses):
    """By the room's word, or switched on in the paper's: the same picks."""
    pose, grasps, boxes = pairs(crowd, base_poses)
    own = functools.partial(_pick, robot, pose, grasps)
    cluttered = Room(room.boxes, room.floor, cluttered=True)
    switched = own(room, config=CONFIG, neighbours=boxes)
    by_room = own(cluttered, config=PickConfig(object_in_the_way="by-room"), neighbours=boxes)
    jax.tree.map(np.testing.assert_array_equal, switched, by_room)
    free = own(room, config=PickConfig(), neighbours=boxes)
    assert np.sum(free.feasible) > np.sum(switched.feasible)


def test_what_grippers_touch_in_any_case_only_spares_work(robot, room, crowd, base_poses, ways):
    """The same ways; and grasps that touch a neighbour wherever the arm is are some, not all."""
    pose, grasps, boxes = pairs(crowd, base_poses)
    needed = np.asarray(_gripper_blockers(robot, crowd.grasps, crowd.object_boxes, config=CONFIG))
    others = ~np.eye(OBJECTS, dtype=bool)[:, None, None]
    share = np.mean(np.any(needed & others, axis=-1)[np.asarray(crowd.grasps.there)])
    assert 0.1 < share < 0.9
    slot = np.tile(np.arange(OBJECTS), len(base_poses))
    spared = jax.device_get(
        _ways(robot, pose, grasps, room, boxes, config=CONFIG, ways=WAYS, needed=(needed & others)[slot])
    )
    jax.tree.map(np.testing.assert_array_equal, spared, ways)
