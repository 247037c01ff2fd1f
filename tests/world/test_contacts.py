"""The arm beside objects: the kernel beside MuJoCo's contacts, object by object."""

import functools

import jax
import numpy as np
import pytest

from basenet_jax.world.contacts import boxes_touched
from basenet_jax.world.mujoco_scene import MujocoChecker
from tests import compiled
from tests.world.states import random_states

ROUNDING = 5e-6  # m
ROWS = 256

_touched = jax.jit(boxes_touched)


@pytest.mark.parametrize("count", [1_024, pytest.param(20_000, marks=pytest.mark.slow)])
def test_as_mujoco_judges_it(robot, room, count):
    scene = compiled.draw_scene(7, 6, room)
    states = random_states(np.random.default_rng(11), count).astype(np.float32)

    def touched(states):
        boxes = jax.tree.map(lambda x: np.broadcast_to(x, (len(states), *x.shape)), jax.device_get(scene.object_boxes))
        return _touched(jax.device_get(robot), tuple(states[:, :3].T), states[:, None, 3:].transpose(2, 1, 0), boxes)

    found = compiled.by_rows(touched, states, size=ROWS)
    checker, depth = MujocoChecker(robot, room, scene=scene), np.empty(found.shape)
    for slot in range(found.shape[1]):
        checker.stand(np.arange(found.shape[1]) == slot)
        depth[:, slot] = checker.distances(states[:, :3], states[:, 3:])[:, 2]
    assert np.sum(depth <= 0) > 5
    assert np.all(np.abs(depth[found != (depth <= 0)]) < ROUNDING)


def test_states_are_joined_and_padding_stands_nowhere(robot, room):
    """Touching in one of several states is touching; an object that isn't there isn't touched."""
    scene = compiled.draw_scene(7, 6, room)
    states = random_states(np.random.default_rng(11), 1_024).astype(np.float32)
    boxes = jax.device_get(scene.object_boxes)
    one = functools.partial(_touched, jax.device_get(robot))
    many = jax.tree.map(lambda x: np.broadcast_to(x, (ROWS, *x.shape)), boxes)
    pose, joints = tuple(states[:ROWS, :3].T), states[:ROWS, 3:].T
    apart = [np.asarray(one(pose, joints[:, None], many))]
    apart.append(np.asarray(one(pose, states[ROWS : 2 * ROWS, 3:].T[:, None], many)))
    both = np.stack([joints, states[ROWS : 2 * ROWS, 3:].T], axis=1)
    np.testing.assert_array_equal(np.asarray(one(pose, both, many)), apart[0] | apart[1])
    nobody = many.replace(blocks_arm=np.zeros_like(many.blocks_arm))
    assert not np.any(np.asarray(one(pose, both, nobody)))
