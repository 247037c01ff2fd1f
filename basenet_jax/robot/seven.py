"""Closed-form inverse kinematics of arms of seven joints with a spherical shoulder, for a given angle of joint 7.

The axes of joints 1 to 3 meet in one point S, joints 5 and 6 in one point W, neighbouring axes from joint 2 on are at
right angles, and S, joint 5's axis and W keep to planes across joint 4's axis. Franka's arms and KUKA's iiwa are such,
whatever their offsets at elbow and flange. With joint 7 given, W and joint 6's axis are known, and what is left is a
triangle S, elbow, W: two ways to bend it, two to lay it (joint 5's axis must be at right angles to joint 6's), two for
the shoulder. (Y. He and S. Liu, *Analytical inverse kinematics for Franka Emika Panda*, ICCMA 2021, do it for one arm.)

Nothing is read off a table of dimensions: axes and points come from the joint frames with all joints at zero, and a
joint is the angle between where an axis is carried without it and where it must be.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from basenet_jax.robot.closed_form import ClosedForm
from basenet_jax.robot.kinematics import Frame, Vector, add, chain, cross, dot, scale, subtract
from basenet_jax.robot.model import Robot
from basenet_jax.trigonometry import atan2, sin_cos

NAME = "spherical-shoulder"
BRANCHES = 8
_TINY = 1e-9
_MEETS_M, _ALIGNED = 2e-3, 2e-3  # by how much a recognised arm's axes may miss each other, and right angles' cosines


class Branch(NamedTuple):
    """Which of the eight solutions, as signs (+1 or -1) that broadcast against the targets."""

    elbow: Array
    side: Array
    shoulder: Array


def branch_signs(index: Array) -> Branch:
    """The signs of branch number 0 to 7."""
    return Branch(*(1.0 - 2.0 * ((index >> bit) & 1) for bit in (2, 1, 0)))


def closed_form(robot: Robot, target: Frame, joint_7: Array, branch: Branch) -> ClosedForm:
    """Joint angles that bring the tool frame to a target with joint 7 at an angle, on the given branches.

    Where the target is out of reach, the triangle is stretched or folded towards it, or laid as nearly as it can be,
    and the shortfall is positive.

    Args:
        robot: one with `closed_form == "spherical-shoulder"`; of one whose axes don't quite meet the solutions are
            approximate.
        target: of the tool frame in the arm's base frame.
        joint_7: rad; broadcasts against the target, like the signs.
        branch: which solutions.
    """
    arm = _at_zero(robot)
    a1, a2, a3, a4, a5, a6, a7 = arm.axes
    wrist, z6, z7 = _wrist(arm, target, joint_7)
    line = subtract(wrist, arm.shoulder)
    distance = jnp.sqrt(dot(line, line))
    along = scale(1.0 / jnp.maximum(distance, _TINY), line)
    # The triangle: from S to the elbow, on to W, bent by joint 4 until W is as far from S as it must be.
    upper, lower = subtract(arm.elbow, arm.shoulder), subtract(arm.wrist, arm.elbow)
    lengths = jnp.sqrt(dot(upper, upper) * dot(lower, lower))
    cosine = (distance * distance - dot(upper, upper) - dot(lower, lower)) / (2.0 * lengths)
    bend = _arccos(cosine)
    q4 = branch.elbow * bend - _angle(a4, upper, lower)
    across = add(upper, _turned(a4, lower, q4))  # from S to W, while joints 1 to 3 are at zero
    # Joint 5's axis is at a known angle to the line from S to W, and at right angles to joint 6's.
    sine_5, cosine_5 = sin_cos(_angle(a4, across, _turned(a4, a5, q4)))
    toward = dot(along, z6)
    rest = subtract(z6, scale(toward, along))
    height = jnp.sqrt(jnp.maximum(dot(rest, rest), _TINY))
    first = scale(1.0 / height, rest)
    share = -toward * cosine_5 / (height * jnp.where(jnp.abs(sine_5) > _TINY, sine_5, _TINY))
    other = branch.side * jnp.sqrt(jnp.maximum(1.0 - share * share, 0.0))
    beside = add(scale(jnp.clip(share, -1.0, 1.0), first), scale(other, cross(along, first)))
    z4 = cross(along, beside)

    def in_triangle(own: Vector) -> Vector:
        """Where a direction across joint 4's axis is, that upper arm or forearm has while joints 1 to 3 are at zero."""
        sine, cosine = sin_cos(_angle(a4, across, own))
        return add(scale(cosine, along), scale(sine, beside))

    z3, z5 = in_triangle(a3), in_triangle(_turned(a4, a5, q4))
    q2 = _angle(a2, a3, a1) + branch.shoulder * _arccos(dot(a1, z3))
    q1 = _angle(a1, _turned(a2, a3, q2), z3)
    q3 = _angle(z3, _turned(a1, _turned(a2, a4, q2), q1), z4)
    q5 = _angle(z5, _carried(a6, (a5, a4), (z5, z4)), z6)
    q6 = _angle(z6, _carried(a7, (a5, a6), (z5, z6)), z7)
    shortfall = jnp.maximum(jnp.abs(cosine) - 1.0, 0.0) * lengths / jnp.maximum(distance, _TINY)
    shortfall += jnp.maximum(jnp.abs(share) - 1.0, 0.0) * distance
    return ClosedForm(tuple(jnp.broadcast_arrays(q1, q2, q3, q4, q5, q6, joint_7)), shortfall)


