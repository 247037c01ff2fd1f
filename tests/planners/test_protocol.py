"""Batches go to compiled programs in parts of few sizes."""

import jax
import numpy as np
import pytest

from basenet_jax.devices import ONE_DEVICE
from basenet_jax.planners.protocol import in_parts


@pytest.fixture(scope="module")
def batch(random_scene):
    """(number of scenes) -> scenes that are told apart by where the robot starts."""
    scene = random_scene(0)

    def make(count):
        scenes = jax.tree.map(lambda x: np.stack([np.asarray(x)] * count), scene)
        scenes.robot_start[:, 0] = np.arange(count)
        return scenes

    return make


@pytest.mark.parametrize(
    ("count", "sizes"),
    [(1, [1]), (2, [4]), (4, [4]), (5, [16]), (20, [20]), (45, [20, 20, 20])],
)
def test_parts_have_few_sizes_and_their_results_are_put_together(batch, count, sizes):
    seen = []

    def plan(scenes, keys):
        seen.append((len(scenes.mask), int(np.sum(np.any(np.asarray(scenes.mask), axis=1)))))
        return {"start": scenes.robot_start[:, 0], "key": jax.random.key_data(keys)}

    keys = jax.random.split(jax.random.key(0), count)
    made = in_parts(plan, batch(count), keys, devices=ONE_DEVICE, most=20)
    np.testing.assert_array_equal(made["start"], np.arange(count))
    np.testing.assert_array_equal(made["key"], jax.random.key_data(keys))
    assert [size for size, _ in seen] == sizes
    assert sum(full for _, full in seen) == count, "what a part is filled up with has no objects"
