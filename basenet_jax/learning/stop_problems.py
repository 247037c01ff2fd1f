"""Endless problems for the stop policy without inverse kinematics in the loop.

What a pick takes depends on the stop and the object alone, not on the other objects. So a library of single objects,
each validated once at all stops, makes any number of scenes: draw some that don't overlap, and a robot start.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from basenet_jax import struct
from basenet_jax.config import WorldConfig
from basenet_jax.planners.candidates import check_candidates
from basenet_jax.policies.stop_policy import StopScene, access_time
from basenet_jax.robot.model import Robot
from basenet_jax.task.prepared_world import PreparedWorld
from basenet_jax.task.stop_problem import make_problem
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_scene, footprint_radius
from basenet_jax.world.scene import BY_SLOT, Scene

_TRIES_PER_OBJECT = 4  # objects drawn for each one to be placed; of 30 objects a few may find no room


@struct.dataclass
class Library:
    """L objects with what their picks take at all K stops, and L robot starts. Times in s."""

    grasps: Float[Array, "L 4"]  # tool0's x, y, z, yaw in W
    position: Float[Array, "L 2"]  # of the objects, m
    radius: Float[Array, " L"]  # m, that the object keeps free
    pick_time: Float[Array, "L K"]
    access: Float[Array, "L K"]
    starts: Float[Array, "L 3"]  # (x, y, heading) in W
    first_drive: Float[Array, "L K"]


def make_library(
    robot: Robot,
    room: Room,
    prepared: PreparedWorld,
    half_turn: Int[np.ndarray, " K"],
    key: Array,
    count: int,
    own_class_share: float,
    world: WorldConfig,
) -> Library:
    """A library of random objects and starts, and both once more turned by pi with the table.

    Args:
        robot: the robot.
        room: the table's.
        prepared: its stops.
        half_turn: see `half_turn_of`.
        key: consumed.
        count: half of L.
        own_class_share: of objects with random size and grasp.
        world: of scenes, picks and drives.
    """

    scenes = _single_objects(key, room, count, own_class_share, world)
    objects = dataclasses.replace(
        scenes,
        **{name: jax.tree.map(lambda x: x[:, 0], getattr(scenes, name)) for name in BY_SLOT},
        robot_start=scenes.robot_start[0],
        room=room,
    )
    picks = check_candidates(robot, objects, prepared.poses, world=world).pick_time
    first = prepared.first_drives(robot, scenes.robot_start)
    library = Library(
        grasps=objects.first_grasp,
        position=objects.object_pose[:, :2],
        radius=footprint_radius(objects.object_size, world.scene),
        pick_time=picks.T,
        access=access_time(prepared.drive, picks).T,
        starts=scenes.robot_start,
        first_drive=first,
    )
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), library, _turned(library, half_turn))


def _single_objects(key: Array, room: Room, count: int, own_class_share: float, world: WorldConfig) -> Scene:
    """A batch of scenes of one object."""

    def draw(key: Array) -> Scene:
        return draw_scene(key, 1, room, slots=1, own_class_share=own_class_share, config=world.scene)[0]

    return jax.vmap(draw)(jax.random.split(key, count))


def _turned(library: Library, half_turn: Int[np.ndarray, " K"]) -> Library:
    """The same turned by pi about the table's centre."""
    turn = jnp.array([-1.0, -1.0, 1.0, 1.0]), jnp.array([0.0, 0.0, 0.0, jnp.pi])
    return Library(
        grasps=library.grasps * turn[0] + turn[1],
        position=-library.position,
        radius=library.radius,
        pick_time=library.pick_time[:, half_turn],
        access=library.access[:, half_turn],
        starts=library.starts * jnp.array([-1.0, -1.0, 1.0]) + jnp.array([0.0, 0.0, jnp.pi]),
        first_drive=library.first_drive[:, half_turn],
    )


def half_turn_of(poses: Float[np.ndarray, "K 3"]) -> Int[np.ndarray, " K"]:
    """Which stop each one becomes when it is turned by pi about W's origin.

    Raises:
        ValueError: a stop becomes none of them.
    """
    place = np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    gap = np.max(np.abs(place[:, None] + place[None]), axis=-1)
    if np.any(np.min(gap, axis=1) > 1e-4):
        lost = poses[np.argmax(np.min(gap, axis=1))]
        raise ValueError(f"stops: {lost.tolist()} turned by pi is none of them; they must be symmetric about the table")
    return np.argmin(gap, axis=1)


@struct.dataclass
class Draw:
    """A problem as places in a library, padded to M objects; batches along leading axes."""

    objects: Int[Array, "*batch M"]  # -1: padding, or no room
    start: Int[Array, "*batch"]


def draw_problem(key: Array, library: Library, count: Int[Array, ""] | int, slots: int) -> Draw:
    """Random objects that don't overlap, and a random start.

    Args:
        key: consumed.
        library: of objects.
        count: of objects, 1 to `slots`.
        slots: M.
    """
    object_key, start_key = jax.random.split(key)
    size = len(library.radius)
    tried = jax.random.randint(object_key, (_TRIES_PER_OBJECT * slots,), 0, size)
    position, radius = library.position[tried], library.radius[tried]
    distance = jnp.linalg.norm(position[:, None] - position, axis=-1)
    overlaps = distance < radius[:, None] + radius

    def place(placed: Array, index: Array) -> tuple[Array, None]:
        fits = ~jnp.any(overlaps[index] & placed) & (jnp.sum(placed) < count)
        return placed.at[index].set(fits), None

    placed, _ = jax.lax.scan(place, jnp.zeros(len(tried), bool), jnp.arange(len(tried)))
    (where,) = jnp.nonzero(placed, size=slots, fill_value=0)
    objects = jnp.where(jnp.arange(slots) < jnp.sum(placed), tried[where], -1)
    return Draw(objects, jax.random.randint(start_key, (), 0, size))


def turned_draw(draw: Draw, library: Library) -> Draw:
    """The same problem turned by pi: the second half of a library is the first half turned."""
    size = len(library.radius)

    def turn(index: Array) -> Array:
        return (index + size // 2) % size

    return Draw(jnp.where(draw.objects < 0, -1, turn(draw.objects)), turn(draw.start))


def problem_of(prepared: PreparedWorld, library: Library, draw: Draw) -> StopScene:
    """The problem of one draw, or of a batch, on the library's stops."""
    index = jnp.maximum(draw.objects, 0)
    first_drive, pick_time = library.first_drive[draw.start], jnp.swapaxes(library.pick_time[index], -1, -2)
    return StopScene(
        problem=make_problem(prepared.poses, prepared.drive, pick_time, first_drive, draw.objects >= 0),
        access=jnp.swapaxes(library.access[index], -1, -2),
        robot_start=library.starts[draw.start],
        grasps=library.grasps[index],
    )
