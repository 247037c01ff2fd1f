"""Rooms of one size: batches of random ones, for programs that plan and learn in many at once."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from basenet_jax.robot.reading import DEFAULT_ROBOT
from basenet_jax.world.boxes import pad
from basenet_jax.world.generate_rooms import Draw, draw_room
from basenet_jax.world.scene import NamedScene, Scene

PADDED_BOXES = 16  # more than any random room has


def draw_rooms(
    seed: int, count: int, objects: Sequence[int], *, slots: int, robot: str = DEFAULT_ROBOT
) -> tuple[Scene, list[NamedScene]]:
    """Several random rooms, also as one batch in which all have as many boxes and slots.

    Args:
        seed: room i of a seed is the same whatever the count.
        count: of the rooms.
        objects: of these numbers each room has one.
        slots: M of the batch.
        robot: as for `draw_room`.
    """
    numbers = [objects[Draw(np.random.default_rng([seed, i, 1])).integer(0, len(objects) - 1)] for i in range(count)]
    rooms = [draw_room([seed, i], number, robot=robot) for i, number in enumerate(numbers)]
    padded = [pad_scene(room.arrays, slots=slots) for room in rooms]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *padded), rooms


def pad_scene(scene: Scene, *, slots: int, boxes: int = PADDED_BOXES) -> Scene:
    """An unbatched scene with boxes that block nothing and empty slots behind, on the host.

    Raises:
        ValueError: there are more.
    """
    scene = jax.device_get(scene)
    missing = slots - len(scene.mask)
    if missing < 0:
        raise ValueError(f"slots: found {len(scene.mask)}, allowed are up to {slots}")
    own: dict[str, Any] = {"robot_start": scene.robot_start}
    own["room"] = dataclasses.replace(scene.room, boxes=pad(scene.room.boxes, boxes))
    names = [name for name in Scene.__dataclass_fields__ if name not in own]
    for name in names:
        own[name] = jax.tree.map(
            lambda column: np.pad(column, [(0, missing)] + [(0, 0)] * (np.ndim(column) - 1)), getattr(scene, name)
        )
    return Scene(**own)
