"""A small valid scene as a user writes it, and a planner that costs nothing."""

import copy

import jax.numpy as jnp
import numpy as np

from basenet_jax.task.plan import Plan

CONTENT = {
    "format": "basenet-scene/1",
    "table": {"size": [2.0, 0.8], "height": 0.75},
    "robot": {"model": "ur5e_mobile", "start": [2.4, -1.1, 1.57]},
    "objects": [
        {"name": "mug_1", "class": "mug", "pose": [0.31, -0.22, 0.4]},
        {
            "name": "part_7",
            "pose": [0.1, -0.2, 1.1],
            "size": [0.05, 0.05, 0.12],
            "grasp": {"x": 0.0, "z": 0.3, "yaw": 0},
        },
    ],
}

TEXT = """\
format: basenet-scene/1
table: {size: [2.0, 0.8], height: 0.75}
robot: {model: ur5e_mobile, start: [2.4, -1.1, 1.57]}
objects:
  - {name: mug_1, class: mug, pose: [0.31, -0.22, 0.4]}
  - name: part_7  # a class of one's own
    pose: [0.1, -0.2, 1.1]
    size: [0.05, 0.05, 0.12]
    grasp: {x: 0.0, z: 0.30, yaw: 0}
"""


def content():
    """A copy to change."""
    return copy.deepcopy(CONTENT)


def park_once(scene, key):
    """Picks in the file's order, all from one base pose; both objects of `CONTENT` can be picked from there."""
    del key
    slots = scene.mask.shape[0]
    pose = jnp.tile(jnp.array([0.35, -0.9, 0.05]), (slots, 1))
    index = np.where(scene.mask, np.arange(slots), -1)
    return Plan(jnp.asarray(index), pose, jnp.asarray(scene.mask), jnp.zeros(slots, int))
