"""Where a base of some size fits while it moves: tests of points, roads and swept footprints among a room's boxes.

Points and directions are pairs of arrays (x, y) that broadcast. Boxes are gone through one by one in a scan, over whole
arrays each: a small program that vectorises, whatever the number of boxes.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax import struct
from basenet_jax.config import DockedConfig
from basenet_jax.robot.model import Robot
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.boxes import Room, blocks

Pair = tuple[Array, Array]  # x, y (m), or cosine and sine of a heading

TOUCHING_M = 1e-5  # footprints that overlap by less touch: far beyond float32's rounding at some metres
_AWAY_M = 1e3  # taken off the half sizes of boxes that aren't in the way: no point lies in them
_PARALLEL = 1e-6  # part of a direction along an axis, in which rounding could have any sign


@struct.dataclass
class DriveSpace:
    """What stands in the way of a robot's base, and what it keeps clear of."""

    pose: Float[Array, "B 3"]  # of the boxes: centre's x, y (m) and yaw (rad) in W
    half_size: Float[Array, "B 2"]  # m; below zero for boxes that aren't in the way
    floor: Float[Array, "4"]  # x_min, y_min, x_max, y_max (m)
    footprint: Float[Array, "2"]  # m, half its sides
    radius: Float[Array, ""]  # m, half the footprint's diagonal
    clearance: Float[Array, ""]  # m, see `DockedConfig`
    slack: Float[Array, ""]
    undock: Float[Array, ""]
    touching: Float[Array, ""]


def drive_space(robot: Robot, room: Room, config: DockedConfig = DockedConfig()) -> DriveSpace:
    """What a robot drives among in a room; traceable, and NumPy's arrays where all is NumPy's.

    Args:
        robot: its footprint and its body's height count.
        room: one room, not a batch.
        config: what it keeps clear of.
    """
    boxes, footprint = room.boxes, robot.footprint_half_size
    top: Any = robot.body_center[2] + robot.body_half_size[2]
    leaves: dict[str, Any] = {
        "pose": boxes.pose,
        "half_size": boxes.half_size - _AWAY_M * ~blocks(boxes, top)[..., None],
        "floor": room.floor,
        "footprint": footprint,
        "radius": (footprint[0] ** 2 + footprint[1] ** 2) ** 0.5,
        "clearance": config.clearance_m,
        "slack": config.road_slack_m,
        "undock": config.undock_m,
        "touching": TOUCHING_M,
    }
    return DriveSpace(**leaves)


def is_turning_place(space: DriveSpace, point: Pair) -> Bool[Array, "*batch"]:
    """Whether the base may turn to any heading at a point."""
    inside = jnp.ones((), bool)
    for x, low, high in zip(point, *_rim(space), strict=True):
        inside &= (x >= low - space.touching) & (x <= high + space.touching)
    return inside & is_free(space, point, point)


def is_free(space: DriveSpace, start: Pair, end: Pair) -> Bool[Array, "*batch"]:
    """Whether the base's centre may drive from one point straight to another, in whatever heading.

    Both have to be turning places: the floor's rim is not tested.
    """
    middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
    extent = (0.5 * (end[0] - start[0]), 0.5 * (end[1] - start[1]))

    def enters(box: _Box) -> Array:
        (x, y), (across, up) = box.seen(middle), box.turned(extent)
        width, height = jnp.abs(across), jnp.abs(up)
        outside = (jnp.abs(x) >= box.length + width) | (jnp.abs(y) >= box.width + height)
        return ~(outside | (jnp.abs(x * up - y * across) > box.length * height + box.width * width))

    return ~_any_box(space, space.radius + space.clearance - space.slack, enters, (*middle, *extent))


def footprint_fits(
    space: DriveSpace, center: Pair, heading: Pair, half_way: Pair | None = None, *, askew: bool = False
) -> Bool[Array, "*batch"]:
    """Whether the footprint keeps clear of all boxes and stays on the floor, at a place or all along a straight piece.

    Args:
        space: where.
        center: of the footprint, or the middle of the piece.
        heading: cosine and sine.
        half_way: half the piece (m, in W): the footprint is swept so far to either side.
        askew: whether pieces go in other directions than the heading too, so that what is swept is a hexagon.
    """
    cosine, sine = heading
    way = half_way or (jnp.zeros_like(cosine), jnp.zeros_like(sine))
    length, width = space.footprint

    def overlaps(box: _Box) -> Array:
        (x, y), (c, s), (i, j) = box.seen(center), box.turned(heading), box.turned(way)
        c_size, s_size = jnp.abs(c), jnp.abs(s)
        gaps = [
            jnp.abs(x) - (box.length + jnp.abs(i) + length * c_size + width * s_size),
            jnp.abs(y) - (box.width + jnp.abs(j) + length * s_size + width * c_size),
            jnp.abs(c * x + s * y) - (length + jnp.abs(c * i + s * j) + box.length * c_size + box.width * s_size),
            jnp.abs(c * y - s * x) - (width + jnp.abs(c * j - s * i) + box.length * s_size + box.width * c_size),
        ]
        if askew:  # the hexagon's third pair of sides lies along the way
            square = i * i + j * j
            size = jnp.sqrt(jnp.where(square > 0, square, 1.0))
            beside = jnp.abs(x * j - y * i) - (box.length * jnp.abs(j) + box.width * jnp.abs(i))
            beside -= length * jnp.abs(c * j - s * i) + width * jnp.abs(c * i + s * j)
            gaps.append(jnp.where(square > 0, beside / size, -jnp.inf))
        return functools.reduce(jnp.maximum, gaps) < -space.touching

    inside = jnp.ones((), bool)
    for axis, (along, across) in enumerate(((length, width), (width, length))):
        reach = along * jnp.abs(cosine) + across * jnp.abs(sine) + jnp.abs(way[axis]) - space.touching
        inside &= center[axis] - reach >= space.floor[axis]
        inside &= center[axis] + reach <= space.floor[axis + 2]
    return inside & ~_any_box(space, space.clearance, overlaps, (*center, *heading, *way))


