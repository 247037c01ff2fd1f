"""Fast, exact collision tests of base and arm against the table and the robot's own body."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax import rounds
from basenet_jax.geometry import rectangles_overlap
from basenet_jax.robot.kinematics import (
    Frame,
    Vector,
    add,
    attach,
    components,
    mount_frame,
    scale,
    subtract,
    transform,
    turn,
)
from basenet_jax.robot.model import Robot
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.scene import Table

_COLUMNS_AT_ONCE, _ROUNDS = 64, 32  # distances are computed for 64 columns of a batch at a time, or 1/32 of it
_ROUNDING = 1e-4  # m: far beyond float32's at some metres

# (start and end of a segment in the box's frame, the box's half size, radius) -> whether something holds for them
_Test = Callable[[Vector, Vector, Vector, Array], Array]


def base_collides(
    robot: Robot, base_pose: Float[Array, "*batch 3"], table: Table, clearance: float = 0.10, touching: float = 1e-5
) -> Bool[Array, "*batch"]:
    """Whether the base's rectangle overlaps the table grown by `clearance` (m) per side; touching is overlap."""
    return rectangles_overlap(base_pose, robot.footprint_half_size, table.half_size + clearance, touching)


# For callers that aren't compiled: one program instead of thirty small ones.
compiled_base_collides = jax.jit(base_collides)


def arm_collides(
    robot: Robot, base_pose: Float[Array, "*batch 3"], joints: Float[Array, "*batch dof"], table: Table
) -> Bool[Array, "*batch"]:
    """Whether a capsule of arm or gripper touches the table's box or the robot's body box."""
    return capsules_touch(robot, components(base_pose), jnp.moveaxis(joints, -1, 0), table)


def capsules_touch(robot: Robot, base_pose: Vector, joints: Float[Array, "dof *batch"], table: Table) -> Array:
    """`arm_collides` on struct-of-arrays poses and joints, whose batches broadcast.

    Few states come near anything. A test of bounding boxes, far cheaper than distances, finds them; exact
    distances are then computed for the columns of the batch (its last axis) with such a state, some at a time. Small
    batches are spared the first test, and its half of the program.
    """
    size = (table.half_size[..., 0], table.half_size[..., 1], 0.5 * table.height)
    shape = jnp.broadcast_shapes(joints.shape[1:], *(jnp.shape(x) for x in (*base_pose, *size)))
    if not shape or shape[-1] <= _COLUMNS_AT_ONCE:  # at once in any case
        return _walk(robot, base_pose, joints, size, _touches)
    columns = jax.tree.map(lambda x: jnp.broadcast_to(x, (*jnp.shape(x)[:-1], shape[-1])), (base_pose, joints, size))
    base_pose, joints, size = columns
    near = jnp.any(_walk(robot, base_pose, joints, size, _may_touch), axis=tuple(range(len(shape) - 1)))
    at_once = max(_COLUMNS_AT_ONCE, shape[-1] // _ROUNDS)

    def check(index: Array, _: tuple[Array, Array]) -> tuple[Array, Array]:
        base_pose, joints, size = rounds.take(columns, index)
        exact = _walk(robot, base_pose, joints, size, _touches)
        return jnp.zeros(at_once, bool), jnp.broadcast_to(exact, (*shape[:-1], at_once))

    return rounds.until_settled(lambda state: state[0], check, (near, jnp.zeros(shape, bool)), at_once)[1]


def _walk(
    robot: Robot, base_pose: Vector, joints: Float[Array, "dof *batch"], table_half: Vector, test: _Test
) -> Bool[Array, "*batch"]:
    """Whether a test holds for any capsule and the table's box or the robot's body box.

    One scan walks up the arm from capsule to capsule. As straight-line code XLA merges all capsules into one loop
    that no longer vectorises: six times slower, eight times the compile time.
    """
    sine, cosine = sin_cos(base_pose[2])
    body_half, body_center = tuple(robot.body_half_size), tuple(robot.body_center)
    shape = jnp.broadcast_shapes(joints.shape[1:], *(jnp.shape(x) for x in (*base_pose, *table_half)))

    def walk(carry: tuple[Frame, Array], stage: _Stage) -> tuple[tuple[Frame, Array], None]:
        frame, holds = carry
        frame = attach(frame, stage.rotation, stage.position)
        frame = frame._replace(origin=add(frame.origin, scale(stage.slide, frame.z)))
        frame = turn(frame, stage.angle)
        start, end = transform(frame, tuple(stage.start)), transform(frame, tuple(stage.end))
        world = [
            (
                cosine * p[0] - sine * p[1] + base_pose[0],
                sine * p[0] + cosine * p[1] + base_pose[1],
                p[2] - table_half[2],
            )
            for p in (start, end)
        ]
        table = test(world[0], world[1], table_half, stage.radius)
        body = test(subtract(start, body_center), subtract(end, body_center), body_half, stage.body_radius)
        return (frame, holds | table | body), None

    root = jax.tree.map(lambda x: jnp.broadcast_to(x, shape).astype(joints.dtype), mount_frame(robot))
    (_, holds), _ = jax.lax.scan(walk, (root, jnp.zeros(shape, bool)), _stages(robot, joints))
    return holds


def _touches(start: Vector, end: Vector, half: Vector, radius: Array) -> Array:
    """Whether a capsule touches a box centred on the origin."""
    return segment_box_distance(start, end, half) <= radius


def _may_touch(start: Vector, end: Vector, half: Vector, radius: Array) -> Array:
    """Whether the capsule's own bounding box, with a margin for rounding, overlaps the box: necessary for touching."""
    overlaps = jnp.ones((), bool)
    for a, b, h in zip(start, end, half, strict=True):
        overlaps &= jnp.abs(a + b) <= 2.0 * (h + radius + _ROUNDING) + jnp.abs(a - b)
    return overlaps


class _Stage(NamedTuple):
    """One capsule on the walk up the arm: how to get to its link's frame from the capsule before, and its shape."""

    rotation: Array
    position: Array
    angle: Array  # rad, the joint's in between, for the batch; 0 where the link stays the same
    slide: Array  # m, likewise
    start: Array
    end: Array
    radius: Array  # minus infinity for a link without capsules: never touches
    body_radius: Array  # likewise against the body box, where some capsules aren't tested


def _stages(robot: Robot, joints: Float[Array, "dof *batch"]) -> _Stage:
    """The stages in order, stacked along a leading axis."""
    rest, nowhere, never = jnp.zeros_like(joints[0]), jnp.zeros(3), jnp.array(-jnp.inf)
    meets_body = robot.capsule_meets_body
    stages = []
    for link in range(len(joints) + 1):
        capsules = [index for index, owner in enumerate(robot.capsule_link) if owner == link]
        for order, index in enumerate(capsules or [None]):
            first = order == 0 and link > 0
            joint, sliding = joints[link - 1], robot.prismatic[link - 1]
            stages.append(
                _Stage(
                    rotation=robot.joint_rotation[link - 1] if first else jnp.eye(3),
                    position=robot.joint_position[link - 1] if first else nowhere,
                    angle=joint if first and not sliding else rest,
                    slide=joint if first and sliding else rest,
                    start=nowhere if index is None else robot.capsule_start[index],
                    end=nowhere if index is None else robot.capsule_end[index],
                    radius=never if index is None else robot.capsule_radius[index],
                    body_radius=robot.capsule_radius[index] if index is not None and meets_body[index] else never,
                )
            )
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *stages)


