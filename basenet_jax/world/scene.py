"""Scenes: a room, objects with their grasps, and where the robot starts, as one pytree."""

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.config import MAX_OBJECTS as MAX_OBJECTS
from basenet_jax.world.boxes import Boxes, Room
from basenet_jax.world.furniture import Furniture
from basenet_jax.world.grasps import Grasps, from_the_side, in_world, of_class, together
from basenet_jax.world.occupancy_map import OccupancyMap

SIDE_BACK_M = 0.25  # of tool0 from an object's axis where it is held from the side: the gripper's tip is on the axis


@dataclass(frozen=True)
class ObjectClass:
    """A kind of object: its size, where tool0 is at the top-down grasp, in the object's frame, and at others."""

    name: str
    size: tuple[float, float, float]  # x, y, z (m)
    grasp_x: float  # m
    grasp_z: float  # m above the object's centre
    grasp_yaw: float  # rad
    sides: int = 0  # directions from which it can be held level, see `from_the_side`

    def grasps(self, *, sides: bool) -> Grasps:
        """Its grasps, the top-down one first, in float32 on the host.

        Args:
            sides: whether those from the side are among them: in rooms, not in the paper's world.
        """
        above = of_class(np.array((self.grasp_x, self.grasp_z, self.grasp_yaw), np.float32), np)
        return together([above, from_the_side(self.sides, SIDE_BACK_M)]) if sides and self.sides else above


# Sizes: YCB. Grasps: the BaSeNet release.
OBJECT_CLASSES = (
    ObjectClass("cracker_box", (0.06, 0.16, 0.21), 0.0, 0.30, 0.0, sides=8),
    ObjectClass("bleach_cleanser", (0.065, 0.098, 0.25), 0.0, 0.35, -math.pi / 2, sides=8),
    ObjectClass("mustard_bottle", (0.05, 0.085, 0.175), 0.0, 0.32, math.pi / 4, sides=8),
    ObjectClass("mug", (0.08, 0.08, 0.082), -0.06, 0.30, 0.0),
    ObjectClass("bowl", (0.159, 0.159, 0.053), 0.08, 0.29, 0.0),
)


# Leaves of a scene with one row for each slot.
BY_SLOT = ("object_pose", "object_size", "object_grasps", "object_class", "mask", "surface_height")


@struct.dataclass
class Scene:
    """One scene, or a batch of them, with objects padded to M slots. Poses are `(x, y, yaw)` in W."""

    object_pose: Float[Array, "*batch M 3"]
    object_size: Float[Array, "*batch M 3"]  # x, y, z (m)
    object_grasps: Grasps  # G of each object, in its frame: about its centre, turned with it
    object_class: Int[Array, "*batch M"]  # index into OBJECT_CLASSES; -1: a class of the user's own
    mask: Bool[Array, "*batch M"]  # which slots hold an object
    surface_height: Float[Array, "*batch M"]  # m, of what the object stands on
    robot_start: Float[Array, "*batch 3"]
    room: Room

    @property
    def grasps(self) -> Grasps:
        """Each object's G grasps in W; leaves begin with "*batch M G"."""
        return in_world(self.object_grasps, self.object_pose, self.object_size, self.surface_height)

    @property
    def first_grasp(self) -> Float[Array, "*batch M 4"]:
        """x, y, z (m) and yaw (rad) in W of tool0 at each object's first grasp: what the policies see of it."""
        return self.grasps.planar[..., 0, :]

    @property
    def object_boxes(self) -> Boxes:
        """The objects as boxes, M for each scene, that block the arm where they stand."""
        nothing = jnp.zeros_like(self.mask)
        return Boxes(
            pose=self.object_pose,
            half_size=0.5 * self.object_size[..., :2],
            low=self.surface_height,
            high=self.surface_height + self.object_size[..., 2],
            blocks_base=nothing,
            blocks_arm=self.mask,
            bears_objects=nothing,
        )


@dataclass(frozen=True)
class NamedScene:
    """One scene as its user knows it: with a name for each object, in the order of the slots, and its robot."""

    arrays: Scene  # unbatched; slots beyond the names are empty
    names: tuple[str, ...]
    robot: str = "ur5e_mobile"  # a packaged one's name, or the path of a robot file
    written_for: str | None = None  # the robot that its file names, where another one is to be used
    box_names: tuple[str, ...] = ("table",)  # of the room's boxes; those beyond only pad
    # What the room was made of, and by which rules one plans; None: the paper's world.
    furniture: Furniture | None = None
    kept_grasps: tuple[tuple[int, ...], ...] | None = None  # of each object, in the order of its file; None: all
    map: OccupancyMap | None = None  # whose closed cells are among the boxes
