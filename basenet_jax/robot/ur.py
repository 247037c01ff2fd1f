"""Closed-form inverse kinematics of Universal Robots' arms: up to eight branches per tool pose.

Joints 2, 3 and 4 turn about parallel axes m, so that three two-way choices leave a planar two-link arm: shoulder
left or right of the target, wrist 2 up or down, elbow up or down. Everything up to the joint angles themselves is
algebra; the angles cost one arctangent each.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from basenet_jax.robot.closed_form import ClosedForm
from basenet_jax.robot.kinematics import Frame, Vector, attach, dot, scale, subtract
from basenet_jax.robot.model import Robot, UrFrames
from basenet_jax.trigonometry import atan2, wrap_angle

NAME = "ur"
BRANCHES = 8
_ALIGNED = 1e-6  # of sin q5, below which joints 4 and 6 turn about one line


class Branch(NamedTuple):
    """Which of the eight solutions, as signs (+1 or -1) that broadcast against the targets."""

    shoulder: Array
    wrist: Array
    elbow: Array


def branch_signs(index: Array) -> Branch:
    """The signs of branch number 0 to 7."""
    sign = [1.0 - 2.0 * ((index >> bit) & 1) for bit in (2, 1, 0)]
    return Branch(*sign)


def all_branches(batch_dimensions: int) -> Branch:
    """The signs of all branches as three leading axes of length 2, before a batch of so many dimensions."""
    sign = jnp.array([1.0, -1.0])
    trailing = (1,) * batch_dimensions
    return Branch(sign.reshape(2, 1, 1, *trailing), sign.reshape(2, 1, *trailing), sign.reshape(2, *trailing))


def turns_tool(robot: Robot) -> bool:
    """Whether the last joint turns the tool about its own z, so that turning the gripper changes that joint alone."""
    return robot.closed_form == NAME and robot.ur_frames is None


def closed_form(robot: Robot, target: Frame, branch: Branch) -> ClosedForm:
    """Joint angles that bring the tool frame to a target, on the given branches.

    Derived from the DH frames of Universal Robots' arms (K. Hawkins, *Analytic inverse kinematics for the Universal
    Robots UR-5/UR-10 arms*, 2013, gives the same eight solutions). Where the target is out of reach, the joints of
    the nearest stretched or folded arm with the target's orientation are returned, and the shortfall is positive.
    Where joints 4 and 6 align (sin q5 = 0) the choice between them is free; the two wrist branches then are those with
    joint 5's axis in line with the arm, so that the elbow has least and most to reach.

    Args:
        robot: one with `closed_form == "ur"`; its lengths are read from its joint frames, or from its `ur_frames`; a
            calibrated arm's solutions are approximate.
        target: of the tool frame in the arm's base frame.
        branch: which solutions; signs broadcast against the target.
    """
    if robot.ur_frames is not None:
        return _in_frames(robot, robot.ur_frames, target, branch)
    d1, a2, a3 = robot.joint_position[1, 2], robot.joint_position[2, 0], robot.joint_position[3, 0]
    d4, d5, d6 = robot.joint_position[4, 2], robot.joint_position[5, 2], robot.tool_position[2]
    return _in_dh_frames((d1, a2, a3, d4, d5, d6), target, branch)


def _in_frames(robot: Robot, frames: UrFrames, target: Frame, branch: Branch) -> ClosedForm:
    """The target for the tool as one for DH frame 6 in DH frame 0, and the angles as the model's joints."""
    tool = robot.tool_rotation.T @ frames.flange_rotation  # of DH frame 6 in the tool's
    origin = robot.tool_rotation.T @ (frames.flange_position - robot.tool_position)
    flange = attach(target, tool, origin)

    def turned(vector: Vector) -> Vector:
        rows = frames.base_rotation
        return tuple(vector[0] * rows[0, k] + vector[1] * rows[1, k] + vector[2] * rows[2, k] for k in range(3))

    position = turned(tuple(x - frames.base_position[axis] for axis, x in enumerate(flange.origin)))
    own = Frame(turned(flange.x), turned(flange.y), turned(flange.z), position)
    found = _in_dh_frames(tuple(frames.lengths), own, branch)
    joints = (frames.sense[i] * wrap_angle(q - frames.offset[i]) for i, q in enumerate(found.joints))
    return found._replace(joints=tuple(joints))


