import pytest

from tests import judged


@pytest.fixture(scope="session")
def scene():
    return judged.first(judged.scenes())


@pytest.fixture(scope="session")
def plan():
    return judged.first(judged.plans())


@pytest.fixture(scope="session")
def outcome():
    return judged.first(judged.outcomes())
