"""What the mouse points at: rays from the camera against planes, boxes and the scene."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from basenet_jax.robot.reading import load_robot
from basenet_jax.viewer.execution import frame_at, on_table
from basenet_jax.world.scene import NamedScene

_LEVEL = 1e-3  # a ray that sinks less than this per metre meets no plane that matters


@dataclass(frozen=True)
class Target:
    """What can be moved: an object by its name, or (None) where the robot starts."""

    name: str | None


def pose_of(scene: NamedScene, target: Target) -> Float[np.ndarray, "3"]:
    """(x, y, yaw) in W of what can be moved."""
    if target.name is None:
        return np.asarray(scene.arrays.robot_start, float)
    return np.asarray(scene.arrays.object_pose[scene.names.index(target.name)], float)


def hit(scene: NamedScene, origin: ArrayLike, direction: ArrayLike) -> tuple[Target | None, tuple[float, float] | None]:
    """What a ray meets first of what can be moved, or else where it meets the floor; neither behind the table.

    Args:
        scene: with everything where it stands before the plan begins.
        origin: of the ray, in W (m).
        direction: of any length.
    """
    arrays, robot = scene.arrays, load_robot(scene.robot)
    half_height, half_body = float(arrays.room.table_height) / 2, float(robot.body_half_size[2])
    table_frame, table_half = frame_at((0.0, 0.0, 0.0), half_height), [*arrays.room.table_half_size, half_height]
    base_frame = frame_at(arrays.robot_start, float(robot.body_center[2]))
    boxes = [(None, table_frame, table_half), (Target(None), base_frame, [*robot.footprint_half_size, half_body])]
    boxes += [(Target(n), on_table(arrays, i), arrays.object_size[i] / 2) for i, n in enumerate(scene.names)]
    met = [(along, target) for target, *box in boxes if (along := meet_box(origin, direction, *box)) is not None]
    if met:
        return min(met, key=lambda each: each[0])[1], None
    floor = meet_plane(origin, direction, 0.0)
    return None, None if floor is None else (float(floor[0]), float(floor[1]))


def meet_plane(origin: ArrayLike, direction: ArrayLike, height: float) -> Float[np.ndarray, "2"] | None:
    """Where (x, y) a ray going down meets the level plane at a height; None where it doesn't.

    Args:
        origin: of the ray, in W (m).
        direction: of any length.
        height: m.
    """
    origin, direction = np.asarray(origin, float), np.asarray(direction, float)
    if direction[2] > -_LEVEL * np.linalg.norm(direction) or origin[2] <= height:
        return None
    return (origin + direction * (height - origin[2]) / direction[2])[:2]


def meet_box(
    origin: ArrayLike, direction: ArrayLike, frame: Float[np.ndarray, "4 4"], half_size: ArrayLike
) -> float | None:
    """How far along a ray, in lengths of its direction, it enters a box; None where it misses it or begins inside.

    Args:
        origin: of the ray, in W (m).
        direction: of any length.
        frame: of the box in W.
        half_size: half its sides (m).
    """
    rotation, half = frame[:3, :3], np.asarray(half_size, float)
    start = (np.asarray(origin, float) - frame[:3, 3]) @ rotation
    along = np.asarray(direction, float) @ rotation
    along = np.where(np.abs(along) < 1e-12, 1e-12, along)
    first, second = (-half - start) / along, (half - start) / along
    enter, leave = np.max(np.minimum(first, second)), np.min(np.maximum(first, second))
    return float(enter) if 0.0 <= enter <= leave else None
