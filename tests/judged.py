"""Three small scenes with plans that work, judged once per session, for tests of what comes after the judge."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np

from basenet_jax.robot.reading import load_robot
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.boxes import Room
from basenet_jax.world.grasps import of_class
from basenet_jax.world.scene import Scene
from tests import compiled

GOOD = np.array([0.35, -0.9, 0.05], np.float32)  # every object can be picked from here


def scenes() -> Scene:
    """A batch of three scenes of two mugs, which differ a little."""
    pose = jnp.array([[0.1, -0.25, 0.3], [0.4, -0.25, 0.8]])
    room = Room.from_config()
    return Scene(
        object_pose=jnp.stack([pose, pose + jnp.array([0.0, 0.03, 0.0]), pose + jnp.array([0.05, 0.0, 0.1])]),
        object_size=jnp.tile(jnp.array([0.08, 0.08, 0.082]), (3, 2, 1)),
        object_grasps=of_class(jnp.tile(jnp.array([-0.06, 0.30, 0.0]), (3, 2, 1))),
        object_class=jnp.full((3, 2), 3),
        mask=jnp.ones((3, 2), bool),
        surface_height=jnp.full((3, 2), 0.75),
        robot_start=jnp.tile(jnp.array([2.6, -0.5, 1.0]), (3, 1)),
        room=jax.tree.map(lambda x: jnp.stack([x] * 3), room),
    )


def plans() -> Plan:
    """All picks from `GOOD`; the second plan picks the second object first."""
    return Plan(
        object_index=jnp.array([[0, 1], [1, 0], [0, 1]]),
        base_pose=jnp.tile(jnp.asarray(GOOD), (3, 2, 1)),
        served=jnp.ones((3, 2), bool),
        reason=jnp.zeros((3, 2), int),
    )


@functools.cache
def outcomes() -> Outcome:
    """What executing the plans comes to: everything is grasped."""
    judged = compiled.execute(load_robot(), scenes(), plans())
    assert np.all(judged.feasible), "the scenes are not what these tests need"
    return judged


def made_up_outcome() -> Outcome:
    """Of the first plan, all feasible with the arm at stow for waypoints: nothing needs to be compiled for it."""
    return Outcome(
        is_step=jnp.ones(2, bool),
        feasible=jnp.ones(2, bool),
        reason=jnp.zeros(2, int),
        navigation_time=jnp.array([8.0, 0.0]),
        pick_time=jnp.full(2, 9.0),
        joints=jnp.tile(jnp.asarray(load_robot().stow), (2, 5, 1)),
        grasp=jnp.zeros(2, int),
    )


def first(tree):
    """The first of a batch, on the host."""
    return jax.device_get(jax.tree.map(lambda x: x[0], tree))


def with_failure(outcome: Outcome, step: int) -> Outcome:
    """The outcome with one step failed for want of reach."""
    feasible, reason, time = (np.array(x) for x in (outcome.feasible, outcome.reason, outcome.pick_time))
    feasible[step], reason[step], time[step] = False, 2, 0.0
    return dataclasses.replace(outcome, feasible=feasible, reason=reason, pick_time=time)