def is_spherical_shouldered(robot: Robot) -> bool:
    """Whether the closed form is nearly right for an arm; concrete."""
    if robot.dof != 7 or any(robot.prismatic):
        return False
    rotation, position, axes, origins = np.eye(3), np.zeros(3), [], []
    for turn, step in zip(np.asarray(robot.joint_rotation), np.asarray(robot.joint_position), strict=True):
        position, rotation = position + rotation @ step, rotation @ turn
        axes.append(rotation[:, 2])
        origins.append(position)
    right = [abs(axes[i] @ axes[i + 1]) for i in range(6)] + [abs(axes[k] @ axes[3]) for k in (2, 4)]
    shoulder, wrist = _meeting(axes, origins, 0, 1), _meeting(axes, origins, 4, 5)
    misses = [np.linalg.norm(np.cross(shoulder - origins[2], axes[2]))]
    misses += [np.linalg.norm(np.cross(point - origins[k], axes[k])) for point, k in ((shoulder, 1), (wrist, 5))]
    misses.append(abs((wrist - shoulder) @ axes[3]))
    return bool(max(right) < _ALIGNED and max(misses) < _MEETS_M)


class _AtZero(NamedTuple):
    """The arm with all joints at zero, in its base frame."""

    axes: tuple[Vector, ...]  # of joints 1 to 7
    shoulder: Vector  # S
    elbow: Vector  # the point of joint 4's axis that is level with S
    wrist: Vector  # W
    flange: Vector  # a point of joint 7's axis
    tool: Frame


def _at_zero(robot: Robot) -> _AtZero:
    arm = chain(robot, jnp.zeros(robot.dof))
    axes = [tuple(x[k] for x in arm.axes) for k in range(7)]
    origins = [tuple(x[k] for x in arm.origins) for k in range(7)]
    shoulder = _nearest_on(axes[0], origins[0], axes[1], origins[1])
    wrist = _nearest_on(axes[4], origins[4], axes[5], origins[5])
    elbow = add(origins[3], scale(dot(subtract(shoulder, origins[3]), axes[3]), axes[3]))
    return _AtZero(tuple(axes), shoulder, elbow, wrist, origins[6], arm.tool)


def _wrist(arm: _AtZero, target: Frame, joint_7: Array) -> tuple[Vector, Vector, Vector]:
    """W and the axes of joints 6 and 7 that a target asks for, with joint 7 at an angle."""
    a6, a7 = arm.axes[5:]

    def as_tool(v: Vector) -> Vector:
        """A direction of the tool's link at zero as the target turns it."""
        own = (dot(v, axis) for axis in arm.tool[:3])
        x, y, z = (scale(c, axis) for c, axis in zip(own, target[:3], strict=True))
        return add(add(x, y), z)

    back = as_tool(_turned(a7, subtract(arm.flange, arm.wrist), -joint_7))
    to_tool = as_tool(subtract(arm.tool.origin, arm.flange))
    wrist = subtract(subtract(target.origin, to_tool), back)
    return wrist, as_tool(_turned(a7, a6, -joint_7)), as_tool(a7)


def _turned(axis: Vector, v: Vector, angle: Array) -> Vector:
    """A vector turned about a unit axis (Rodrigues)."""
    sine, cosine = sin_cos(angle)
    return add(add(scale(cosine, v), scale(sine, cross(axis, v))), scale((1.0 - cosine) * dot(axis, v), axis))


def _angle(axis: Vector, start: Vector, end: Vector) -> Array:
    """By how much (rad) one vector is turned about a unit axis to be in line with another, seen along the axis."""
    return atan2(dot(axis, cross(start, end)), dot(start, end) - dot(axis, start) * dot(axis, end))


def _carried(v: Vector, own: tuple[Vector, Vector], now: tuple[Vector, Vector]) -> Vector:
    """A vector of a link at zero, where two of the link's directions that are at right angles have gone."""
    third, there = cross(*own), cross(*now)
    return add(add(scale(dot(v, own[0]), now[0]), scale(dot(v, own[1]), now[1])), scale(dot(v, third), there))


def _arccos(cosine: Array) -> Array:
    cosine = jnp.clip(cosine, -1.0, 1.0)
    return atan2(jnp.sqrt(1.0 - cosine * cosine), cosine)


def _nearest_on(axis: Vector, point: Vector, other_axis: Vector, other_point: Vector) -> Vector:
    """The point of a line that is nearest to another line."""
    between, along = subtract(other_point, point), dot(axis, other_axis)
    reach = (dot(between, axis) - along * dot(between, other_axis)) / (1.0 - along * along)
    return add(point, scale(reach, axis))


def _meeting(axes: list, origins: list, first: int, second: int) -> Float[np.ndarray, "3"]:
    vectors = (tuple(x) for x in (axes[first], origins[first], axes[second], origins[second]))
    return np.array(_nearest_on(*vectors))
