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

_PAIRS_AT_ONCE = 256  # of batch and box, whose distances are computed in one round
_ROUNDING = 1e-4  # m: far beyond float32's at some metres


def boxes_touched(robot: Robot, base_pose: Vector, joints: Float[Array, "dof S B"], boxes: Boxes) -> Bool[Array, "B N"]:
    """Which of N boxes that block the arm it touches, in any of S states, for each of a batch.

    Boxes that enclose each capsule in all its states tell which pairs may touch; the distances of these are exact.

    Args:
        robot: the robot.
        base_pose: (x, y, heading) in W.
        joints: rad, or m.
        boxes: in W, N for each of the batch.
    """
    start, end = (_in_world(base_pose, side) for side in capsule_ends(robot, joints))
    near = _may_touch(robot, start, end, boxes)
    count = boxes.low.shape[-1]

    def check(pair: Int[Array, " P"], touched: Array) -> Array:
        column, box = jnp.divmod(jnp.minimum(pair, near.size - 1), count)
        own = jax.tree.map(lambda x: x[column, box], boxes)
        found = _touches(robot, *rounds.take((start, end), column), own)
        return touched.at[jnp.where(pair < near.size, column, len(near)), box].set(found, mode="drop")

    return rounds.over_chosen(near.ravel(), check, jnp.zeros(near.shape, bool), min(near.size, _PAIRS_AT_ONCE))


def _in_world(base_pose: Vector, points: Vector) -> Vector:
    x, y, heading = base_pose
    sine, cosine = sin_cos(heading)
    return (cosine * points[0] - sine * points[1] + x, sine * points[0] + cosine * points[1] + y, points[2])


def _may_touch(robot: Robot, start: Vector, end: Vector, boxes: Boxes) -> Bool[Array, "B N"]:
    """Whether the boxes that enclose some capsule's states, and a box, overlap: necessary for touching."""
    sine, cosine = (jnp.abs(x) for x in sin_cos(boxes.pose[..., 2]))
    along, across = boxes.half_size[..., 0], boxes.half_size[..., 1]
    half = (cosine * along + sine * across, sine * along + cosine * across, 0.5 * (boxes.high - boxes.low))
    center = (boxes.pose[..., 0], boxes.pose[..., 1], 0.5 * (boxes.high + boxes.low))

    def meets(near: Array, capsule: tuple) -> tuple[Array, None]:
        ends, radius = capsule
        overlaps = jnp.ones((), bool)
        for a, b, c, h in zip(*ends, center, half, strict=True):  # "S B" beside "B N"
            least = jnp.min(jnp.minimum(a, b), axis=0)[:, None] - radius - _ROUNDING
            most = jnp.max(jnp.maximum(a, b), axis=0)[:, None] + radius + _ROUNDING
            overlaps &= (least <= c + h) & (most >= c - h)
        return near | overlaps, None

    nothing = jnp.zeros(boxes.low.shape, bool)
    near, _ = jax.lax.scan(meets, nothing, ((start, end), jnp.asarray(robot.capsule_radius)))
    return near & boxes.blocks_arm


def _touches(robot: Robot, start: Vector, end: Vector, box: Boxes) -> Bool[Array, " P"]:
    """Whether any capsule in any state, "capsules S P", touches its box."""
    x, y, yaw = (box.pose[..., axis] for axis in range(3))
    sine, cosine = sin_cos(yaw)
    half = (box.half_size[..., 0], box.half_size[..., 1], 0.5 * (box.high - box.low))

    def in_box(point: Vector) -> Vector:
        along, across = point[0] - x, point[1] - y
        return (cosine * along + sine * across, cosine * across - sine * along, point[2] - 0.5 * (box.high + box.low))

    def meets(touches: Array, capsule: tuple) -> tuple[Array, None]:
        (a, b), radius = capsule
        return touches | jnp.any(segment_box_distance(in_box(a), in_box(b), half) <= radius, axis=0), None

    nothing = jnp.zeros(x.shape, bool)
    return jax.lax.scan(meets, nothing, ((start, end), jnp.asarray(robot.capsule_radius)))[0]
