"""Random scenes and base-pose problems, drawn under jit."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from basenet_jax.config import PLACES_AT_ONCE, SceneConfig
from basenet_jax.robot.model import Robot
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import base_collides
from basenet_jax.world.grasps import in_world, of_class
from basenet_jax.world.scene import MAX_OBJECTS, OBJECT_CLASSES, Scene

# Sizes, grasps of objects that are of no class, drawn in training so that policies serve users' own objects:
# lower and upper bounds of size x, y, z and grasp x, z, yaw, wider than the five classes'.
_OWN_CLASS_LOW = (0.03, 0.03, 0.04, -0.09, 0.27, -jnp.pi)
_OWN_CLASS_HIGH = (0.16, 0.16, 0.26, 0.09, 0.37, jnp.pi)


class Objects(NamedTuple):
    """What objects are, before they are placed."""

    size: Float[Array, "M 3"]
    grasp: Float[Array, "M 3"]
    class_index: Int[Array, " M"]


def draw_scene(
    key: PRNGKeyArray,
    count: Int[Array, ""] | int,
    room: Room,
    *,
    slots: int = MAX_OBJECTS,
    own_class_share: float = 0.0,
    config: SceneConfig = SceneConfig(),
) -> tuple[Scene, Bool[Array, ""]]:
    """One random scene; vmap over keys (and counts) for a batch.

    Objects are placed the largest first, each at the first of `config.tries` uniform positions that is far enough
    from those placed before; where one finds none the whole scene is drawn again, `config.redraws` times at most.

    Args:
        key: consumed.
        count: number of objects, 1 to `slots`.
        room: where they stand: on its first box, the table.
        slots: M, objects that the scene has room for.
        own_class_share: probability of an object with random size and grasp instead of one of the five classes.
        config: margins and numbers of tries.

    Returns:
        The scene, and whether all objects found a place.
    """
    redraw_key, start_key = jax.random.split(key)

    def draw(carry):
        attempt, _, _, _ = carry
        class_key, place_key, yaw_key = jax.random.split(jax.random.fold_in(redraw_key, attempt), 3)
        objects = _draw_objects(class_key, slots, own_class_share)
        position, placed = _place(place_key, objects, jnp.arange(slots) < count, room, config)
        yaw = jax.random.uniform(yaw_key, (slots, 1), minval=-jnp.pi, maxval=jnp.pi)
        return attempt + 1, objects, jnp.concatenate([position, yaw], axis=-1), placed

    nothing = Objects(jnp.zeros((slots, 3)), jnp.zeros((slots, 3)), jnp.zeros(slots, jnp.int32))
    start = (0, nothing, jnp.zeros((slots, 3)), jnp.array(False))
    _, objects, pose, placed = jax.lax.while_loop(lambda c: ~c[3] & (c[0] < 1 + config.redraws), draw, start)
    scene = Scene(
        object_pose=pose,
        object_size=objects.size,
        object_grasps=of_class(objects.grasp),
        object_class=objects.class_index,
        mask=jnp.arange(slots) < count,
        surface_height=jnp.full(slots, room.table_height),
        robot_start=_draw_start(start_key, config),
        room=room,
    )
    return scene, placed


def draw_problem(
    key: PRNGKeyArray, robot: Robot, room: Room, *, own_class_share: float = 0.0, config: SceneConfig = SceneConfig()
) -> tuple[Float[Array, "4"], Float[Array, "3"]]:
    """One base-pose problem: the grasp of one object anywhere on the table, and a collision-free robot pose.

    The robot is within 3 m of the table's centre (paper), in half of the draws with |x| <= 2 and |y| <= 1.5.

    Returns:
        tool0's x, y, z, yaw in W at the grasp, and the robot's pose in W.
    """
    class_key, pose_key, robot_key = jax.random.split(key, 3)
    objects = _draw_objects(class_key, 1, own_class_share)
    limit = jnp.append(room.table_half_size - config.edge_margin_m, jnp.pi)
    pose = limit * jax.random.uniform(pose_key, (1, 3), minval=-1.0)
    grasp = in_world(of_class(objects.grasp), pose, objects.size, room.table_height)
    return grasp[0, 0].planar, _draw_clear_pose(robot_key, robot, room)


def _draw_objects(key: PRNGKeyArray, slots: int, own_class_share: float) -> Objects:
    """All from one draw of uniform numbers: each call of a generator adds a third of a second of compilation."""
    uniform = jax.random.uniform(key, (slots, 8))
    index = (uniform[:, 0] * len(OBJECT_CLASSES)).astype(jnp.int32)
    size = jnp.array([c.size for c in OBJECT_CLASSES])[index]
    grasp = jnp.array([(c.grasp_x, c.grasp_z, c.grasp_yaw) for c in OBJECT_CLASSES])[index]
    low, high = jnp.array(_OWN_CLASS_LOW), jnp.array(_OWN_CLASS_HIGH)
    own = low + uniform[:, 2:] * (high - low)
    is_own = uniform[:, 1] < own_class_share
    return Objects(
        size=jnp.where(is_own[:, None], own[:, :3], size),
        grasp=jnp.where(is_own[:, None], own[:, 3:], grasp),
        class_index=jnp.where(is_own, -1, index),
    )


def footprint_radius(size: Float[Array, "*batch 3"], config: SceneConfig = SceneConfig()) -> Float[Array, "*batch"]:
    """Radius (m) that an object keeps free: half the diagonal of its x and y, at most 0.09."""
    return jnp.minimum(0.5 * jnp.hypot(size[..., 0], size[..., 1]), config.max_footprint_radius_m)


def _place(
    key: PRNGKeyArray, objects: Objects, wanted: Bool[Array, " M"], room: Room, config: SceneConfig
) -> tuple[Float[Array, "M 2"], Bool[Array, ""]]:
    """Positions of the wanted objects, the largest placed first, and whether all found one."""
    radius = jnp.where(wanted, footprint_radius(objects.size, config), -jnp.inf)
    order = jnp.argsort(-radius)
    limit = room.table_half_size - config.edge_margin_m

    def place_next(carry, item):
        position, placed = carry  # placed[i]: whether object i stands already
        key, index = item
        gap = jnp.where(placed, radius + radius[index], 0.0)

        def try_some(state):
            attempt, _, _ = state
            spots = jax.random.uniform(
                jax.random.fold_in(key, attempt), (PLACES_AT_ONCE, 2), minval=-limit, maxval=limit
            )
            distance = jnp.linalg.norm(spots[:, None] - position[None], axis=-1)
            fits = jnp.all(distance >= gap, axis=-1)
            return attempt + 1, spots[jnp.argmax(fits)], jnp.any(fits)

        rounds = config.tries // PLACES_AT_ONCE
        start = (0, jnp.zeros(2), ~wanted[index])
        _, spot, found = jax.lax.while_loop(lambda s: ~s[2] & (s[0] < rounds), try_some, start)
        return (position.at[index].set(spot), placed.at[index].set(wanted[index])), found

    start = (jnp.zeros((len(wanted), 2)), jnp.zeros(len(wanted), bool))
    (position, _), found = jax.lax.scan(place_next, start, (jax.random.split(key, len(wanted)), order))
    return position, jnp.all(found)


def _draw_start(key: PRNGKeyArray, config: SceneConfig) -> Float[Array, "3"]:
    uniform = jax.random.uniform(key, (3,))
    nearest, farthest = config.start_distance_m
    distance = nearest + uniform[0] * (farthest - nearest)
    bearing, heading = (2.0 * uniform[1] - 1.0) * jnp.pi, (2.0 * uniform[2] - 1.0) * jnp.pi
    return jnp.stack([distance * jnp.cos(bearing), distance * jnp.sin(bearing), heading])


def _draw_clear_pose(key: PRNGKeyArray, robot: Robot, room: Room) -> Float[Array, "3"]:
    """A collision-free base pose; the chance that none of the tries is free is below 1e-12."""
    uniform = jax.random.uniform(key, (PLACES_AT_ONCE + 1, 3))
    tries, in_box = uniform[1:], uniform[0, 0] < 0.5
    box = (2.0 * tries[:, :2] - 1.0) * jnp.array([2.0, 1.5])
    radius, angle = 3.0 * jnp.sqrt(tries[:, 0]), 2.0 * jnp.pi * tries[:, 1]
    disc = jnp.stack([radius * jnp.cos(angle), radius * jnp.sin(angle)], axis=-1)
    heading = (2.0 * tries[:, 2:] - 1.0) * jnp.pi
    poses = jnp.concatenate([jnp.where(in_box, box, disc), heading], axis=-1)
    return poses[jnp.argmax(~base_collides(robot, poses, room))]
