import threading

import pytest

from basenet_jax.viewer.timeline import FRAME_S, Timeline


@pytest.fixture
def shown():
    return []


@pytest.fixture
def timeline(shown):
    made = Timeline(shown.append, threading.RLock())
    made.end_s = 1.0
    yield made
    made.close()


def wait_until_still(timeline):
    while timeline.playing:
        threading.Event().wait(0.01)


def test_it_plays_to_the_end_and_stops_there(timeline, shown):
    timeline.speed = 4.0
    timeline.play()
    wait_until_still(timeline)
    assert shown[0] == pytest.approx(4.0 * FRAME_S)
    assert shown == sorted(shown)
    assert (shown[-1], timeline.time_s) == (1.0, 1.0)


def test_it_begins_anew_at_the_end(timeline, shown):
    timeline.go_to(7.0)
    assert timeline.time_s == 1.0
    timeline.speed = 5.0
    timeline.play()
    wait_until_still(timeline)
    assert shown[0] == pytest.approx(5.0 * FRAME_S)


def test_standing_still_it_shows_nothing(timeline, shown):
    timeline.go_to(0.5)
    threading.Event().wait(3 * FRAME_S)
    assert not shown
    assert timeline.time_s == 0.5


def test_nothing_can_be_played_without_a_plan(timeline, shown):
    timeline.end_s = 0.0
    timeline.play()
    assert not timeline.playing
    assert not shown
