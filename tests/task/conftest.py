import pytest

from basenet_jax.robot.model import load_robot
from basenet_jax.world.scene import Table
from tests.task import pick_cases


@pytest.fixture(scope="session")
def robot():
    return load_robot()


@pytest.fixture(scope="session")
def table():
    return Table.from_config()


@pytest.fixture(scope="session")
def picks():
    return pick_cases.sample_picks()


@pytest.fixture(scope="session")
def expected(picks):
    return pick_cases.expect(picks)


@pytest.fixture(scope="session")
def result(robot, picks):
    return pick_cases.judge(robot, picks)