def _in_dh_frames(lengths: tuple[Array, ...], target: Frame, branch: Branch) -> ClosedForm:
    """The closed form of DH frame 6's pose in DH frame 0, by d1, a2, a3, d4, d5 and d6."""
    d1, a2, a3, d4, d5, d6 = lengths
    wrist_centre = subtract(target.origin, scale(d6, target.z))
    m, cylinder_shortfall = _parallel_axis(wrist_centre, d4, branch.shoulder)
    (m_x, m_y, _), (z_x, z_y, z_z) = m, target.z
    z_m = m_x * z_x + m_y * z_y  # cos5
    # m x z, of length sin5, and computed from the tool's z alone: so all but joint 6 is the same, and computed once,
    # for targets that differ in a turn of the tool about its z.
    across = (m_y * z_z, -m_x * z_z, m_x * z_y - m_y * z_x)
    sin_5 = jnp.sqrt(dot(across, across))
    out, up = wrist_centre[1] * m_x - wrist_centre[0] * m_y, wrist_centre[2] - d1  # from the shoulder, across m
    aligned = sin_5 < _ALIGNED
    axis = tuple(jnp.where(aligned, *each) for each in zip((-m_y * out, m_x * out, up), across, strict=True))
    length = jnp.where(aligned, jnp.sqrt(out * out + up * up), sin_5)
    wrist_axis = scale(branch.wrist / jnp.where(length > 0, length, 1.0), axis)  # joint 5's
    elbow_end = subtract(subtract(wrist_centre, scale(d5, wrist_axis)), scale(d4, m))
    radial = elbow_end[1] * m[0] - elbow_end[0] * m[1]  # m = (sin1, -cos1, 0)
    q2, q3, elbow_shortfall = _planar_two_link(radial, elbow_end[2] - d1, a2, a3, branch.elbow)
    q234 = atan2(wrist_axis[1] * m[0] - wrist_axis[0] * m[1], -wrist_axis[2])
    joints = (
        atan2(m[0], -m[1]),
        q2,
        q3,
        q234 - q2 - q3,
        atan2(branch.wrist * sin_5, z_m),
        atan2(-dot(wrist_axis, target.x), -dot(wrist_axis, target.y)),
    )
    return ClosedForm(joints, cylinder_shortfall + elbow_shortfall)


def _parallel_axis(wrist_centre: Vector, d4: Array, shoulder: Array) -> tuple[Vector, Array]:
    """The unit axis m of joints 2 to 4, (sin q1, -cos q1, 0): the wrist's centre lies d4 along it."""
    x, y, _ = wrist_centre
    square = x * x + y * y
    aside = shoulder * jnp.sqrt(jnp.maximum(square - d4 * d4, 0.0))
    m_x, m_y = d4 * x - aside * y, d4 * y + aside * x
    length = jnp.sqrt(m_x * m_x + m_y * m_y)
    inverse = 1.0 / jnp.where(length > 0, length, 1.0)
    m_x = jnp.where(length > 0, m_x * inverse, 1.0)
    m_y = m_y * inverse
    return (m_x, m_y, jnp.zeros_like(m_x)), jnp.maximum(jnp.abs(d4) - jnp.sqrt(square), 0.0)


def _planar_two_link(radial: Array, height: Array, a2: Array, a3: Array, elbow: Array) -> tuple[Array, Array, Array]:
    """Angles q2 and q3 with a2 (cos2, sin2) + a3 (cos23, sin23) = (radial, height), and the shortfall (m)."""
    square = radial * radial + height * height
    cos_3 = (square - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
    reach, distance = jnp.abs(a2) + jnp.abs(a3), jnp.sqrt(square)
    shortfall = jnp.maximum(jnp.maximum(distance - reach, jnp.abs(jnp.abs(a2) - jnp.abs(a3)) - distance), 0.0)
    cos_3 = jnp.clip(cos_3, -1.0, 1.0)
    sin_3 = elbow * jnp.sqrt(1.0 - cos_3 * cos_3)
    along, across = a2 + a3 * cos_3, a3 * sin_3
    q2 = atan2(height * along - radial * across, radial * along + height * across)
    return q2, atan2(sin_3, cos_3), shortfall
