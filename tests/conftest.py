from pathlib import Path

import hypothesis
import jax
import pytest

from basenet_jax.robot.reading import load_robot
from basenet_jax.world.scene import Table

jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parents[1] / ".jax_cache"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)

# The first example compiles, so it takes far longer than the others.
hypothesis.settings.register_profile("compiling", deadline=None)
hypothesis.settings.load_profile("compiling")


@pytest.fixture(scope="session")
def robot():
    return load_robot()


@pytest.fixture(scope="session")
def table():
    return Table.from_config()
