"""Grasps: where tool0 takes hold of an object, how it comes there, and how it is held."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.trigonometry import sin_cos

_SIZES = (1, 4, 16)  # how many grasps each object of a scene has, with those that pad
_FAR_M = 0.25  # counts like a radian, where grasps are told apart


@struct.dataclass
class Grasps:
    """Poses of tool0, and how it comes to them. The last axis is that of an object's G grasps, some of which may pad.

    Orientations are roll, pitch, yaw: `R = Rz(yaw) Ry(pitch) Rx(roll)`, as in URDF. Objects and bases turn about z
    alone, which adds to the yaw and leaves the rest.
    """

    pose: Float[Array, "*batch G 6"]  # x, y, z (m), roll, pitch, yaw (rad)
    approach: Float[Array, "*batch G"]  # m, straight along the tool's z, from the pre-grasp on; 0: the world's
    symmetric: Bool[Array, "*batch G"]  # whether the gripper may be turned by pi about the tool's z
    there: Bool[Array, "*batch G"]  # those that don't pad

    @property
    def planar(self) -> Float[Array, "*batch G 4"]:
        """x, y, z (m) and yaw (rad) alone, which is all of a top-down grasp."""
        return self.pose[..., np.array([0, 1, 2, 5])]

    def __getitem__(self, index: Any) -> "Grasps":
        """Those of part of the batch, by its leading axes."""
        return jax.tree.map(lambda x: x[index], self)


def top_down(grasp: Float[ArrayLike, "*batch 4"], numpy: Any = jnp) -> Grasps:
    """One top-down grasp for each of a batch, the tool's z pointing down: `R = Rz(yaw) Rx(pi)`.

    Args:
        grasp: x, y, z (m) and yaw (rad) of tool0.
        numpy: the module that makes the arrays: NumPy, or `jax.numpy` where grasps are traced.
    """
    planar: Any = numpy.asarray(grasp)[..., None, :]
    one = numpy.ones(planar.shape[:-1], bool)
    fixed = numpy.broadcast_to(numpy.array([np.pi, 0.0], planar.dtype), (*planar.shape[:-1], 2))
    pose = numpy.concatenate([planar[..., :3], fixed, planar[..., 3:]], axis=-1)
    return Grasps(pose, numpy.zeros(one.shape, planar.dtype), one, one)


def of_class(grasp: Float[ArrayLike, "*batch 3"], numpy: Any = jnp) -> Grasps:
    """The top-down grasps of objects in their own frames, from tool0's x, z (m) and yaw (rad) there.

    Args:
        grasp: in the objects' frames, whose origins are the objects' centres.
        numpy: as for `top_down`.
    """
    own: Any = numpy.asarray(grasp)
    return top_down(numpy.concatenate([own[..., :1], numpy.zeros_like(own[..., :1]), own[..., 1:]], axis=-1), numpy)


def in_world(
    grasps: Grasps,
    pose: Float[Array, "*batch 3"],
    size: Float[Array, "*batch 3"],
    surface_height: Float[Array, "*batch"],
) -> Grasps:
    """The grasps of objects in W.

    Args:
        grasps: in the objects' frames, G of each.
        pose: of the objects, (x, y, yaw) in W.
        size: x, y, z (m).
        surface_height: m, of what the objects stand on.
    """
    sine, cosine = (x[..., None] for x in sin_cos(pose[..., 2]))
    own_x, own_y, own_z, roll, pitch, yaw = jnp.moveaxis(grasps.pose, -1, 0)
    x = pose[..., 0, None] + cosine * own_x - sine * own_y
    y = pose[..., 1, None] + sine * own_x + cosine * own_y
    z = (surface_height + 0.5 * size[..., 2])[..., None] + own_z
    moved = jnp.stack([x, y, z, roll, pitch, pose[..., 2, None] + yaw], axis=-1)
    return Grasps(moved, grasps.approach, grasps.symmetric, grasps.there)


def chosen(grasps: Grasps, index: Int[Array, "*batch"]) -> Grasps:
    """One grasp of each object, by its index, without the axis of G."""
    at = index[..., None]
    pose = jnp.take_along_axis(grasps.pose, at[..., None], axis=-2)[..., 0, :]
    rest = (jnp.take_along_axis(x, at, axis=-1)[..., 0] for x in (grasps.approach, grasps.symmetric, grasps.there))
    return Grasps(pose, *rest)


def from_the_side(directions: int, back: float) -> Grasps:
    """Level grasps towards an object's centre from evenly spread directions, in its frame, on the host.

    Args:
        directions: how many; the first comes along the object's y.
        back: of tool0 from the centre (m).
    """
    angle = 2.0 * np.pi * np.arange(directions) / directions
    place = back * np.stack([np.sin(angle), -np.cos(angle), np.zeros(directions)], axis=-1)
    level = np.stack([np.full(directions, -np.pi / 2), np.zeros(directions), angle], axis=-1)
    pose: Any = np.concatenate([place, level], axis=-1).astype(np.float32)
    one: Any = np.ones(directions, bool)
    return Grasps(pose, 0 * pose[:, 0], one, one)


def together(grasps: Sequence[Grasps], axis: int = 0) -> Grasps:
    """Several on the host in one, along an axis of all leaves but the pose's last."""
    return jax.tree.map(lambda *x: np.concatenate(x, axis), *grasps)


def padded(grasps: Grasps, count: int) -> Grasps:
    """An object's grasps on the host with copies of the first behind, which aren't there, so that there are `count`."""
    own = len(grasps.there)
    filled = grasps[np.r_[:own, np.zeros(count - own, int)]]
    return dataclasses.replace(filled, there=filled.there & (np.arange(count) < own))


def of_objects(grasps: Sequence[Grasps]) -> Grasps:
    """Those of M objects on the host as one "M G": as many for each, of few numbers, so that programs are shared."""
    most = max(len(each.there) for each in grasps)
    count = next(size for size in _SIZES if size >= most)
    return jax.tree.map(lambda *x: np.stack(x), *(padded(each, count) for each in grasps))


def select(grasps: Grasps, score: Float[np.ndarray, " G"], count: int) -> Int[np.ndarray, " C"]:
    """Which of an object's grasps planning looks at, where there are many: all directions, and the best first.

    The best by its score is taken, then always the one that is farthest from those taken, by the angle (rad) between
    the tools' z and the distance between tool0 in quarters of a metre; the better score, then the earlier grasp, breaks
    ties. Up to `count` are all kept, in their order.

    Args:
        grasps: on the host.
        score: the more, the better.
        count: how many are kept.
    """
    if len(score) <= count:
        return np.arange(len(score))
    roll, pitch, yaw = grasps.pose[:, 3:].astype(float).T
    axis = np.stack(
        [
            np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll),
            np.sin(yaw) * np.sin(pitch) * np.cos(roll) - np.cos(yaw) * np.sin(roll),
            np.cos(pitch) * np.cos(roll),
        ],
        axis=-1,
    )
    apart = np.linalg.norm(grasps.pose[:, None, :3] - grasps.pose[:, :3], axis=-1) / _FAR_M
    apart = np.round(apart + np.arccos(np.clip(axis @ axis.T, -1.0, 1.0)), 6)
    order = np.argsort(-score, kind="stable")
    taken = [int(order[0])]
    nearest = apart[taken[0]]
    for _ in range(count - 1):
        taken.append(int(order[np.argmax(nearest[order])]))
        nearest = np.minimum(nearest, apart[taken[-1]])
    return np.array(taken)
