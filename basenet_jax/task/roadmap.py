"""Where the base turns between boxes, and what it takes from one such place to the next: made once for a room."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.config import DockedConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import straight_duration, turn_duration
from basenet_jax.task.drive_space import DriveSpace, drive_space, is_free, is_turning_place
from basenet_jax.world.boxes import Room, pad

SAME_PLACE_M = 2e-5  # nearer places are one, and no direction leads from one to the other: rounding at some metres
_CORNERS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
_LEAST = 24  # boxes, vias and neighbours are padded to this, 32, 48, 64, 96 and so on, so that rooms share programs
_SMALL = 4096  # places in all lists together
BLOCK = 8  # neighbours that are gone through at once; what they are padded to is a multiple of it


@struct.dataclass
class Roadmap:
    """Up to V vias, corners of grown boxes at which the base may turn, and the up to D that are seen from each."""

    space: DriveSpace
    via: Float[Array, "V 2"]  # m, in W
    is_via: Bool[Array, " V"]
    neighbour: Int[Array, "V D"]  # which via
    back: Int[Array, "V D"]  # where the same piece stands for the neighbour, as an index into V · D
    time: Float[Array, "V D"]  # s, of the piece; infinite: there is none
    turn: Float[Array, "V D D"]  # s, coming from the one neighbour and leaving for the other; 0 if omnidirectional
    rows: Int[Array, " R"]  # indices into V · D, via by via, of whole blocks that hold its pieces; V · D pads
    reverse: bool = struct.field(pytree_node=False, default=True)  # whether the base may drive so


def make_roadmap(robot: Robot, room: Room, config: DockedConfig = DockedConfig(), *, reverse: bool = True) -> Roadmap:
    """The roadmap of a room, on the host.

    Args:
        robot: its base counts.
        room: one room, not a batch.
        config: what it keeps clear of.
        reverse: whether the base may drive in reverse; where it drives in any direction, that is no question.
    """
    room = jax.device_get(room)
    room = dataclasses.replace(room, boxes=pad(room.boxes, padded(len(room.boxes.low))))
    space = drive_space(robot, room, config)
    via = _vias(space)
    count, size = len(via), padded(len(via))
    via = np.pad(via, [(0, size - count), (0, 0)])
    is_via = np.arange(size) < count
    seen = np.asarray(_see(space, via, via))
    seen = seen & seen.T & is_via & is_via[:, None]
    neighbour, back = _lists(seen & (np.hypot(*(via - via[:, None]).T) > SAME_PLACE_M))
    none = neighbour < 0
    away = via[neighbour] - via[:, None]
    direction = np.arctan2(away[..., 1], away[..., 0])
    time, turn = _times(robot, np.hypot(*away.T).T, direction)
    time = np.where(none, np.inf, time)
    leaves: tuple[Any, ...] = (via, is_via, np.maximum(neighbour, 0), back, time, turn, _rows(~none))
    return Roadmap(space, *leaves, reverse=reverse or robot.omnidirectional)


def road_turn_time(robot: Robot, angle: Array) -> Float[Array, "*batch"]:
    """Duration (s) of a turn on a road, the shorter way round: an omnidirectional base turns once in all, elsewhere."""
    return jnp.zeros_like(angle) if robot.omnidirectional else turn_duration(robot, angle)


def padded(count: int) -> int:
    """The size that so many are padded to."""
    above = 1 << max(count - 1, 1).bit_length()
    return max(_LEAST, above * 3 // 4 if count <= above * 3 // 4 else above)


def _vias(space: DriveSpace) -> Float[np.ndarray, "vias 2"]:
    """Corners of grown boxes that are turning places, each once."""
    half = np.asarray(space.half_size) + (space.radius + space.clearance)
    corner = _CORNERS * half[:, None]
    sine, cosine = np.sin(space.pose[:, 2, None]), np.cos(space.pose[:, 2, None])
    x, y = corner[..., 0], corner[..., 1]
    corner = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1) + space.pose[:, None, :2]
    good = np.asarray(_turning_places(space, corner)) & np.all(half > 0, axis=-1, keepdims=True)
    corner = np.asarray(corner)[good]
    _, first = np.unique(np.round(corner / SAME_PLACE_M), axis=0, return_index=True)
    return corner[np.sort(first)]


@jax.jit
def _turning_places(space: DriveSpace, point: Array) -> Array:
    return is_turning_place(space, (point[..., 0], point[..., 1]))


@jax.jit
def _see(space: DriveSpace, start: Array, end: Array) -> Array:
    return is_free(space, (start[:, None, 0], start[:, None, 1]), (end[:, 0], end[:, 1]))


def _lists(seen: Bool[np.ndarray, "V V"]) -> tuple[Int[np.ndarray, "V D"], Int[np.ndarray, "V D"]]:
    """Each via's neighbours (-1: no more), and the place of the same piece in the neighbour's own list."""
    size, degree = len(seen), padded(int(seen.sum(axis=1).max()))
    rank = np.cumsum(seen, axis=1) - 1
    start, end = np.nonzero(seen)
    neighbour, back = np.full((size, degree), -1), np.arange(size * degree).reshape(size, degree)
    neighbour[start, rank[start, end]] = end
    back[start, rank[start, end]] = end * degree + rank[end, start]
    return neighbour, back


def _rows(there: Bool[np.ndarray, "V D"]) -> Int[np.ndarray, " R"]:
    """Where the pieces are: in a large room most vias see few others, and one of them many, to which lists are padded.

    In smaller ones the gain isn't worth further shapes to compile.
    """
    size = there.size
    if size <= _SMALL:
        return np.arange(size, dtype=np.int32)
    held = np.arange(there.shape[1]) < -(-there.sum(axis=1, keepdims=True) // BLOCK) * BLOCK
    rows = np.flatnonzero(held)
    return np.pad(rows, (0, padded(len(rows)) - len(rows)), constant_values=size).astype(np.int32)


@jax.jit
def _times(robot: Robot, length: Array, direction: Array) -> tuple[Array, Array]:
    """Of all pieces, and of the turns from each to each: it arrives from where it would leave to, turned by pi."""
    time = straight_duration(robot, length)
    return time, road_turn_time(robot, direction[:, None, :] - direction[:, :, None] - jnp.pi)
