import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.config import GridConfig
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.world.generate import draw_scene

SLOTS = 6  # of the tests' scenes, so that each planner compiles once


@pytest.fixture(scope="session", autouse=True)
def cache_home(tmp_path_factory):
    """Keeps the tests' reachability maps out of the user's cache folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.delenv("BASENET_JAX_CACHE", raising=False)
        yield


@pytest.fixture(scope="session")
def setup(robot):
    """A coarse grid: 20 cm and 90 degrees, about a thousand poses."""
    return PlannerSetup(robot=jax.device_put(robot), grid=GridConfig(step_m=0.2, turns=4))


@pytest.fixture(scope="session")
def random_scene(table):
    """(seed, number of objects, number of slots) -> a scene on the host."""
    draw = jax.jit(draw_scene, static_argnames="slots")

    def make(seed, count=SLOTS, slots=SLOTS):
        scene, placed = draw(jax.random.key(seed), count, table, slots=slots)
        assert placed
        return jax.device_get(scene)

    return make


@pytest.fixture(scope="session")
def hopeless():
    """(scene, slots) -> the scene with the grasps of these slots 1.5 m above their objects."""

    def make(scene, slots):
        grasp = np.array(scene.object_grasp)
        grasp[list(slots), 1] = 1.5
        return dataclasses.replace(scene, object_grasp=grasp, object_class=np.full_like(scene.object_class, -1))

    return make


@pytest.fixture(scope="session")
def padded():
    """(scene, slots) -> the scene with so many slots, the empty ones full of numbers that make no sense."""

    def make(scene, slots):
        used = np.flatnonzero(scene.mask)
        fields = {}
        for name in ("object_pose", "object_size", "object_grasp", "object_class", "mask"):
            value = np.asarray(getattr(scene, name))
            fields[name] = np.full((slots, *value.shape[1:]), 0 if value.dtype == bool else 7, value.dtype)
            fields[name][: len(used)] = value[used]
        return dataclasses.replace(scene, **fields)

    return make


@pytest.fixture(scope="session")
def four_objects(random_scene):
    """A scene of four objects in four slots."""
    return jax.device_put(random_scene(3, 4, 4))