def first_turning_place(space: DriveSpace, start: Pair, ray: Pair) -> Float[Array, "*batch"]:
    """How far (m) along a ray the first turning place is; infinite if there is none within `space.undock`.

    The exit of whatever grown boxes the start lies in, then of those that this exit lies in, until there are none.

    Args:
        space: where.
        start: of the ray.
        ray: its direction, of length 1.
    """
    boxes = _boxes(space, space.radius + space.clearance)
    point, along = (boxes.seen(_each(start)), boxes.turned(_each(ray)))
    half, inner = (boxes.length, boxes.width), (boxes.length - space.slack, boxes.width - space.slack)
    _, leave = _crossing(point, along, _minus(half), half)
    entered, left = _crossing(point, along, _minus(inner), inner)

    def leave_boxes(distance: Array) -> Array:
        inside = (entered < distance[..., None]) & (distance[..., None] < left)
        return jnp.max(jnp.where(inside, leave, distance[..., None]), axis=-1)

    enter_floor, leave_floor = _crossing(start, ray, *_rim(space))
    first = jnp.where(enter_floor > space.touching, enter_floor, 0.0)
    _, distance = jax.lax.while_loop(
        lambda pair: jnp.any(pair[1] > pair[0]),
        lambda pair: (pair[1], leave_boxes(pair[1])),
        (first, leave_boxes(first)),
    )
    found = (distance <= leave_floor + space.touching) & (distance <= space.undock)
    return jnp.where(found, distance, jnp.inf)


class _Box(NamedTuple):
    """One box, or all of them, grown."""

    x: Array
    y: Array
    cosine: Array
    sine: Array
    length: Array  # m, half
    width: Array

    def seen(self, point: Pair) -> Pair:
        """A point in the box's frame."""
        return self.turned((point[0] - self.x, point[1] - self.y))

    def turned(self, vector: Pair) -> Pair:
        """A vector in the box's frame."""
        return self.cosine * vector[0] + self.sine * vector[1], self.cosine * vector[1] - self.sine * vector[0]


def _boxes(space: DriveSpace, margin: Array) -> _Box:
    sine, cosine = sin_cos(space.pose[:, 2])
    half = space.half_size + margin
    return _Box(space.pose[:, 0], space.pose[:, 1], cosine, sine, half[:, 0], half[:, 1])


def _any_box(space: DriveSpace, margin: Array, test: Callable[[_Box], Array], like: tuple[Array, ...]) -> Array:
    """Whether a test of arrays that broadcast holds for any box grown by a margin (m)."""
    none = jnp.zeros(jnp.broadcast_shapes(*(jnp.shape(x) for x in like)), bool)
    return jax.lax.scan(lambda found, box: (found | test(box), None), none, _boxes(space, margin))[0]


def _rim(space: DriveSpace) -> tuple[Pair, Pair]:
    """The lowest and the highest coordinates of turning places."""
    low, high = space.floor[:2] + space.radius, space.floor[2:] - space.radius
    return (low[0], low[1]), (high[0], high[1])


def _crossing(start: Pair, ray: Pair, low: Pair, high: Pair) -> Pair:
    """Where a ray enters and leaves a rectangle; it leaves before it enters where it misses it, or none is there."""
    enter, leave = -jnp.inf, jnp.inf
    for i in range(2):
        parallel = jnp.abs(ray[i]) < _PARALLEL
        between = (low[i] < start[i]) & (start[i] < high[i])
        along = jnp.where(parallel, 1.0, ray[i])
        ends = [(side[i] - start[i]) / along for side in (low, high)]
        near, far = jnp.where(along > 0, ends[0], ends[1]), jnp.where(along > 0, ends[1], ends[0])
        enter = jnp.maximum(enter, jnp.where(parallel, jnp.where(between, -jnp.inf, jnp.inf), near))
        leave = jnp.minimum(leave, jnp.where(parallel, jnp.inf, far))
    return jnp.asarray(enter), jnp.asarray(leave)


def _each(pair: Pair) -> Pair:
    """With a last axis to go through boxes."""
    return pair[0][..., None], pair[1][..., None]


def _minus(pair: Pair) -> Pair:
    return -pair[0], -pair[1]
