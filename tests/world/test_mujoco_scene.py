import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.robot.robot_mjcf import capsule_name
from basenet_jax.world import mujoco_scene
from basenet_jax.world.boxes import Room
from tests import compiled
from tests.world.states import TOUCHING, around_touching, doubtful


def base_kernel(robot, room, dtype: Any = np.float32):
    return lambda states: compiled.base_collides(robot, states[:, :3].astype(dtype), room)


def arm_kernel(robot, room, dtype: Any = np.float32):
    return lambda states: compiled.arm_collides(robot, states[:, :3].astype(dtype), states[:, 3:].astype(dtype), room)


def test_only_the_pairs_of_the_rules_can_touch(checker, robot):
    model = checker.model
    pairs = {
        frozenset((model.geom(a).name, model.geom(b).name))
        for a, b in zip(model.pair_geom1, model.pair_geom2, strict=True)
    }
    capsules = [f"robot/{capsule_name(index)}" for index in range(8)]
    assert len(robot.capsule_radius) == 8
    expected = {frozenset(pair) for pair in itertools.product(capsules, ("box 0", "robot/body"))}
    assert pairs == expected | {frozenset(("footprint", "keep out 0"))}
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


def test_base_kernel_agrees_with_mujoco(robot, room, states, distances):
    touches = base_kernel(robot, room)(states)
    clear = ~doubtful(distances[:, 0], TOUCHING)
    np.testing.assert_array_equal(touches[clear], distances[clear, 0] <= TOUCHING)
    assert 0.3 < touches.mean() < 0.6  # both answers are tested


def test_arm_kernel_agrees_with_mujoco(robot, room, states, distances):
    touches = arm_kernel(robot, room)(states)
    clear = ~doubtful(distances[:, 1], 0.0)
    np.testing.assert_array_equal(touches[clear], distances[clear, 1] <= 0.0)
    assert 0.2 < touches.mean() < 0.5


@pytest.mark.parametrize("apart", [1e-3, 1e-8])
def test_kernels_agree_with_mujoco_around_touching(robot, states, apart):
    with jax.enable_x64(True):
        room = Room.from_config()
        checker = mujoco_scene.MujocoChecker(robot, room)
        base = around_touching(base_kernel(robot, room, float), states, 1000, apart)
        arm = around_touching(arm_kernel(robot, room, float), states, 1000, apart)
    for side, touching in enumerate((True, False)):
        np.testing.assert_array_equal(checker.base_touches(base[side][:, :3]), touching)
        # The straight line into a body can leave it again within `apart`: at 1e-3 rad never seen.
        np.testing.assert_array_equal(checker.arm_touches(arm[side][:, :3], arm[side][:, 3:]), touching)


@pytest.mark.parametrize(("extra", "touching"), [(0.0, True), (0.9e-5, True), (1.1e-5, False)])
def test_rule_1_counts_a_clearance_of_a_hundredth_of_a_millimetre_as_touching(checker, extra, touching):
    pose = np.array([[0.0, 0.4 + 0.1 + 0.25 + extra, 0.0], [1.0 + 0.1 + 0.4 + extra, 0.0, np.pi]])
    np.testing.assert_array_equal(checker.base_touches(pose), touching)


def test_another_table_moves_the_boundary(robot, states):
    low = Room.of_table(half_size=jnp.array([0.5, 0.3]), height=jnp.array(0.4))
    checker = mujoco_scene.MujocoChecker(robot, low)
    distance = checker.distances(states[:2000, :3], states[:2000, 3:])
    clear = ~doubtful(distance[:, 1], 0.0)
    touches = arm_kernel(robot, low)(states[:2000])
    np.testing.assert_array_equal(touches[clear], distance[clear, 1] <= 0.0)


def test_scene_model_shows_objects_in_their_sizes(robot, scene):
    model, data = mujoco_scene.scene_model(robot, scene)
    geom = model.geom("object 1").id
    np.testing.assert_allclose(model.geom_size[geom], [0.04, 0.04, 0.041], atol=1e-7)
    np.testing.assert_allclose(data.geom_xpos[geom], [-0.3, -0.2, 0.75 + 0.041], atol=1e-6)
    assert "object 2" not in [model.geom(index).name for index in range(model.ngeom)]
