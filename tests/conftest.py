import ctypes
import gc
import resource
from pathlib import Path

import hypothesis
import jax
import pytest

from basenet_jax.robot.reading import load_robot
from basenet_jax.world.boxes import Room

pytest_plugins = ["tests.compilations"]

# The first example compiles, so it takes far longer than the others.
hypothesis.settings.register_profile("compiling", deadline=None)
hypothesis.settings.load_profile("compiling")


@pytest.fixture(scope="session")
def robot():
    return load_robot()


@pytest.fixture(scope="session")
def room():
    return Room.from_config()


@pytest.fixture(scope="module", autouse=True)
def little_memory():
    """Lets go of compiled programs before there are too many.

    Each takes some MB, and a few memory mappings, of which Linux allows a process 65,530; then the compiler aborts the
    interpreter.
    """
    yield
    mappings, pages = Path("/proc/self/maps"), Path("/proc/self/statm")
    if not mappings.exists():
        return
    resident = int(pages.read_text().split()[1]) * resource.getpagesize()
    if mappings.read_bytes().count(b"\n") > 20_000 or resident > 1.5e9:
        jax.clear_caches()
        gc.collect()
        ctypes.CDLL(None).malloc_trim(0)  # the C library keeps what was freed in small pieces
