"""Closed-form durations of trapezoidal velocity profiles."""

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from basenet_jax.robot.model import Robot
from basenet_jax.trigonometry import wrap_angle


def trapezoid_duration(distance: Array, speed: ArrayLike, acceleration: ArrayLike) -> Array:
    """Duration (s) of a move from rest to rest: accelerate, cruise, decelerate (a triangle when too short to cruise).

    `|d|/v + v/a` where `|d| >= v^2/a`, else `2 sqrt(|d|/a)`; both give `2 v/a` at the switch. Its slope at 0 is
    infinite; the gradient given here at exactly 0 is 0.

    Args:
        distance: signed distance (m or rad), any shape.
        speed: the largest speed v, positive.
        acceleration: of both ramps, positive.
    """
    distance = jnp.abs(distance)
    ramps = jnp.asarray(speed * speed / acceleration)  # the distance that both ramps take up
    moving = distance > 0
    ramping = jnp.where(moving, jnp.minimum(distance, ramps) / acceleration, 1.0)
    return jnp.where(moving, 2.0 * jnp.sqrt(ramping) + jnp.maximum(distance - ramps, 0.0) / speed, 0.0)


def straight_duration(robot: Robot, distance: Array) -> Float[Array, "*batch"]:
    """Duration (s) of the base's drive over a signed distance (m), from rest to rest."""
    return trapezoid_duration(distance, robot.base_speed[0], robot.base_acceleration[0])


def turn_duration(robot: Robot, angle: Array) -> Float[Array, "*batch"]:
    """Duration (s) of the base's turn on the spot by an angle (rad), the shorter way round."""
    return trapezoid_duration(wrap_angle(angle), robot.base_speed[1], robot.base_acceleration[1])


def joint_move_duration(
    robot: Robot, start: Float[Array, "*batch dof"], goal: Float[Array, "*batch dof"]
) -> Float[Array, "*batch"]:
    """Duration (s) of a synchronised joint move: that of the slowest joint, on actual differences (no wrapping)."""
    per_joint = trapezoid_duration(goal - start, robot.joint_speed, robot.joint_acceleration)
    return jnp.max(per_joint, axis=-1)


def synchronised_duration(robot: Robot, start: tuple, goal: tuple) -> Array:
    """`joint_move_duration` on struct-of-arrays joints (a tuple of one array per joint)."""
    duration = jnp.zeros(())
    for index, (before, after) in enumerate(zip(start, goal, strict=True)):
        speed, acceleration = robot.joint_speed[index], robot.joint_acceleration[index]
        duration = jnp.maximum(duration, trapezoid_duration(after - before, speed, acceleration))
    return duration
