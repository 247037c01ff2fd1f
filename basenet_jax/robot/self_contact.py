"""The arm against itself, and against the pedestal that it stands on: rule 6 of rooms."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.robot.distances import segment_box_distance, segment_distance_square
from basenet_jax.robot.kinematics import Vector, capsule_ends, subtract
from basenet_jax.robot.model import Robot

PEDESTAL_HALF_M = 0.10  # half its sides; it reaches from the body's top to where the arm is mounted


def hits_itself(robot: Robot, joints: Float[Array, "dof *batch"]) -> Bool[Array, "*batch"]:
    """Whether two capsules of the arm touch, of those that may (`Robot.self_pairs`), or one touches the pedestal.

    Args:
        robot: the robot.
        joints: in the leading axis (rad, or m).
    """
    start, end = capsule_ends(robot, joints)
    radius = jnp.asarray(robot.capsule_radius)
    touches = _touches_pedestal(robot, start, end)
    if not robot.self_pairs:
        return touches
    first, second = np.array(robot.self_pairs).T

    def meets(touches: Array, pair: tuple[Array, Array]) -> tuple[Array, None]:
        a, b = pair
        ends = (tuple(x[index] for x in side) for index in pair for side in (start, end))
        return touches | (segment_distance_square(*ends) <= (radius[a] + radius[b]) ** 2), None

    return jax.lax.scan(meets, touches, (first, second))[0]


def pedestal(robot: Robot) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Centre and half size (m) of the pedestal in the base's frame; without height where the arm is on the body."""
    top, mount = robot.body_center[2] + robot.body_half_size[2], robot.mount_position
    height = jnp.maximum(mount[2] - top, 0.0)
    center = jnp.stack([mount[0], mount[1], mount[2] - 0.5 * height])
    return center, jnp.stack([PEDESTAL_HALF_M + 0.0 * height, PEDESTAL_HALF_M + 0.0 * height, 0.5 * height])


def _touches_pedestal(robot: Robot, start: Vector, end: Vector) -> Bool[Array, "*batch"]:
    """The links that are tested against the body are tested against the pedestal too."""
    tested = np.flatnonzero(robot.capsule_meets_body)
    center, half = (tuple(x) for x in pedestal(robot))
    start, end = (subtract(tuple(x[tested] for x in side), center) for side in (start, end))
    radius = jnp.reshape(robot.capsule_radius[tested], (-1, *(1,) * (start[0].ndim - 1)))
    return (half[2] > 0) & jnp.any(segment_box_distance(start, end, half) <= radius, axis=0)
