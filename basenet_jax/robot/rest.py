"""Home, stow and the move between them: checked once for a robot, since they are the same in every pick.

A pick's own check covers what depends on the pick. Against the robot's body the rest is the same wherever the base
stands. Against tables it can be said for all places together: the base may stand as near as its clearance, turned in
any way, so the arm touches a large table from some allowed place if, and only if, a part of it below the table's top
reaches farther beyond the footprint than the clearance. (A small table may be safe where a large one isn't; both are
refused.)
"""

from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Float

from basenet_jax.config import PickConfig
from basenet_jax.documents.fields import DocumentError, field_error
from basenet_jax.robot.arm_shapes import ArmShapes, arm_shapes
from basenet_jax.robot.model import Robot

_DIRECTIONS = 32  # in which the arm may reach out; between two of them it reaches half a millimetre farther at most
_ROUNDS = 40  # of a ternary search: (2/3)^40 of a link is less than rounding


def check_body(robot: Robot, config: PickConfig = PickConfig()) -> None:
    """That the arm touches the robot's body neither at home nor at stow nor in between.

    Args:
        robot: concrete.
        config: at how many points a move is checked.

    Raises:
        DocumentError: it does; the message names the joints, the link and what is allowed.
    """
    robot, states = jax.device_get(robot), _states(robot, config)
    shapes = arm_shapes(robot, states)
    center, half = np.asarray(robot.body_center), np.asarray(robot.body_half_size)

    def distance(point: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.maximum(np.abs(point - center) - half, 0.0), axis=-1)

    along = np.zeros(shapes.start.shape[:2])
    nearest = _least(lambda t: distance(_at(shapes, t)), along, along + 1.0)
    touches = (nearest <= shapes.radius) & np.array(robot.capsule_meets_body)
    for state, capsule in np.argwhere(touches)[:1].tolist():
        allowed = "are joints at which only the first link does: see mount, base.body and the shapes"
        raise _fault(robot, states, state, capsule, "touches the robot's body", allowed)


def check_tables(robot: Robot, height: float, config: PickConfig = PickConfig()) -> None:
    """That the arm, at home, at stow and in between, touches no table wherever the base may stand.

    Args:
        robot: concrete.
        height: of the highest table's top (m).
        config: how near the base may come, and at how many points a move is checked.

    Raises:
        DocumentError: it may; the message names the joints, the link and what is allowed.
    """
    robot, states = jax.device_get(robot), _states(robot, config)
    reach = _reach(robot, arm_shapes(robot, states), height)
    for state, capsule in np.argwhere(reach > config.base_clearance_m)[:1].tolist():
        does = f"reaches {reach[state, capsule]:.3f} m beyond the footprint below a table's top at {height:.3g} m"
        allowed = f"is {config.base_clearance_m:g} m (base_clearance_m), since the base may stand as near to the table"
        raise _fault(robot, states, state, capsule, does, allowed)


def _states(robot: Robot, config: PickConfig) -> Float[np.ndarray, "S dof"]:
    """Home, stow, and the points between them."""
    ways = np.linspace(np.asarray(robot.home, float), np.asarray(robot.stow, float), config.swept_points + 2)
    return np.concatenate([ways[[0, -1]], ways[1:-1]])


def _fault(
    robot: Robot, states: Float[np.ndarray, "S dof"], state: int, capsule: int, does: str, allowed: str
) -> DocumentError:
    where = ("at home", "at stow", "between stow and home")[min(state, 2)]
    field = "home_degrees" if state == 0 else "stow_degrees"
    factor = np.where(robot.prismatic, 1.0, 180.0 / np.pi)
    joints = ", ".join(f"{name} {x:.4g}" for name, x in zip(robot.joint_names, factor * states[state], strict=True))
    link = robot.capsule_link[capsule]
    return field_error(field, f"{where} ({joints}) the link behind {robot.joint_names[link - 1]} {does}", allowed)


def _reach(robot: Robot, shapes: ArmShapes, height: float) -> Float[np.ndarray, "S m"]:
    """How far (m) the part of each capsule below a height lies beyond the footprint; minus infinity: no part does."""
    angle = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    direction = np.stack([np.cos(angle), np.sin(angle)])
    support = np.abs(direction.T) @ np.asarray(robot.footprint_half_size)
    # Of the sphere at t along a capsule, the part below the height is widest at the height or at its own centre's.
    z, rise = shapes.start[..., 2], shapes.end[..., 2] - shapes.start[..., 2]
    level = np.where(rise == 0.0, 1.0, rise)
    crossing = np.clip((height + shapes.radius - z) / level, 0.0, 1.0)
    first, last = np.where(rise < 0.0, crossing, 0.0), np.where(rise > 0.0, crossing, 1.0)
    below = np.minimum(z, z + rise) - shapes.radius <= height

    def beyond(t: np.ndarray) -> np.ndarray:
        point = _at(shapes, t)
        over = np.clip(point[..., 2] - height, 0.0, shapes.radius[:, None])
        width = np.sqrt(shapes.radius[:, None] ** 2 - over**2)
        return np.sum(point[..., :2] * direction.T, axis=-1) - support + width

    low, high = (np.repeat(t[..., None], _DIRECTIONS, axis=-1) for t in (first, last))
    farthest = -_least(lambda t: -beyond(t), low, high)
    return np.where(below, farthest.max(axis=-1), -np.inf)


def _at(shapes: ArmShapes, t: np.ndarray) -> np.ndarray:
    """The points at these shares of the way from the capsules' starts to their ends; `t` may have a further axis."""
    start, end = shapes.start, shapes.end
    if t.ndim == 3:
        start, end = start[:, :, None], end[:, :, None]
    return start + t[..., None] * (end - start)


def _least(function: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The least values of convex functions of one number each."""
    for _ in range(_ROUNDS):
        third = (high - low) / 3.0
        left = function(low + third) <= function(high - third)
        low, high = np.where(left, low, low + third), np.where(left, high - third, high)
    return function((low + high) / 2.0)
