"""The stopwatch: the first call is compiling, the median of the others is the planning time."""

import time

import jax
import pytest

from basenet_jax.planners.timed import plan_timed
from basenet_jax.world.generate import draw_scene
from tests.scene_texts import park_once


class Sleeper:
    """Plans after pauses of given lengths (s), the last one again and again."""

    def __init__(self, *pauses):
        self.pauses, self.keys = list(pauses), []

    def __call__(self, scene, key):
        time.sleep(self.pauses.pop(0) if len(self.pauses) > 1 else self.pauses[0])
        self.keys.append(int(jax.random.key_data(key)[-1]))
        return park_once(scene, key)


@pytest.fixture
def scene(table):
    return draw_scene(jax.random.key(0), 2, table, slots=2)[0]


def test_compiling_and_one_slow_call_do_not_count(scene):
    park_once(scene, None)  # its own operations are compiled now
    planner = Sleeper(0.5, 0.05, 0.2, 0.05)
    timed = plan_timed(planner, scene, jax.random.key(7), repeats=5, patience_s=9.0)
    assert planner.keys == [7] * 6
    assert 0.05 <= timed.planning_time_s < 0.15
    assert timed.compile_time_s == pytest.approx(0.45, abs=0.15)
    assert timed.plan.object_index.tolist() == [0, 1]


def test_patience_ends_the_repeats(scene):
    planner = Sleeper(0.06)
    plan_timed(planner, scene, jax.random.key(0), repeats=50, patience_s=0.1)
    assert len(planner.keys) == 3
