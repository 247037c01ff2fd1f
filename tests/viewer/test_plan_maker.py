"""A plan that had to be compiled for is made again, so that the time shown is planning's alone."""

import dataclasses
import threading

import jax
import numpy as np
import pytest

from basenet_jax import api
from basenet_jax.planners import registry
from basenet_jax.viewer.plan_maker import PlanMaker
from basenet_jax.viewer.planned import Choices, Planned
from basenet_jax.world.boxes import Room
from tests.scene_texts import park_once
from tests.viewer import WATCHDOG_S


@pytest.fixture
def maker(monkeypatch):
    """With a planner that compiles anew for each table and number of objects; and how often it was called here."""
    calls, here = [], threading.get_ident()

    def make(name, setup, options):
        del name, setup, options
        compiled = jax.jit(lambda x: x + 1)

        def plan(scene, key):
            if threading.get_ident() == here:
                calls.append(scene)
            compiled(np.zeros(1 + int(np.sum(scene.mask))))
            return park_once(scene, key)

        return plan

    monkeypatch.setattr(registry, "make_planner", make)
    api._planner.cache_clear()
    made = PlanMaker(Choices(), lambda _: None, lambda error: pytest.fail(str(error)))
    yield made, calls
    assert made.wait_idle(WATCHDOG_S)
    assert made.close()
    api._planner.cache_clear()


def test_what_compiles_for_a_table_or_a_number_of_objects_is_planned_again(maker, scene):
    made, calls = maker
    slots = len(scene.arrays.mask)
    high = Room.of_table(scene.arrays.room.table_half_size, scene.arrays.room.table_height + 0.05)
    one = dataclasses.replace(scene.arrays, mask=np.arange(slots) < 1)
    variants = {
        "first": scene,
        "table": dataclasses.replace(scene, arrays=dataclasses.replace(scene.arrays, room=high)),
        "count": dataclasses.replace(scene, arrays=one, names=scene.names[:1]),
    }
    for name, variant in variants.items():
        for expected in (2, 1, 1):
            calls.clear()
            assert isinstance(made.make("dp", variant), Planned)
            assert len(calls) == expected, name
