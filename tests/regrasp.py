"""Scenes with other grasps."""

import dataclasses
from collections.abc import Callable

import numpy as np

from basenet_jax.world.scene import Scene


def regrasp(scene: Scene, change: Callable[[np.ndarray], None]) -> Scene:
    """The scene after a change, in place, of its objects' grasps in their frames: an array "M G 6"."""
    pose = np.array(scene.object_grasps.pose)
    change(pose)
    return dataclasses.replace(scene, object_grasps=dataclasses.replace(scene.object_grasps, pose=pose))
