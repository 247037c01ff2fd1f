"""The stopwatch: the first call is compiling, the median of the others is the planning time."""

import jax
import pytest

from basenet_jax.planners import timed
from tests import compiled
from tests.scene_texts import park_once


class Dawdler:
    """Plans in given times (s) of its own clock, the last one again and again; so no test waits or depends on load."""

    def __init__(self, *durations):
        self.durations, self.keys, self.now = list(durations), [], 0.0

    def perf_counter(self):
        return self.now

    def __call__(self, scene, key):
        self.now += self.durations.pop(0) if len(self.durations) > 1 else self.durations[0]
        self.keys.append(int(jax.random.key_data(key)[-1]))
        return park_once(scene, key)


@pytest.fixture
def scene(room):
    return compiled.draw_scene(0, 2, room, slots=2)


@pytest.fixture
def make_planner(monkeypatch):
    def make(*durations):
        planner = Dawdler(*durations)
        monkeypatch.setattr(timed, "time", planner)
        return planner

    return make


def test_compiling_and_one_slow_call_do_not_count(scene, make_planner):
    planner = make_planner(0.5, 0.05, 0.2, 0.05)
    result = timed.plan_timed(planner, scene, jax.random.key(7), repeats=5, patience_s=9.0)
    assert planner.keys == [7] * 6
    assert result.planning_time_s == pytest.approx(0.05)
    assert result.compile_time_s == pytest.approx(0.45)
    assert result.plan.object_index.tolist() == [0, 1]


def test_patience_ends_the_repeats(scene, make_planner):
    planner = make_planner(0.06)
    timed.plan_timed(planner, scene, jax.random.key(0), repeats=50, patience_s=0.1)
    assert len(planner.keys) == 3
