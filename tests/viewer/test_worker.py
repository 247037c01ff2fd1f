"""The newest wish of a kind is done, whatever was asked for in between; and nothing stops the thread."""

import threading

import pytest

from basenet_jax.viewer.worker import Worker
from tests.viewer import WATCHDOG_S


@pytest.fixture
def errors():
    return []


@pytest.fixture
def worker(errors):
    made = Worker(errors.append)
    yield made
    assert made.close(WATCHDOG_S)


def test_only_the_newest_of_the_waiting_jobs_is_done(worker):
    begun, go_on, done = threading.Event(), threading.Event(), []

    def first():
        begun.set()
        assert go_on.wait(WATCHDOG_S)
        done.append("first")

    worker.submit("plan", first)
    assert begun.wait(WATCHDOG_S)
    for number in range(100):
        worker.submit("plan", lambda number=number: done.append(number))
    worker.submit("ask", lambda: done.append("asked"))
    assert worker.is_waiting("plan")
    assert not worker.wait_idle(0.01)
    go_on.set()
    assert worker.wait_idle(WATCHDOG_S)
    assert not worker.is_waiting("plan")
    assert done == ["first", 99, "asked"]


def test_an_error_is_reported_and_the_next_job_done(worker, errors):
    done = threading.Event()
    worker.submit("plan", lambda: 1 / 0)
    assert worker.wait_idle(WATCHDOG_S)
    worker.submit("plan", done.set)
    assert worker.wait_idle(WATCHDOG_S)
    assert done.is_set()
    assert [type(error) for error in errors] == [ZeroDivisionError]


def test_closing_drops_what_waits_and_says_whether_something_goes_on():
    begun, go_on, done = threading.Event(), threading.Event(), []
    worker = Worker(done.append)

    def stubborn():
        begun.set()
        assert go_on.wait(WATCHDOG_S)

    worker.submit("plan", stubborn)
    assert begun.wait(WATCHDOG_S)
    worker.submit("plan", lambda: done.append("dropped"))
    assert not worker.close(timeout_s=0.05)
    go_on.set()
    assert worker.close(timeout_s=WATCHDOG_S)
    assert not done
