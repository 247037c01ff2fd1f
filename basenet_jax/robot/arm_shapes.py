"""An arm's capsules at given joints, in NumPy and float64, and which of them can touch one another at all."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from basenet_jax.robot.model import Robot

_STATES = 128  # in which capsules that always touch are found
_TURN = np.pi  # rad; farther than half a turn either way a joint does nothing new


class ArmShapes(NamedTuple):
    """The capsules (m of them) at S joint states, in the base's frame (m)."""

    start: Float[np.ndarray, "S m 3"]
    end: Float[np.ndarray, "S m 3"]
    radius: Float[np.ndarray, " m"]


def arm_shapes(robot: Robot, states: Float[np.ndarray, "S dof"]) -> ArmShapes:
    """The arm's capsules.

    Args:
        robot: concrete.
        states: joints (rad, or m).
    """
    robot = jax.tree.map(lambda x: np.asarray(x, float), robot)  # sums in single precision would be off by 1e-7
    rotation = np.broadcast_to(robot.mount_rotation, (len(states), 3, 3))
    position = np.broadcast_to(robot.mount_position, (len(states), 3))
    start, end = np.empty((2, len(states), len(robot.capsule_link), 3))
    for joint in range(robot.dof):
        position = position + rotation @ robot.joint_position[joint]
        rotation = rotation @ robot.joint_rotation[joint]
        if robot.prismatic[joint]:
            position = position + states[:, joint, None] * rotation[..., 2]
        else:
            cosine, sine = np.cos(states[:, joint, None]), np.sin(states[:, joint, None])
            x, y, z = np.moveaxis(rotation, -1, 0)
            rotation = np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=-1)
        for capsule in (index for index, link in enumerate(robot.capsule_link) if link == joint + 1):
            start[:, capsule] = rotation @ robot.capsule_start[capsule] + position
            end[:, capsule] = rotation @ robot.capsule_end[capsule] + position
    return ArmShapes(start, end, np.asarray(robot.capsule_radius))


def self_pairs(robot: Robot) -> tuple[tuple[int, int], ...]:
    """The pairs of capsules that an arm can hit itself with: neither neighbours in the chain nor always touching.

    Capsules of one link never move against each other, those of neighbouring links meet at their joint, and some others
    touch whatever the joints are, as the first and last segment of a short wrist do. MoveIt's setup assistant leaves
    out the same pairs, and like it this one finds the last kind by trying random states, always the same ones.

    Args:
        robot: concrete.
    """
    links = np.array(robot.capsule_link)
    pairs = np.argwhere(links[None] - links[:, None] >= 2)
    if not len(pairs):
        return ()
    lower, upper = (np.asarray(x, float) for x in (robot.joint_lower, robot.joint_upper))
    turning = ~np.array(robot.prismatic)
    lower, upper = (
        np.where(turning, np.maximum(lower, -_TURN), lower),
        np.where(turning, np.minimum(upper, _TURN), upper),
    )
    shapes = arm_shapes(robot, np.random.default_rng(0).uniform(lower, upper, (_STATES, robot.dof)))
    first, second = pairs.T
    distance = segment_distance(
        shapes.start[:, first], shapes.end[:, first], shapes.start[:, second], shapes.end[:, second]
    )
    parts = np.any(distance > shapes.radius[first] + shapes.radius[second], axis=0)
    return tuple((int(a), int(b)) for a, b in pairs[parts])


def segment_distance(
    start: Float[np.ndarray, "*batch 3"],
    end: Float[np.ndarray, "*batch 3"],
    other_start: Float[np.ndarray, "*batch 3"],
    other_end: Float[np.ndarray, "*batch 3"],
) -> Float[np.ndarray, "*batch"]:
    """Distance (m) between two segments: the least of a segment's ends from the other, or between their lines."""

    def from_point(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        along = b - a
        square = np.maximum(np.sum(along * along, axis=-1), 1e-30)
        t = np.clip(np.sum((point - a) * along, axis=-1) / square, 0.0, 1.0)
        return np.linalg.norm(a + t[..., None] * along - point, axis=-1)

    ends = [from_point(start, other_start, other_end), from_point(end, other_start, other_end)]
    ends += [from_point(other_start, start, end), from_point(other_end, start, end)]
    u, v, w = end - start, other_end - other_start, start - other_start
    uu, uv, vv = (np.sum(a * b, axis=-1) for a, b in ((u, u), (u, v), (v, v)))
    uw, vw = np.sum(u * w, axis=-1), np.sum(v * w, axis=-1)
    determinant = uu * vv - uv * uv
    skew = determinant > 1e-12 * uu * vv
    divisor = np.where(skew, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / divisor, (uu * vw - uv * uw) / divisor
    inside = skew & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    lines = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    return np.minimum(np.minimum.reduce(ends), np.where(inside, lines, np.inf))
