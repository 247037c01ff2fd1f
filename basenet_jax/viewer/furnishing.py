"""Changes to what stands in a room. Surfaces carry their objects; each change gives a new scene, or says why not."""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import jax
import msgspec
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from basenet_jax.config import PickConfig
from basenet_jax.plots.drawing import to_world
from basenet_jax.viewer.editing import PlacementError, conflict, keep_objects, limits, surfaces_of, what_is_at_start
from basenet_jax.world.footprints import in_frame, rectangle_gaps
from basenet_jax.world.furniture import (
    MAX_BOXES,
    Furniture,
    KeepOutFields,
    ObstacleFields,
    SurfaceFields,
    WallFields,
    furnish,
    written_boxes,
)
from basenet_jax.world.room_checks import surface_overlap
from basenet_jax.world.scene import NamedScene

Piece = SurfaceFields | ObstacleFields | WallFields | KeepOutFields

# What can be added, as it is at first; its name gets a number.
NEW: Mapping[str, Piece] = {
    "table": SurfaceFields(name="table", pose=(0.0, 0.0, 0.0), size=(1.2, 0.6), height=0.75),
    "shelf board": SurfaceFields(name="board", pose=(0.0, 0.0, 0.0), size=(1.2, 0.4), height=1.0, thickness=0.04),
    "obstacle": ObstacleFields(name="obstacle", pose=(0.0, 0.0, 0.0), size=(0.5, 0.5, 1.0)),
    "wall": WallFields(name="wall", points=[(-1.0, 0.0), (1.0, 0.0)], thickness=0.1, height=2.2),
    "keep out": KeepOutFields(name="keep_out", pose=(0.0, 0.0, 0.0), size=(1.0, 1.0)),
}
_KINDS: Mapping[type, str] = {
    SurfaceFields: "surfaces",
    ObstacleFields: "obstacles",
    WallFields: "walls",
    KeepOutFields: "keep_out",
}
_RASTER_M = 0.25  # of the places that are tried for something new
_METRES, _RADIANS = 4, 6  # decimals that files get


class Placed(NamedTuple):
    """A piece of furniture, and its boxes among the room's."""

    piece: Piece
    boxes: slice


def pieces(furniture: Furniture | None) -> dict[str, Placed]:
    """All furniture by name, in the order of its boxes; nothing in the paper's world."""
    found, first = {}, 0
    for piece in _pieces(furniture) if furniture is not None else ():
        count = len(piece.points) - 1 if isinstance(piece, WallFields) else 1
        found[piece.name] = Placed(piece, slice(first, first + count))
        first += count
    return found


def pose_of(piece: Piece) -> Float[np.ndarray, "3"]:
    """(x, y, yaw) in W; of a wall the middle of its points, turned as its first piece is."""
    if not isinstance(piece, WallFields):
        return np.array(piece.pose)
    (x, y), (next_x, next_y) = piece.points[:2]
    return np.array([*np.mean(piece.points, axis=0), math.atan2(next_y - y, next_x - x)])


def move_piece(
    scene: NamedScene, name: str, pose: Float[np.ndarray, "3"], rule: PickConfig = PickConfig()
) -> NamedScene:
    """The piece at (x, y, yaw) in W, with all that stands on it, or at the nearest place within the floor's bounds.

    Raises:
        PlacementError: something else stands there, or it is gone.
    """
    placed = pieces(scene.furniture)
    if name not in placed:
        raise PlacementError(f"{name} isn't there any more")
    piece, boxes = placed[name]
    low, high = limits(scene)
    new = np.array([*np.clip(pose[:2], low, high), pose[2]])
    moved = _moved(piece, new)
    carried = np.flatnonzero(surfaces_of(scene) == boxes.start) if isinstance(piece, SurfaceFields) else ()
    poses, before, after = np.array(scene.arrays.object_pose), pose_of(piece), pose_of(moved)
    if len(carried):
        poses[carried, :2] = to_world(after, in_frame(before, poses[carried, :2].astype(float)))
        poses[carried, 2] += after[2] - before[2]
    everything = [moved if other.name == name else other for other, _ in placed.values()]
    arrays = dataclasses.replace(scene.arrays, object_pose=poses)
    result = _furnished(dataclasses.replace(scene, arrays=arrays), everything)
    _check(result, name, rule)
    return result


def add_piece(scene: NamedScene, kind: str, rule: PickConfig = PickConfig()) -> tuple[NamedScene, str]:
    """One more piece of a kind, on the floor where it is farthest from all else, and its name.

    Raises:
        PlacementError: there is no room for it.
    """
    if scene.furniture is None:
        raise PlacementError("this is the paper's world, with one table; basenet_jax.convert makes a room of its file")
    placed, first = pieces(scene.furniture), NEW[kind]
    if len(written_boxes(scene.furniture)[1]) == MAX_BOXES:
        raise PlacementError(f"there are {MAX_BOXES} boxes, no more are allowed")
    taken = {*placed, *scene.names}
    name = next(each for each in (f"{first.name}_{i}" for i in itertools.count(1)) if each not in taken)
    new = msgspec.structs.replace(first, name=name)
    trouble = PlacementError(f"there is no room left for {name}")
    for place in _free_places(scene, new):
        result = _furnished(scene, [*(piece for piece, _ in placed.values()), _moved(new, place)])
        try:
            _check(result, name, rule)
        except PlacementError as error:
            trouble = error
            continue
        return result, name
    raise trouble


