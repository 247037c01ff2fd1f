from pathlib import Path

import pytest

from basenet_jax.viewer.editing import pad
from basenet_jax.viewer.planned import judge_plan
from basenet_jax.world.scene import NamedScene
from basenet_jax.world.scene_file import load_scene
from tests import judged
from tests.scene_texts import park_once

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "room.yaml"


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


@pytest.fixture(scope="session")
def room() -> NamedScene:
    """The documentation's room: two surfaces, two obstacles, a wall, a place to keep out of, and three objects."""
    return pad(load_scene(EXAMPLE))
