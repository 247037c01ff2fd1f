"""Changes to a scene's objects and start. Each gives a new scene that can be planned, or says why there is none.

Scenes are kept on the host, padded to a fixed number of slots, so that programs compiled for one serve the next. What
they have to be is what files have to be, by the same rules.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

from basenet_jax.config import PickConfig, SceneConfig
from basenet_jax.plots.drawing import to_world
from basenet_jax.robot.reading import load_robot
from basenet_jax.world.boxes import Boxes
from basenet_jax.world.footprints import in_frame
from basenet_jax.world.grasps import of_objects
from basenet_jax.world.occupancy_map import is_on_map
from basenet_jax.world.room_checks import boxes_at_base, object_inside, stays_on_floor
from basenet_jax.world.scene import BY_SLOT, MAX_OBJECTS, OBJECT_CLASSES, NamedScene, Scene
from basenet_jax.world.spacing import Footprints, gaps

FEW_OBJECTS = 16  # slots of scenes with up to so many objects; larger ones have room for all that are allowed
_RASTER_M = 0.05  # of the places that are tried for a new object
_TRIED = 100  # of these on a surface, the best first: others may lie inside of boxes
_FARTHEST_M = 10.0  # beyond the middles of all boxes along either axis, where the floor has no bounds


class PlacementError(ValueError):
    """Something can't stand where it was put; the message says why."""


def pad(scene: NamedScene) -> NamedScene:
    """The scene on the host, with room for more objects: `FEW_OBJECTS` slots, or `MAX_OBJECTS` if it has more."""
    count = len(scene.names)
    slots = FEW_OBJECTS if count <= FEW_OBJECTS else MAX_OBJECTS
    arrays: Scene = jax.device_get(scene.arrays)

    def fill(values: np.ndarray) -> np.ndarray:
        longer = np.zeros((slots, *values.shape[1:]), values.dtype)
        longer[:count] = values[:count]
        return longer

    padded = dataclasses.replace(arrays, **jax.tree.map(lambda x: fill(np.asarray(x)), _by_slot(arrays)))
    return dataclasses.replace(scene, arrays=padded)


def surfaces_of(scene: NamedScene) -> Int[np.ndarray, " N"]:
    """The surface that each object stands on, as its number among the boxes."""
    boxes, slots = scene.arrays.room.boxes, np.arange(len(scene.names))
    pose, height = np.asarray(scene.arrays.object_pose)[slots], np.asarray(scene.arrays.surface_height)[slots]
    top = np.asarray(boxes.bears_objects) & (np.asarray(boxes.high) == height[:, None])
    gap = np.where(top, _beyond(pose, boxes), np.inf)
    return np.argmin(gap, axis=1)


def move_object(scene: NamedScene, name: str, pose: Float[np.ndarray, "3"], surface: int | None = None) -> NamedScene:
    """The object at (x, y, yaw) in W, or at the nearest place on the surface if that is off it.

    Args:
        scene: padded.
        name: of the object.
        pose: where it is to stand.
        surface: a box that bears objects; by default the one that the object stands on.

    Raises:
        PlacementError: something else stands there, or the object is gone.
    """
    if name not in scene.names:
        raise PlacementError(f"{name} isn't there any more")
    slot, boxes = scene.names.index(name), scene.arrays.room.boxes
    box = int(surfaces_of(scene)[slot]) if surface is None else surface
    half = np.asarray(boxes.half_size[box], float)
    top = np.asarray(boxes.pose[box], float)
    seen = np.clip(in_frame(top, np.asarray(pose[:2], float)), -half, half)
    poses, heights = np.array(scene.arrays.object_pose), np.array(scene.arrays.surface_height)
    poses[slot], heights[slot] = [*to_world(top, seen[None])[0], pose[2]], boxes.high[box]
    moved = _with(scene, object_pose=poses, surface_height=heights)
    if found := conflict(moved, slot):
        raise PlacementError(f"{name} can't stand there, {found[1]} does")
    return moved


