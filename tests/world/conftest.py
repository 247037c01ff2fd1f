import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.world import mujoco_scene
from basenet_jax.world.grasps import of_class
from basenet_jax.world.scene import Scene
from tests.world.states import random_states


@pytest.fixture(scope="module")
def states():
    return random_states(np.random.default_rng(3), 8000)


@pytest.fixture(scope="module")
def checker(robot, room):
    return mujoco_scene.MujocoChecker(robot, room)


@pytest.fixture(scope="module")
def distances(checker, states):
    return checker.distances(states[:, :3], states[:, 3:])


@pytest.fixture(scope="module")
def scene(room):
    """Two objects in three slots."""
    return Scene(
        object_pose=jnp.array([[0.5, 0.1, 0.7], [-0.3, -0.2, -1.0], [9.0, 9.0, 9.0]]),
        object_size=jnp.array([[0.06, 0.16, 0.21], [0.08, 0.08, 0.082], [1.0, 1.0, 1.0]]),
        object_grasps=of_class(jnp.zeros((3, 3))),
        object_class=jnp.array([0, 3, 0]),
        mask=jnp.array([True, True, False]),
        surface_height=jnp.full(3, room.table_height),
        robot_start=jnp.array([2.0, 1.0, -0.5]),
        room=room,
    )
