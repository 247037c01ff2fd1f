"""Changes to a scene. Each gives a new scene that can be planned, or says why there is none.

Scenes are kept on the host, padded to a fixed number of slots, so that programs compiled for one serve the next.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float

from basenet_jax.config import PickConfig, SceneConfig
from basenet_jax.robot.reading import load_robot
from basenet_jax.world.clearance import compiled_base_collides
from basenet_jax.world.grasps import of_class
from basenet_jax.world.scene import BY_SLOT, MAX_OBJECTS, OBJECT_CLASSES, NamedScene, Scene
from basenet_jax.world.spacing import Footprints, gaps

FEW_OBJECTS = 16  # slots of scenes with up to so many objects; larger ones have room for all that are allowed
_RASTER_M = 0.05  # of the places that are tried for a new object
_FARTHEST_M = 10.0  # from the table's centre along either axis, where the robot may start


class PlacementError(ValueError):
    """Something can't stand where it was put; the message says why."""


def pad(scene: NamedScene) -> NamedScene:
    """The scene on the host, with room for more objects: `FEW_OBJECTS` slots, or `MAX_OBJECTS` if it has more.

    Raises:
        ValueError: it is a room of several boxes, which the page can't show yet.
    """
    if scene.arrays.room.boxes.low.shape[-1] != 1:
        raise ValueError("format: found a room, the viewer shows scenes of one table; basenet_jax.plan plans rooms")
    count = len(scene.names)
    slots = FEW_OBJECTS if count <= FEW_OBJECTS else MAX_OBJECTS
    arrays: Scene = jax.device_get(scene.arrays)

    def fill(values: np.ndarray) -> np.ndarray:
        longer = np.zeros((slots, *values.shape[1:]), values.dtype)
        longer[:count] = values[:count]
        return longer

    padded = dataclasses.replace(arrays, **jax.tree.map(lambda x: fill(np.asarray(x)), _by_slot(arrays)))
    return dataclasses.replace(scene, arrays=padded)


def move_object(scene: NamedScene, name: str, pose: Float[np.ndarray, "3"]) -> NamedScene:
    """The object at (x, y, yaw) in W, or at the nearest place on the table if that is off it.

    Raises:
        PlacementError: another object stands there, or it is gone.
    """
    if name not in scene.names:
        raise PlacementError(f"{name} isn't there any more")
    slot, half = scene.names.index(name), np.asarray(scene.arrays.room.table_half_size)
    poses = np.array(scene.arrays.object_pose)
    poses[slot] = [*np.clip(pose[:2], -half, half), pose[2]]
    moved = _with(scene, object_pose=poses)
    gap = gaps(_footprints(moved, [slot]), _footprints(moved))[0]
    gap[slot] = np.inf  # from itself
    nearest = int(np.argmin(gap[: len(scene.names)]))
    if gap[nearest] < 0:
        raise PlacementError(f"{name} can't stand there, {scene.names[nearest]} does")
    return moved


def move_start(scene: NamedScene, pose: Float[np.ndarray, "3"], rule: PickConfig = PickConfig()) -> NamedScene:
    """The robot starts at (x, y, heading) in W.

    Raises:
        PlacementError: its base touches the table or the margin about it there.
    """
    x, y = np.clip(pose[:2], -_FARTHEST_M, _FARTHEST_M)
    start = np.array([x, y, pose[2]], np.float32)
    robot = load_robot(scene.robot)
    if compiled_base_collides(robot, start, scene.arrays.room, rule.base_clearance_m, rule.touching_m):
        raise PlacementError(f"the robot can't start less than {rule.base_clearance_m:g} m from the table")
    return _with(scene, robot_start=start)


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
    row = {
        "object_pose": (0.0, 0.0, 0.0),
        "object_size": own.size,
        "object_grasps": of_class(np.array((own.grasp_x, own.grasp_z, own.grasp_yaw), np.float32), np),
        "object_class": index,
        "mask": True,
        "surface_height": float(arrays.room.table_height),
    }

    def append(old: np.ndarray, new: Any) -> np.ndarray:
        return np.concatenate([old[:count], np.asarray(new, old.dtype)[None]])

    longer = {leaf: jax.tree.map(append, old, row[leaf]) for leaf, old in _by_slot(arrays).items()}
    grown = dataclasses.replace(scene, arrays=dataclasses.replace(arrays, **longer), names=(*scene.names, name))
    return _at_freest_place(pad(grown), count)


def remove_object(scene: NamedScene, name: str) -> NamedScene:
    """The scene without an object; later ones move up by one slot.

    Raises:
        PlacementError: it is the last one.
    """
    if len(scene.names) == 1:
        raise PlacementError("the last object can't be removed, add another one first")
    keep = [index for index, other in enumerate(scene.names) if other != name]
    left = dataclasses.replace(scene.arrays, **jax.tree.map(lambda x: x[keep], _by_slot(scene.arrays)))
    return pad(dataclasses.replace(scene, arrays=left, names=tuple(scene.names[index] for index in keep)))


def _by_slot(arrays: Scene) -> dict[str, Any]:
    """The leaves with one row for each slot."""
    return {leaf: getattr(arrays, leaf) for leaf in BY_SLOT}


def _with(scene: NamedScene, **leaves: np.ndarray) -> NamedScene:
    return dataclasses.replace(scene, arrays=dataclasses.replace(scene.arrays, **leaves))


def _footprints(scene: NamedScene, slots: Sequence[int] | slice = slice(None)) -> Footprints:
    """What the objects of some slots cover; of all, empty ones too, by default: the same shapes for few or many."""
    arrays = scene.arrays
    leaves = (arrays.object_pose, arrays.object_size, np.asarray(arrays.object_class) < 0)
    return Footprints(*(np.asarray(leaf)[slots] for leaf in leaves))


def _at_freest_place(scene: NamedScene, slot: int) -> NamedScene:
    """The scene with the last object moved to where on a raster it is farthest from the others."""
    half = np.maximum(np.asarray(scene.arrays.room.table_half_size) - SceneConfig().edge_margin_m, 0.0)
    sides = [np.arange(-(limit // _RASTER_M), limit // _RASTER_M + 1) * _RASTER_M for limit in half]
    places = np.stack([*np.meshgrid(*sides), np.zeros((len(sides[1]), len(sides[0])))], axis=-1).reshape(-1, 3)
    own = _footprints(scene, [slot])
    anywhere = Footprints(places, np.repeat(own.size, len(places), axis=0), np.repeat(own.own_size, len(places)))
    gap = np.min(gaps(anywhere, _footprints(scene))[:, :slot], axis=1)
    best = int(np.argmax(gap))
    if gap[best] < 0:
        raise PlacementError(f"there is no room left on the table for {scene.names[slot]}")
    poses = np.array(scene.arrays.object_pose)
    poses[slot] = places[best]
    return _with(scene, object_pose=poses)
