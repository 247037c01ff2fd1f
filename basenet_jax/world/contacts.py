"""Which boxes an arm touches on its way: of objects, each of which counts by itself."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds
from basenet_jax.robot.distances import segment_box_distance
from basenet_jax.robot.kinematics import Vector, capsule_ends
from basenet_jax.robot.model import Robot
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.boxes import Boxes

_PAIRS_AT_ONCE = 256  # of batch and box, looked at state by state in one round
_CAPSULES_AT_ONCE = 128  # of theirs, whose distances in all states are computed in one round
_ROUNDING = 1e-4  # m: far beyond float32's at some metres


def boxes_touched(
    robot: Robot,
    base_pose: Vector,
    joints: Float[Array, "dof S B"],
    boxes: Boxes,
    asked: Bool[Array, " B"] | None = None,
) -> Bool[Array, "B N"]:
    """Which of N boxes that block the arm it touches, in any of S states, for each of a batch.

    The box that encloses the arm in all states tells which boxes are near, boxes about each capsule in each state which
    of those may touch; the distances of these few are exact.

    Args:
        robot: the robot.
        base_pose: (x, y, heading) in W.
        joints: rad, or m.
        boxes: in W, N for each of the batch.
        asked: for which of the batch; the others touch nothing. None: for all.
    """
    by_state = tuple(x[:, None] for x in base_pose)
    # All states of one of the batch side by side, so that they are taken at once.
    start, end = (_in_world(by_state, side) for side in capsule_ends(robot, jnp.swapaxes(joints, 1, 2)))
    radius = jnp.asarray(robot.capsule_radius)
    near = _near(start, end, jnp.max(radius), boxes)
    if asked is not None:
        near &= asked[:, None]
    count = boxes.low.shape[-1]

    def check(pair: Int[Array, " P"], touched: Array) -> Array:
        row, box = jnp.divmod(jnp.minimum(pair, near.size - 1), count)
        own = jax.tree.map(lambda x: x[row, box], boxes)
        some_start, some_end = (tuple(x[:, row] for x in side) for side in (start, end))
        found = _touches(some_start, some_end, radius, own)
        return touched.at[jnp.where(pair < near.size, row, len(near)), box].set(found, mode="drop")

    return rounds.over_chosen(near.ravel(), check, jnp.zeros(near.shape, bool), min(near.size, _PAIRS_AT_ONCE))


def _in_world(base_pose: Vector, points: Vector) -> Vector:
    x, y, heading = base_pose
    sine, cosine = sin_cos(heading)
    return (cosine * points[0] - sine * points[1] + x, sine * points[0] + cosine * points[1] + y, points[2])


def _near(start: Vector, end: Vector, radius: Array, boxes: Boxes) -> Bool[Array, "B N"]:
    """Whether the box about all capsules in all states, "C B S", and a box overlap: necessary for touching."""
    sine, cosine = (jnp.abs(x) for x in sin_cos(boxes.pose[..., 2]))
    along, across = boxes.half_size[..., 0], boxes.half_size[..., 1]
    half = (cosine * along + sine * across, sine * along + cosine * across, 0.5 * (boxes.high - boxes.low))
    center = (boxes.pose[..., 0], boxes.pose[..., 1], 0.5 * (boxes.high + boxes.low))
    near = boxes.blocks_arm
    for a, b, c, h in zip(start, end, center, half, strict=True):
        least = jnp.min(jnp.minimum(a, b), axis=(0, 2))[:, None] - radius - _ROUNDING
        most = jnp.max(jnp.maximum(a, b), axis=(0, 2))[:, None] + radius + _ROUNDING
        near &= (least <= c + h) & (most >= c - h)
    return near


def _touches(start: Vector, end: Vector, radius: Float[Array, " C"], box: Boxes) -> Bool[Array, " P"]:
    """Whether any of C capsules, in any of its S states, "C P S" in W, touches its box."""
    sine, cosine = (x[:, None] for x in sin_cos(box.pose[:, 2]))
    center = (*box.pose[:, :2].T, 0.5 * (box.high + box.low))
    half = (*box.half_size.T, 0.5 * (box.high - box.low))

    def in_box(point: Vector) -> Vector:
        along, across, up = (p - c[:, None] for p, c in zip(point, center, strict=True))
        return (cosine * along + sine * across, cosine * across - sine * along, up)

    start, end = in_box(start), in_box(end)
    overlaps, reach = jnp.ones((), bool), radius[:, None, None] + _ROUNDING
    for a, b, h in zip(start, end, half, strict=True):  # the segment's bounding box, and the box grown
        overlaps &= jnp.abs(a + b) <= 2.0 * (h[:, None] + reach) + jnp.abs(a - b)
    near = jnp.any(overlaps, axis=-1)
    pairs = near.shape[1]

    def check(row: Int[Array, " Q"], touches: Array) -> Array:
        """One capsule in all its states."""
        at = jnp.minimum(row, near.size - 1)
        which, pair = jnp.divmod(at, pairs)
        some_start, some_end = (tuple(x.reshape(near.size, -1)[at] for x in side) for side in (start, end))
        distance = segment_box_distance(some_start, some_end, tuple(h[pair, None] for h in half))
        found = jnp.any(distance <= radius[which, None], axis=1)
        return touches.at[jnp.where(row < near.size, pair, pairs)].max(found, mode="drop")

    return rounds.over_chosen(near.ravel(), check, jnp.zeros(pairs, bool), min(near.size, _CAPSULES_AT_ONCE))
