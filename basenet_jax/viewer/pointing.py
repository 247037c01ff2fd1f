"""What the mouse points at: rays from the camera against planes, boxes and the scene."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from basenet_jax.robot.reading import load_robot
from basenet_jax.viewer import furnishing
from basenet_jax.viewer.execution import frame_at, on_surface
from basenet_jax.viewer.furnishing import pieces
from basenet_jax.world.footprints import within
from basenet_jax.world.furniture import KeepOutFields, WallFields
from basenet_jax.world.scene import NamedScene

SKIRTING_M = 0.3  # of walls: what can be grabbed; one looks and clicks through the rest
_LEVEL = 1e-3  # a ray that sinks less than this per metre meets no plane that matters


@dataclass(frozen=True)
class Target:
    """What can be moved: an object or a piece of furniture by its name, or (None) where the robot starts."""

    name: str | None


def is_there(scene: NamedScene, target: Target) -> bool:
    """Whether a scene has it."""
    return target.name is None or target.name in scene.names or target.name in pieces(scene.furniture)


def pose_of(scene: NamedScene, target: Target) -> Float[np.ndarray, "3"]:
    """(x, y, yaw) in W of what can be moved."""
    if target.name is None:
        return np.asarray(scene.arrays.robot_start, float)
    if target.name in scene.names:
        return np.asarray(scene.arrays.object_pose[scene.names.index(target.name)], float)
    return furnishing.pose_of(pieces(scene.furniture)[target.name].piece)


def height_of(scene: NamedScene, target: Target) -> float:
    """Where (m over the floor) what can be moved is taken hold of: an object's middle, furniture's upper side."""
    if target.name is None:
        return 0.0
    if target.name in scene.names:
        return float(on_surface(scene.arrays, scene.names.index(target.name))[2, 3])
    piece, boxes = pieces(scene.furniture)[target.name]
    high = float(scene.arrays.room.boxes.high[boxes.start])
    return min(high, SKIRTING_M) if isinstance(piece, WallFields) else high


def surface_met(
    scene: NamedScene, origin: ArrayLike, direction: ArrayLike, above: float, offset: Float[np.ndarray, "2"]
) -> tuple[int, Float[np.ndarray, "2"]] | None:
    """The first surface over which a ray passes at a height, and where (x, y) on it that is.

    Args:
        scene: whose surfaces.
        origin: of the ray, in W (m).
        direction: of any length.
        above: how far (m) over the surfaces.
        offset: added to where the ray is (m).
    """
    boxes, found = scene.arrays.room.boxes, None
    for box in np.flatnonzero(boxes.bears_objects):
        place = meet_plane(origin, direction, float(boxes.high[box]) + above)
        if place is None or (found is not None and boxes.high[box] <= boxes.high[found[0]]):
            continue
        if within(place[None] + offset, boxes.pose[[box]], boxes.half_size[[box]], 0.0)[0, 0]:
            found = int(box), place + offset
    return found


def hit(scene: NamedScene, origin: ArrayLike, direction: ArrayLike) -> tuple[Target | None, tuple[float, float] | None]:
    """What a ray meets first of what can be moved, or else where it meets the floor; neither behind the paper's table.

    Walls are met near the floor only, and areas to keep out of not at all: one looks through and asks there.

    Args:
        scene: with everything where it stands before the plan begins.
        origin: of the ray, in W (m).
        direction: of any length.
    """
    arrays, robot = scene.arrays, load_robot(scene.robot)
    base_frame, half_body = frame_at(arrays.robot_start, float(robot.body_center[2])), float(robot.body_half_size[2])
    boxes = [(Target(None), base_frame, [*robot.footprint_half_size, half_body]), *_furniture_boxes(scene)]
    boxes += [(Target(n), on_surface(arrays, i), arrays.object_size[i] / 2) for i, n in enumerate(scene.names)]
    met = [(along, target) for target, *box in boxes if (along := meet_box(origin, direction, *box)) is not None]
    if met:
        return min(met, key=lambda each: each[0])[1], None
    floor = meet_plane(origin, direction, 0.0)
    return None, None if floor is None else (float(floor[0]), float(floor[1]))


def _furniture_boxes(scene: NamedScene) -> Iterator[tuple[Target | None, Float[np.ndarray, "4 4"], list[float]]]:
    """What stands on the floor, the frames of its boxes, and half their sides (m)."""
    boxes, targets = scene.arrays.room.boxes, {0: None}
    if scene.furniture is not None:
        placed = pieces(scene.furniture).values()
        solid = [(piece, own) for piece, own in placed if not isinstance(piece, KeepOutFields)]
        targets = {box: Target(piece.name) for piece, own in solid for box in range(own.start, own.stop)}
    for box, target in targets.items():
        low, high = float(boxes.low[box]), float(boxes.high[box])
        if target is not None and isinstance(pieces(scene.furniture)[str(target.name)].piece, WallFields):
            high = min(high, SKIRTING_M)
        yield target, frame_at(boxes.pose[box], (low + high) / 2), [*boxes.half_size[box].tolist(), (high - low) / 2]


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