def segment_box_distance(start: Vector, end: Vector, half: Vector) -> Array:
    """Distance (m) from a segment to a solid box centred on the origin, 0 where they meet; exact.

    The squared distance of the point at parameter t is convex and piecewise quadratic, so half its derivative g(t)
    never falls and is linear between the parameters at which the segment crosses a face's plane. The last such
    parameter (or end) with g <= 0 and the first with g >= 0 enclose the minimum, and a straight line finds it.
    """
    along = subtract(end, start)
    inverse = tuple(jnp.where(d != 0, 1.0, 0.0) / jnp.where(d != 0, d, 1.0) for d in along)
    low, low_slope = jnp.zeros_like(start[0]), _half_slope(start, along, half, None)
    high, high_slope = jnp.ones_like(start[0]), _half_slope(start, along, half, 1.0)
    at_start, at_end = low_slope >= 0, high_slope <= 0
    for axis in range(3):
        for side in (-1.0, 1.0):
            t = jnp.clip((side * half[axis] - start[axis]) * inverse[axis], 0.0, 1.0)
            slope = _half_slope(start, along, half, t)
            better_low, better_high = (slope <= 0) & (t > low), (slope > 0) & (t < high)
            low, low_slope = jnp.where(better_low, t, low), jnp.where(better_low, slope, low_slope)
            high, high_slope = jnp.where(better_high, t, high), jnp.where(better_high, slope, high_slope)
    rise = high_slope - low_slope
    t = low - low_slope * (high - low) / jnp.where(rise > 0, rise, 1.0)
    t = jnp.where(at_start, 0.0, jnp.where(at_end, 1.0, t))
    outside = _outside(start, along, half, t)
    return jnp.sqrt(outside[0] * outside[0] + outside[1] * outside[1] + outside[2] * outside[2])


def _outside(start: Vector, along: Vector, half: Vector, t) -> Vector:
    """The vector from the box to the segment's point at parameter t (None: 0)."""
    point = start if t is None else add(start, scale(t, along))
    return tuple(p - jnp.clip(p, -h, h) for p, h in zip(point, half, strict=True))


def _half_slope(start: Vector, along: Vector, half: Vector, t) -> Array:
    """Half the derivative of the squared distance to the box, at parameter t (None: 0)."""
    outside = _outside(start, along, half, t)
    return along[0] * outside[0] + along[1] * outside[1] + along[2] * outside[2]