def conflict(scene: NamedScene, slot: int | None = None) -> tuple[str, str] | None:
    """An object, and another one or a box that it stands in; None: all stand well.

    Args:
        scene: padded.
        slot: of the only object to look at; by default at all.
    """
    arrays, slots = scene.arrays, np.arange(len(scene.arrays.mask)) if slot is None else np.array([slot])
    bottom = np.asarray(arrays.surface_height, float)
    top = bottom + np.asarray(arrays.object_size, float)[:, 2]
    there = np.asarray(arrays.mask)
    beside = there[slots, None] & there & (bottom < top[slots, None]) & (bottom[slots, None] < top)
    beside &= slots[:, None] != np.arange(len(there))
    gap = np.where(beside, gaps(_footprints(scene, slots), _footprints(scene)), np.inf)
    first, second = divmod(int(np.argmin(gap)), len(there))
    if gap[first, second] < 0:
        return scene.names[slots[first]], scene.names[second]
    slots = slots[there[slots]]
    if inside := object_inside(
        np.asarray(arrays.object_pose, float)[slots], bottom[slots], top[slots], arrays.room.boxes
    ):
        return scene.names[slots[inside[0]]], scene.box_names[inside[1]]
    return None


def move_start(scene: NamedScene, pose: Float[np.ndarray, "3"], rule: PickConfig = PickConfig()) -> NamedScene:
    """The robot starts at (x, y, heading) in W, or at the nearest place on the floor if its centre would be off that.

    Raises:
        PlacementError: its base touches a box or the margin about it there, or leaves the floor.
    """
    low, high = limits(scene)
    start = np.array([*np.clip(pose[:2], low, high), pose[2]], np.float32)
    if what := what_is_at_start(scene, start, rule):
        raise PlacementError(f"the robot can't start {what}")
    return _with(scene, robot_start=start)


def what_is_at_start(scene: NamedScene, start: Float[np.ndarray, "3"], rule: PickConfig) -> str | None:
    """What is wrong with (x, y, heading) in W for the robot to start at; None: nothing."""
    room, robot = scene.arrays.room, load_robot(scene.robot)
    if not stays_on_floor(start, robot, room):
        return "beyond the floor's bounds"
    if scene.map is not None and not is_on_map(start, scene.map):
        return "beyond the map"
    touched = boxes_at_base(start, robot, room, rule)
    if not len(touched):
        return None
    return f"less than {rule.base_clearance_m:g} m from {box_name(scene, int(touched[0]))}"


def limits(scene: NamedScene) -> Float[np.ndarray, "2 2"]:
    """The least and the greatest x, y (m) of what can be put on the floor: within its bounds, and not far away."""
    boxes, floor = scene.arrays.room.boxes, np.asarray(scene.arrays.room.floor, float).reshape(2, 2)
    centers = np.asarray(boxes.pose, float)[np.asarray(boxes.blocks_base | boxes.blocks_arm), :2]
    around = np.stack([np.min(centers, axis=0) - _FARTHEST_M, np.max(centers, axis=0) + _FARTHEST_M])
    return np.where(np.isfinite(floor), floor, around)


def box_name(scene: NamedScene, box: int) -> str:
    """What messages call a box."""
    return "the table" if scene.furniture is None else scene.box_names[box]


def add_object(scene: NamedScene, kind: str) -> NamedScene:
    """One more object of a class, last in the order, where it is farthest from the others.

    Raises:
        PlacementError: there is no room for it.
    """
    count, index = len(scene.names), [each.name for each in OBJECT_CLASSES].index(kind)
    if count == MAX_OBJECTS:
        raise PlacementError(f"there are {MAX_OBJECTS} objects, no more are allowed")
    own = OBJECT_CLASSES[index]
    name = next(each for each in (f"{kind}_{i}" for i in itertools.count(1)) if each not in scene.names)
    arrays = scene.arrays
    grasps, held = own.grasps(sides=scene.furniture is not None and scene.furniture.clutter), arrays.object_grasps
    row = {
        "object_pose": (0.0, 0.0, 0.0),
        "object_size": own.size,
        "object_class": index,
        "mask": True,
        "surface_height": 0.0,
    }
    longer: dict[str, Any] = {
        leaf: np.concatenate([(old := getattr(arrays, leaf))[:count], np.asarray(new, old.dtype)[None]])
        for leaf, new in row.items()
    }
    longer["object_grasps"] = of_objects([*(held[slot][held.there[slot]] for slot in range(count)), grasps])
    kept = scene.kept_grasps and (*scene.kept_grasps, tuple(range(len(grasps.there))))
    grown = dataclasses.replace(arrays, **longer)
    return _at_freest_place(
        pad(dataclasses.replace(scene, arrays=grown, names=(*scene.names, name), kept_grasps=kept)), count
    )


