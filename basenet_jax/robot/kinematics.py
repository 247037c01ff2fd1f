"""Forward kinematics and geometric Jacobian of a serial arm.

Everything here is *struct of arrays*: a vector is a tuple of three arrays, a rotation the tuple of its three columns,
and every array has the batch's shape. A whole batch then runs through each multiplication as one vector instruction,
which is 5 to 20 times faster on CPUs than batches of 3x3 matrices, and no slower on GPUs.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from basenet_jax.robot.model import Robot
from basenet_jax.trigonometry import sin_cos

Vector = tuple[Array, ...]  # x, y, z


class Frame(NamedTuple):
    """A rigid transform: `x`, `y`, `z` are the columns of its rotation, `origin` its translation (m)."""

    x: Vector
    y: Vector
    z: Vector
    origin: Vector


def forward_kinematics(
    robot: Robot, joints: Float[Array, "*batch dof"]
) -> tuple[Float[Array, "*batch 3"], Float[Array, "*batch 3 3"]]:
    """Position (m) and rotation matrix of the tool frame in the arm's base frame.

    The product of the fixed transforms between joint frames and the joints' motions (Lynch and Park,
    *Modern Robotics*, chapter 4, written by bodies instead of screws).

    Args:
        robot: the robot.
        joints: joint positions (rad, or m for a sliding joint).
    """
    tool = tool_frame(robot, link_frames(robot, components(joints)))
    columns = jnp.stack([jnp.stack(column, axis=-1) for column in tool[:3]], axis=-1)
    return jnp.stack(tool.origin, axis=-1), columns


def geometric_jacobian(robot: Robot, joints: Float[Array, "*batch dof"]) -> Float[Array, "*batch 6 dof"]:
    """Velocity (m/s, rows 0 to 2) and angular velocity (rad/s, rows 3 to 5) of the tool frame per joint speed,
    both in the arm's base frame."""
    frames = link_frames(robot, components(joints))
    columns = jacobian_columns(robot, frames, tool_frame(robot, frames).origin)
    return jnp.stack([jnp.stack([*linear, *angular], axis=-1) for linear, angular in columns], axis=-1)


def link_frames(robot: Robot, joints: tuple[Array, ...], root: Frame | None = None) -> list[Frame]:
    """The arm's base frame and the frames that move with each joint (their z is the joint's axis).

    They are given in the frame in which `root` gives the arm's base; by default in the arm's base frame itself.
    """
    frames = [root or _identity()]
    for index, joint in enumerate(joints):
        fixed = attach(frames[-1], robot.joint_rotation[index], robot.joint_position[index])
        if robot.prismatic[index]:
            frames.append(fixed._replace(origin=add(fixed.origin, scale(joint, fixed.z))))
        else:
            frames.append(turn(fixed, joint))
    return frames


def mount_frame(robot: Robot) -> Frame:
    """The arm's base frame in the mobile base's frame."""
    return attach(_identity(), robot.mount_rotation, robot.mount_position)


def tool_frame(robot: Robot, frames: list[Frame]) -> Frame:
    """The tool frame, given the arm's link frames."""
    return attach(frames[-1], robot.tool_rotation, robot.tool_position)


def jacobian_columns(robot: Robot, frames: list[Frame], point: Vector) -> list[tuple[Vector, Vector]]:
    """Per joint, the velocity of a point of the last link and the last link's angular velocity, per joint speed."""
    columns = []
    for index, frame in enumerate(frames[1:]):
        if robot.prismatic[index]:
            zero = jnp.zeros_like(frame.z[0])
            columns.append((frame.z, (zero, zero, zero)))
        else:
            columns.append((cross(frame.z, subtract(point, frame.origin)), frame.z))
    return columns


def _identity() -> Frame:
    zero, one = jnp.zeros(()), jnp.ones(())
    return Frame((one, zero, zero), (zero, one, zero), (zero, zero, one), (zero, zero, zero))


def attach(parent: Frame, rotation: Float[Array, "3 3"], position: Float[Array, "3"]) -> Frame:
    """The frame with this rotation and position in its parent."""
    x, y, z = (rotate(parent, (rotation[0, k], rotation[1, k], rotation[2, k])) for k in range(3))
    return Frame(x, y, z, transform(parent, (position[0], position[1], position[2])))


def turn(frame: Frame, angle: Array) -> Frame:
    """The frame turned about its own z axis by an angle (rad)."""
    sine, cosine = sin_cos(angle)
    x = add(scale(cosine, frame.x), scale(sine, frame.y))
    return frame._replace(x=x, y=subtract(scale(cosine, frame.y), scale(sine, frame.x)))


def transform(frame: Frame, point: Vector) -> Vector:
    """A point given in a frame, in the frame's parent."""
    return add(frame.origin, rotate(frame, point))


def rotate(frame: Frame, vector: Vector) -> Vector:
    """A direction given in a frame, in the frame's parent."""
    return add(add(scale(vector[0], frame.x), scale(vector[1], frame.y)), scale(vector[2], frame.z))


def components(array: Float[Array, "*batch n"]) -> tuple[Array, ...]:
    """The last axis as one array each: the struct-of-arrays form that the kernels compute in."""
    return tuple(array[..., index] for index in range(array.shape[-1]))


def add(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(factor: Array, a: Vector) -> Vector:
    """factor · a."""
    return (factor * a[0], factor * a[1], factor * a[2])


def dot(a: Vector, b: Vector) -> Array:
    """The scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
