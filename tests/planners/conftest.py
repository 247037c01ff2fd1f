import dataclasses

import jax
import numpy as np
import pytest

from basenet_jax.planners import basenet, reachability, refined
from basenet_jax.world.scene import BY_SLOT
from tests import compiled


@pytest.fixture(scope="session", autouse=True)
def cache_home(tmp_path_factory):
    """Keeps the tests' reachability maps out of the user's cache folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.delenv("BASENET_JAX_CACHE", raising=False)
        yield


@pytest.fixture(scope="module", autouse=True)
def one_check_of_candidates():
    """One program checks the candidates of all planners, padded; itself it is compared with single picks."""
    with pytest.MonkeyPatch.context() as patch:
        for planner in (basenet, reachability, refined):
            patch.setattr(planner, "check_candidates", compiled.check_candidates)
        yield


@pytest.fixture(scope="session")
def setup(robot):
    """A coarse grid: 20 cm and 90 degrees, about a thousand poses."""
    return compiled.make_setup(robot)


@pytest.fixture(scope="session")
def random_scene(room):
    """(seed, number of objects) -> a scene of six slots, on the host."""
    return lambda seed, count=compiled.SLOTS: compiled.draw_scene(seed, count, room)


@pytest.fixture(scope="session")
def hopeless():
    """(scene, slots) -> the scene with the grasps of these slots 1.5 m above their objects."""

    def make(scene, slots):
        pose = np.array(scene.object_grasps.pose)
        pose[list(slots), :, 2] = 1.5
        grasps = dataclasses.replace(scene.object_grasps, pose=pose)
        return dataclasses.replace(scene, object_grasps=grasps, object_class=np.full_like(scene.object_class, -1))

    return make


@pytest.fixture(scope="session")
def spoilt():
    """(scene) -> the scene with numbers that make no sense in its empty slots."""

    def make(scene):
        def spoil(x: np.ndarray) -> np.ndarray:
            changed = np.array(x)
            changed[~scene.mask] = 7
            return changed

        fields = {name: getattr(scene, name) for name in set(BY_SLOT) - {"mask"}}
        return dataclasses.replace(scene, **jax.tree.map(spoil, fields))

    return make


@pytest.fixture(scope="session")
def four_objects(random_scene):
    """A scene of four objects in six slots."""
    return random_scene(3, 4)