def remove_object(scene: NamedScene, name: str) -> NamedScene:
    """The scene without an object; later ones move up by one slot.

    Raises:
        PlacementError: it is the last one.
    """
    if len(scene.names) == 1:
        raise PlacementError("the last object can't be removed, add another one first")
    return keep_objects(scene, [index for index, other in enumerate(scene.names) if other != name])


def keep_objects(scene: NamedScene, slots: Sequence[int] | Int[np.ndarray, " K"]) -> NamedScene:
    """The scene with the objects of some slots alone."""
    left = dataclasses.replace(scene.arrays, **jax.tree.map(lambda x: x[slots], _by_slot(scene.arrays)))
    names, kept = tuple(scene.names[index] for index in slots), scene.kept_grasps
    kept = kept and tuple(kept[index] for index in slots)
    return pad(dataclasses.replace(scene, arrays=left, names=names, kept_grasps=kept))


def _by_slot(arrays: Scene) -> dict[str, Any]:
    """The leaves with one row for each slot."""
    return {leaf: getattr(arrays, leaf) for leaf in BY_SLOT}


def _with(scene: NamedScene, **leaves: np.ndarray) -> NamedScene:
    return dataclasses.replace(scene, arrays=dataclasses.replace(scene.arrays, **leaves))


def _footprints(scene: NamedScene, slots: Sequence[int] | np.ndarray | slice = slice(None)) -> Footprints:
    """What the objects of some slots cover; of all, empty ones too, by default: the same shapes for few or many."""
    arrays = scene.arrays
    leaves = (arrays.object_pose, arrays.object_size, np.asarray(arrays.object_class) < 0)
    return Footprints(*(np.asarray(leaf)[slots] for leaf in leaves), crowded=scene.furniture is not None)


def _at_freest_place(scene: NamedScene, slot: int) -> NamedScene:
    """The scene with the last object moved to where on a raster on all surfaces it is farthest from the others."""
    boxes, best = scene.arrays.room.boxes, (-np.inf, scene)
    for box in np.flatnonzero(boxes.bears_objects):
        for gap, place in _free_places(scene, slot, int(box))[:_TRIED]:
            if gap <= max(best[0], 0.0):
                break
            poses, heights = np.array(scene.arrays.object_pose), np.array(scene.arrays.surface_height)
            poses[slot], heights[slot] = place, boxes.high[box]
            placed = _with(scene, object_pose=poses, surface_height=heights)
            if conflict(placed, slot) is None:
                best = (gap, placed)
                break
    if best[0] < 0:
        where = "on the table" if scene.furniture is None else "on any surface"
        raise PlacementError(f"there is no room left {where} for {scene.names[slot]}")
    return best[1]


def _free_places(scene: NamedScene, slot: int, box: int) -> list[tuple[float, np.ndarray]]:
    """Places on a surface, on a raster, and how far other objects are from there; the farthest first."""
    boxes = scene.arrays.room.boxes
    half = np.maximum(np.asarray(boxes.half_size[box], float) - SceneConfig().edge_margin_m, 0.0)
    sides = [np.arange(-(limit // _RASTER_M), limit // _RASTER_M + 1) * _RASTER_M for limit in half]
    spots = to_world(boxes.pose[box], np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2))
    places = np.column_stack([spots, np.full(len(spots), boxes.pose[box, 2])])
    own = _footprints(scene, [slot])
    anywhere = Footprints(places, np.repeat(own.size, len(places), axis=0), np.repeat(own.own_size, len(places)))
    beside = np.zeros(len(scene.arrays.mask), bool)
    beside[:slot] = np.abs(scene.arrays.surface_height[:slot] - boxes.high[box]) < SceneConfig().max_footprint_radius_m
    gap = np.min(np.where(beside, gaps(anywhere, _footprints(scene)), _FARTHEST_M), axis=1)
    return [(float(gap[index]), places[index]) for index in np.argsort(-gap, kind="stable")]


def _beyond(pose: Float[np.ndarray, "N 3"], boxes: Boxes) -> Float[np.ndarray, "N B"]:
    """How far (m) places are outside of boxes seen from above; negative: inside."""
    seen = in_frame(np.asarray(boxes.pose, float)[None], np.asarray(pose[:, None, :2], float))
    return np.max(np.abs(seen) - np.asarray(boxes.half_size, float), axis=-1)
