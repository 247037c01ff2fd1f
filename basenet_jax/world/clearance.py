"""Fast, exact collision tests of base and arm against a room's boxes and the robot's own body."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds
from basenet_jax.geometry import rectangles_overlap, relative
from basenet_jax.robot.distances import segment_box_distance
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
from basenet_jax.world.boxes import Boxes, Room, blocks

_COLUMNS_AT_ONCE, _ROUNDS = 64, 32  # distances are computed for 64 columns of a batch at a time, or 1/32 of it
_ROUNDING = 1e-4  # m: far beyond float32's at some metres

# (start and end of a segment in the box's frame, the box's half size, radius) -> whether something holds for them
_Test = Callable[[Vector, Vector, Vector, Array], Array]


def base_collides(
    robot: Robot, base_pose: Float[Array, "*batch 3"], room: Room, clearance: float = 0.10, touching: float = 1e-5
) -> Bool[Array, "*batch"]:
    """Whether the base's rectangle overlaps a grown box that blocks it, or leaves the floor; touching is overlap.

    Args:
        robot: its footprint and the height of its body count.
        base_pose: (x, y, heading) in W.
        room: one for the whole batch, or one per pose.
        clearance: by which boxes are grown per side (m).
        touching: m, up to which a distance counts as touching.
    """
    return leaves_floor(robot, base_pose, room) | jnp.any(
        boxes_hit(robot, base_pose, room.boxes, clearance, touching), axis=-1
    )


# For callers that aren't compiled: one program instead of thirty small ones.
compiled_base_collides = jax.jit(base_collides)


def boxes_hit(
    robot: Robot, base_pose: Float[Array, "*batch 3"], boxes: Boxes, clearance: float = 0.10, touching: float = 1e-5
) -> Bool[Array, "*batch B"]:
    """Which boxes block the base at a pose, see `base_collides`."""
    in_box = relative(boxes.pose, base_pose[..., None, :])
    overlap = rectangles_overlap(in_box, robot.footprint_half_size, boxes.half_size + clearance, touching)
    return overlap & blocks(boxes, body_top(robot))


def leaves_floor(robot: Robot, base_pose: Float[Array, "*batch 3"], room: Room) -> Bool[Array, "*batch"]:
    """Whether part of the base's rectangle is beyond the floor's bounds."""
    sine, cosine = (jnp.abs(x) for x in sin_cos(base_pose[..., 2]))
    length, width = robot.footprint_half_size[0], robot.footprint_half_size[1]
    x, y, floor = base_pose[..., 0], base_pose[..., 1], room.floor
    across, along = cosine * length + sine * width, sine * length + cosine * width
    return ~(
        (x - across >= floor[..., 0])
        & (y - along >= floor[..., 1])
        & (x + across <= floor[..., 2])
        & (y + along <= floor[..., 3])
    )


def body_top(robot: Robot) -> Float[Array, ""]:
    """Height (m) of the body box's top over the floor: boxes above it don't block the base."""
    return robot.body_center[2] + robot.body_half_size[2]


def arm_collides(
    robot: Robot, base_pose: Float[Array, "*batch 3"], joints: Float[Array, "*batch dof"], room: Room
) -> Bool[Array, "*batch"]:
    """Whether a capsule of arm or gripper touches a box that blocks the arm, or the robot's body box."""
    return capsules_touch(robot, components(base_pose), jnp.moveaxis(joints, -1, 0), room)


def capsules_touch(robot: Robot, base_pose: Vector, joints: Float[Array, "dof *batch"], room: Room) -> Array:
    """`arm_collides` on struct-of-arrays poses and joints, whose batches broadcast; rooms along the batch's last axis.

    Of several boxes only those are looked at, for each column of the batch (its last axis), that the arm could reach
    from there; they are few, whatever the room.
    """
    boxes = room.boxes
    count = boxes.low.shape[-1]
    if count == 1:
        return _touch_one(robot, base_pose, joints, jax.tree.map(lambda x: x[..., 0, :], _box_of(boxes)))
    shape = jnp.broadcast_shapes(joints.shape[1:], *(jnp.shape(x) for x in base_pose))
    columns = shape[-1] if shape else 1
    base_pose, joints = jax.tree.map(lambda x: jnp.broadcast_to(x, (*jnp.shape(x)[:-1], columns)), (base_pose, joints))
    by_box = jax.tree.map(lambda x: jnp.broadcast_to(jnp.asarray(x), (columns, *x.shape[-2:])), _box_of(boxes))
    near = _within_arm(robot, base_pose, by_box)
    near = near.at[:, 0].set(near[:, 0] | ~jnp.any(near, axis=1))  # the robot's own body is tested beside a box

    def check(pair: Int[Array, " at_once"], touches: Array) -> Array:
        column, box = jnp.divmod(jnp.minimum(pair, near.size - 1), count)
        own = jax.tree.map(lambda x: x[column, box], by_box)
        found = _touch_one(robot, *rounds.take((base_pose, joints), column), own)
        return touches.at[..., jnp.where(pair < near.size, column, columns)].max(found, mode="drop")

    nothing = jnp.zeros((*shape[:-1], columns), bool)
    touches = rounds.over_chosen(near.ravel(), check, nothing, min(near.size, columns))
    return touches.reshape(shape)


class _Box(NamedTuple):
    """A box that may block the arm; leaves with the columns of a batch, or the same for all."""

    pose: Float[Array, "*batch 3"]
    half_size: Float[Array, "*batch 3"]
    center: Float[Array, "*batch 1"]  # m, height of its centre
    blocks: Bool[Array, "*batch 1"]


