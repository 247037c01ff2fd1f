import pytest

from basenet_jax.viewer.editing import pad
from basenet_jax.viewer.planned import judge_plan
from basenet_jax.world.scene import NamedScene
from tests import judged
from tests.scene_texts import park_once


@pytest.fixture(scope="session")
def scene() -> NamedScene:
    """Two mugs, both of which can be picked from `judged.GOOD`."""
    return pad(NamedScene(judged.first(judged.scenes()), ("mug_1", "mug_2")))


@pytest.fixture(scope="session")
def planned(scene):
    """A plan that picks both, judged and set in motion."""
    made = judge_plan(scene, park_once(scene.arrays, None), "by hand", 0.002)
    assert int(made.outcome.grasped) == 2
    return made
