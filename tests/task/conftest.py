import pytest

from tests.task import pick_cases


@pytest.fixture(scope="session")
def picks():
    return pick_cases.sample_picks()


@pytest.fixture(scope="session")
def expected(picks):
    return pick_cases.expect(picks)


@pytest.fixture(scope="session")
def result(robot, picks):
    return pick_cases.judge(robot, picks)