def remove_piece(scene: NamedScene, name: str) -> NamedScene:
    """The scene without a piece of furniture and what stands on it.

    Raises:
        PlacementError: it is the last surface, or all objects stand on it.
    """
    placed = pieces(scene.furniture)
    if name not in placed:
        raise PlacementError(f"{name} isn't there any more")
    piece, boxes = placed[name]
    if isinstance(piece, SurfaceFields):
        assert scene.furniture is not None
        if len(scene.furniture.surfaces) == 1:
            raise PlacementError("the last surface can't be removed, add another one first")
        keep = np.flatnonzero(surfaces_of(scene) != boxes.start)
        if not len(keep):
            raise PlacementError(f"all objects stand on {name}, it can't be removed; move one to another surface first")
        scene = keep_objects(scene, keep)
    return _furnished(scene, [other for other, _ in placed.values() if other.name != name])


def _pieces(furniture: Furniture) -> Iterator[Piece]:
    return itertools.chain(furniture.surfaces, furniture.obstacles, furniture.walls, furniture.keep_out)


def _moved(piece: Piece, pose: Float[np.ndarray, "3"]) -> Piece:
    x, y, yaw = round(float(pose[0]), _METRES), round(float(pose[1]), _METRES), round(float(pose[2]), _RADIANS)
    if not isinstance(piece, WallFields):
        return msgspec.structs.replace(piece, pose=(x, y, yaw))
    points = to_world((x, y, yaw), in_frame(pose_of(piece), np.array(piece.points)))
    return msgspec.structs.replace(piece, points=[(float(a), float(b)) for a, b in np.round(points, _METRES)])


def _furnished(scene: NamedScene, everything: list[Piece]) -> NamedScene:
    """The scene with other furniture, and the boxes of its map."""
    assert scene.furniture is not None
    lists = {kind: [piece for piece in everything if type(piece) is fields] for fields, kind in _KINDS.items()}
    furniture = msgspec.structs.replace(scene.furniture, **lists)
    written, count = len(written_boxes(scene.furniture)[1]), len(scene.box_names)
    of_map = jax.tree.map(lambda x: x[written:count], scene.arrays.room.boxes) if count > written else None
    room, names = furnish(furniture, of_map)
    arrays = dataclasses.replace(scene.arrays, room=room)
    return dataclasses.replace(scene, arrays=arrays, furniture=furniture, box_names=names)


def _check(scene: NamedScene, name: str, rule: PickConfig) -> None:
    """That a piece stands where it may.

    Raises:
        PlacementError: it doesn't.
    """
    assert scene.furniture is not None
    own = pieces(scene.furniture)[name].boxes
    if scene.furniture.drives == "point":
        raise PlacementError("the file says `drives: point`, which goes round one table about W's origin alone")
    if overlap := surface_overlap(scene.furniture):
        other = next(box for box in overlap if box not in range(own.start, own.stop))
        raise PlacementError(f"{name} can't stand there, {scene.box_names[other]} does")
    if found := conflict(scene):
        what = found[0] if found[1] in scene.box_names[own] else found[1]
        raise PlacementError(f"{name} can't stand there, {what} does")
    if what := what_is_at_start(scene, np.asarray(scene.arrays.robot_start), rule):
        raise PlacementError(f"{name} can't stand there: the robot would start {what}")


def _free_places(scene: NamedScene, piece: Piece) -> Iterator[Float[np.ndarray, "3"]]:
    """Poses on a raster over the room's middle, the one farthest from all boxes and the robot first."""
    low, high = limits(scene)
    boxes = scene.arrays.room.boxes
    there = np.asarray(boxes.blocks_base | boxes.blocks_arm)
    pose = np.concatenate([np.asarray(boxes.pose, float)[there], np.asarray(scene.arrays.robot_start, float)[None]])
    half = np.concatenate([np.asarray(boxes.half_size, float)[there], [[0.5, 0.5]]])
    low, high = np.maximum(low, np.min(pose[:, :2], axis=0) - 2.0), np.minimum(high, np.max(pose[:, :2], axis=0) + 2.0)
    spots = np.stack(np.meshgrid(*(np.arange(a, b, _RASTER_M) for a, b in zip(low, high, strict=True))), axis=-1)
    places = np.column_stack([spots.reshape(-1, 2), np.zeros(spots[..., 0].size)])
    own = np.broadcast_to(_half_size(piece), (len(places), 2))
    gap = np.min(rectangle_gaps(places, own, pose, half), axis=1)
    edge = np.min(np.minimum(places[:, :2] - low, high - places[:, :2]) - own, axis=1)
    return iter(places[np.argsort(-np.minimum(gap, edge + 0.5), kind="stable")[:50]])


def _half_size(piece: Piece) -> ArrayLike:
    if isinstance(piece, WallFields):
        return np.ptp(np.array(piece.points), axis=0) / 2 + piece.thickness / 2
    return np.array(piece.size[:2]) / 2
