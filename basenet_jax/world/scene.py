"""Scenes: a room, objects with their top-down grasps, and where the robot starts, as one pytree."""

import math
from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.config import MAX_OBJECTS as MAX_OBJECTS
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.boxes import Room
from basenet_jax.world.furniture import Furniture


@dataclass(frozen=True)
class ObjectClass:
    """A kind of object: its size and where tool0 is at the top-down grasp, in the object's frame."""

    name: str
    size: tuple[float, float, float]  # x, y, z (m)
    grasp_x: float  # m
    grasp_z: float  # m above the object's centre
    grasp_yaw: float  # rad


# Sizes: YCB. Grasps: the BaSeNet release.
OBJECT_CLASSES = (
    ObjectClass("cracker_box", (0.06, 0.16, 0.21), 0.0, 0.30, 0.0),
    ObjectClass("bleach_cleanser", (0.065, 0.098, 0.25), 0.0, 0.35, -math.pi / 2),
    ObjectClass("mustard_bottle", (0.05, 0.085, 0.175), 0.0, 0.32, math.pi / 4),
    ObjectClass("mug", (0.08, 0.08, 0.082), -0.06, 0.30, 0.0),
    ObjectClass("bowl", (0.159, 0.159, 0.053), 0.08, 0.29, 0.0),
)


# Leaves of a scene with one row for each slot.
BY_SLOT = ("object_pose", "object_size", "object_grasp", "object_class", "mask", "surface_height")


@struct.dataclass
class Scene:
    """One scene, or a batch of them, with objects padded to M slots. Poses are `(x, y, yaw)` in W."""

    object_pose: Float[Array, "*batch M 3"]
    object_size: Float[Array, "*batch M 3"]  # x, y, z (m)
    object_grasp: Float[Array, "*batch M 3"]  # tool0's x, z (m) and yaw (rad) in the object's frame
    object_class: Int[Array, "*batch M"]  # index into OBJECT_CLASSES; -1: a class of the user's own
    mask: Bool[Array, "*batch M"]  # which slots hold an object
    surface_height: Float[Array, "*batch M"]  # m, of what the object stands on
    robot_start: Float[Array, "*batch 3"]
    room: Room

    @property
    def grasps(self) -> Float[Array, "*batch M 4"]:
        """tool0's x, y, z (m) and yaw (rad) in W at each object's grasp."""
        return world_grasp(self.object_pose, self.object_size, self.object_grasp, self.surface_height)


@dataclass(frozen=True)
class NamedScene:
    """One scene as its user knows it: with a name for each object, in the order of the slots, and its robot."""

    arrays: Scene  # unbatched; slots beyond the names are empty
    names: tuple[str, ...]
    robot: str = "ur5e_mobile"  # a packaged one's name, or the path of a robot file
    written_for: str | None = None  # the robot that its file names, where another one is to be used
    box_names: tuple[str, ...] = ("table",)  # of the room's boxes; those beyond only pad
    furniture: Furniture | None = (
        None  # what the room was made of, and by which rules one plans; None: the paper's world
    )


def world_grasp(
    pose: Float[Array, "*batch 3"],
    size: Float[Array, "*batch 3"],
    grasp: Float[Array, "*batch 3"],
    surface_height: Float[Array, "*batch"],
) -> Float[Array, "*batch 4"]:
    """tool0's x, y, z and yaw in W at the grasp: R_W_tool0 = Rz(yaw) Rx(pi), the tool's z pointing down."""
    sine, cosine = sin_cos(pose[..., 2])
    x = pose[..., 0] + cosine * grasp[..., 0]
    y = pose[..., 1] + sine * grasp[..., 0]
    z = surface_height + 0.5 * size[..., 2] + grasp[..., 1]
    return jnp.stack([x, y, z, pose[..., 2] + grasp[..., 2]], axis=-1)