def _box_of(boxes: Boxes) -> _Box:
    """All boxes, with their heights as half sizes and centres."""
    half = 0.5 * (boxes.high - boxes.low)[..., None]
    size = jnp.concatenate([boxes.half_size, half], axis=-1)
    return _Box(boxes.pose, size, 0.5 * (boxes.high + boxes.low)[..., None], boxes.blocks_arm[..., None])


def _within_arm(robot: Robot, base_pose: Vector, boxes: _Box) -> Bool[Array, "columns B"]:
    """Which boxes the arm could reach from a base pose with any of its capsules; those that don't block it are not."""
    x, y, heading = base_pose
    sine, cosine = sin_cos(heading)
    mount = robot.mount_position
    shoulder = jnp.stack(
        [x + cosine * mount[0] - sine * mount[1], y + sine * mount[0] + cosine * mount[1], jnp.zeros_like(x)], axis=-1
    )
    beyond = jnp.abs(relative(boxes.pose, shoulder[..., None, :])[..., :2]) - boxes.half_size[..., :2]
    distance = jnp.linalg.norm(jnp.maximum(beyond, 0.0), axis=-1)
    return boxes.blocks[..., 0] & (distance <= _arm_length(robot) + _ROUNDING)


def _arm_length(robot: Robot) -> Float[Array, ""]:
    """How far (m) a point of a capsule can be from where the arm is mounted, at most."""
    travel = jnp.where(
        jnp.array(robot.prismatic), jnp.maximum(jnp.abs(robot.joint_lower), jnp.abs(robot.joint_upper)), 0.0
    )
    links = jnp.cumsum(jnp.linalg.norm(robot.joint_position, axis=-1) + travel)
    to_link = jnp.concatenate([jnp.zeros(1), links])[np.array(robot.capsule_link)]
    ends = jnp.maximum(*(jnp.linalg.norm(x, axis=-1) for x in (robot.capsule_start, robot.capsule_end)))
    return jnp.max(to_link + ends + robot.capsule_radius)


def _touch_one(robot: Robot, base_pose: Vector, joints: Float[Array, "dof *batch"], box: _Box) -> Array:
    """Whether the arm touches one box for each column of the batch, or the robot's body.

    Few states come near anything. A test of bounding boxes, far cheaper than distances, finds them; exact
    distances are then computed for the columns with such a state, some at a time. Small batches are spared the first
    test, and its half of the program.
    """
    seen = relative(box.pose, jnp.stack(jnp.broadcast_arrays(*base_pose), axis=-1))  # in the box's frame
    columns: tuple[Vector, Array, Any] = (components(seen), joints, jax.tree.map(components, box))
    shape = jnp.broadcast_shapes(joints.shape[1:], *(jnp.shape(x) for x in (*columns[0], *columns[2].half_size)))
    if not shape or shape[-1] <= _COLUMNS_AT_ONCE:  # at once in any case
        return _walk(robot, *columns, test=_touches)
    columns = jax.tree.map(lambda x: jnp.broadcast_to(x, (*jnp.shape(x)[:-1], shape[-1])), columns)
    near = jnp.any(_walk(robot, *columns, test=_may_touch), axis=tuple(range(len(shape) - 1)))
    at_once = max(_COLUMNS_AT_ONCE, shape[-1] // _ROUNDS)

    def check(index: Array, _: tuple[Array, Array]) -> tuple[Array, Array]:
        exact = _walk(robot, *rounds.take(columns, index), test=_touches)
        return jnp.zeros(at_once, bool), jnp.broadcast_to(exact, (*shape[:-1], at_once))

    return rounds.until_settled(lambda state: state[0], check, (near, jnp.zeros(shape, bool)), at_once)[1]


def _walk(
    robot: Robot, base_pose: Vector, joints: Float[Array, "dof *batch"], box: Any, *, test: _Test
) -> Bool[Array, "*batch"]:
    """Whether a test holds for any capsule and the box, in whose frame the base's pose is, or the robot's body box.

    One scan walks up the arm from capsule to capsule. As straight-line code XLA merges all capsules into one loop
    that no longer vectorises: six times slower, eight times the compile time.
    """
    sine, cosine = sin_cos(base_pose[2])
    body_half, body_center = tuple(robot.body_half_size), tuple(robot.body_center)
    (center,), (blocks_arm,) = box.center, box.blocks
    shape = jnp.broadcast_shapes(joints.shape[1:], *(jnp.shape(x) for x in (*base_pose, *box.half_size)))

    def walk(carry: tuple[Frame, Array], stage: _Stage) -> tuple[tuple[Frame, Array], None]:
        frame, holds = carry
        frame = attach(frame, stage.rotation, stage.position)
        frame = frame._replace(origin=add(frame.origin, scale(stage.slide, frame.z)))
        frame = turn(frame, stage.angle)
        start, end = transform(frame, tuple(stage.start)), transform(frame, tuple(stage.end))
        in_box = [
            (
                cosine * p[0] - sine * p[1] + base_pose[0],
                sine * p[0] + cosine * p[1] + base_pose[1],
                p[2] - center,
            )
            for p in (start, end)
        ]
        meets_box = test(in_box[0], in_box[1], box.half_size, stage.radius) & blocks_arm
        meets_body = test(subtract(start, body_center), subtract(end, body_center), body_half, stage.body_radius)
        return (frame, holds | meets_box | meets_body), None

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
