"""Planners that need no weights, map or compilation, for tests of what is done with plans."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from basenet_jax.planners.protocol import PlannerSetup, PlanningError
from basenet_jax.task.plan import Plan
from tests.judged import GOOD

FAR = np.array([-2.0, 1.5, 0.0], np.float32)  # reaches nothing


class Fixed:
    """Picks the objects in their order, each from the pose of its slot."""

    def __init__(self, setup: PlannerSetup, poses=(GOOD, GOOD)):
        self.setup, self._poses = setup, poses

    def __call__(self, scene, key) -> Plan:
        count = len(scene.mask)
        poses = jnp.stack([jnp.asarray(self._poses[slot % len(self._poses)]) for slot in range(count)])
        return Plan(jnp.arange(count), poses, jnp.ones(count, bool), jnp.zeros(count, int))


class Lazy(Fixed):
    """Misses the first object."""

    def __init__(self, setup: PlannerSetup):
        super().__init__(setup, (FAR, GOOD))


class Picky(Fixed):
    """Serves no scene at all."""

    def __call__(self, scene, key) -> Plan:
        raise PlanningError("objects: found 2, picky plans at most 1; use fixed")


class Double(Fixed):
    """Picks the first object twice."""

    def __call__(self, scene, key) -> Plan:
        return dataclasses.replace(super().__call__(scene, key), object_index=jnp.array([0, 0]))


class Unhappy(Fixed):
    """Is interrupted by its user."""

    def __call__(self, scene, key) -> Plan:
        raise KeyboardInterrupt


FAKES = {"fixed": Fixed, "lazy": Lazy, "picky": Picky, "dp": Fixed}
