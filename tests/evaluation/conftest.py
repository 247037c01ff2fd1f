import jax
import pytest

from basenet_jax.planners.protocol import PlannerSetup
from tests import judged


@pytest.fixture(scope="session")
def setup(robot):
    return PlannerSetup(robot=jax.device_put(robot))


@pytest.fixture(scope="session")
def batch():
    return judged.scenes()


@pytest.fixture(scope="session")
def plans():
    return judged.plans()


@pytest.fixture(scope="session")
def outcomes():
    return judged.outcomes()
