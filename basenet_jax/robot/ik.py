"""Inverse kinematics by damped least squares, for any serial arm, in batches."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax import rounds
from basenet_jax.robot.kinematics import (
    Frame,
    Vector,
    add,
    chain,
    components,
    cross,
    dot,
    jacobian_rows,
    scale,
    subtract,
)
from basenet_jax.robot.model import Robot
from basenet_jax.trigonometry import atan2

# W_N = 1/2 |e|^2 + damping in Sugihara's robust Levenberg-Marquardt (IEEE T-RO 27(5), 2011): far from the target
# the steps stay short, near it the method becomes Gauss-Newton's.
DAMPING = 1e-6
MAX_STEP = 0.5
# Poses solved at a time: their Jacobians stay in a CPU core's cache (65,536 at once take five times as long).
CHUNK = 8192


class IKSolution(NamedTuple):
    """Result of `solve_ik`."""

    joints: Float[Array, "*batch dof"]  # rad, inside the limits
    position_error: Float[Array, "*batch"]  # m
    orientation_error: Float[Array, "*batch"]  # rad
    converged: Bool[Array, "*batch"]  # both errors within their tolerances


def solve_ik(
    robot: Robot,
    position: Float[Array, "*batch 3"],
    rotation: Float[Array, "*batch 3 3"],
    seed: Float[Array, "*batch dof"],
    *,
    iterations: int = 30,
    position_tolerance: float = 1e-3,
    orientation_tolerance: float = 0.5 * jnp.pi / 180.0,
) -> IKSolution:
    """Joints that bring the tool frame to a pose, by damped least squares from a seed.

    Args:
        robot: the robot.
        position: of the tool frame in the arm's base frame (m).
        rotation: likewise, as a matrix.
        seed: where to start (rad).
        iterations: their fixed number, the same for the whole batch.
        position_tolerance: largest error of a converged solution (m).
        orientation_tolerance: likewise (rad).

    Returns:
        The last iterate, its errors, and whether they are within the tolerances.
    """
    batch = jnp.broadcast_shapes(position.shape[:-1], rotation.shape[:-2], seed.shape[:-1])
    problem = (position, rotation, seed)
    shapes = ((3,), (3, 3), (robot.dof,))
    flat = [jnp.broadcast_to(x, batch + own).reshape(-1, *own) for x, own in zip(problem, shapes, strict=True)]

    def solve(part: list[Array]) -> IKSolution:
        position, rotation, seed = part
        return _solve_chunk(robot, position, rotation, seed, iterations, position_tolerance, orientation_tolerance)

    solution = rounds.in_chunks(solve, flat, CHUNK)
    return jax.tree.map(lambda x: x.reshape(batch + x.shape[1:]), solution)


def _solve_chunk(
    robot: Robot,
    position: Float[Array, "batch 3"],
    rotation: Float[Array, "batch 3 3"],
    seed: Float[Array, "batch dof"],
    iterations: int,
    position_tolerance: float,
    orientation_tolerance: float,
) -> IKSolution:
    columns = (tuple(rotation[..., row, column] for row in range(3)) for column in range(3))
    target = Frame(*columns, origin=components(position))
    joints = damped_least_squares(robot, target, seed.T, iterations)
    position_error, orientation_error = residual(robot, target, joints)
    converged = (position_error <= position_tolerance) & (orientation_error <= orientation_tolerance)
    return IKSolution(joints.T, position_error, orientation_error, converged)


def damped_least_squares(
    robot: Robot,
    target: Frame,
    joints: Float[Array, "dof *batch"],
    iterations: int,
    *,
    damping: float = DAMPING,
    max_step: float = MAX_STEP,
) -> Float[Array, "dof *batch"]:
    """A fixed number of steps `q <- clip(q + J^T (J J^T + W I)^-1 e)`, joints in the leading axis.

    A step is scaled down so that no joint moves more than `max_step` (rad or m), then clipped to the limits.
    """
    per_joint = (-1, *(1,) * (joints.ndim - 1))
    lower, upper = (jnp.reshape(limit, per_joint) for limit in (robot.joint_lower, robot.joint_upper))

    def step(_: int, joints: Array) -> Array:
        arm = chain(robot, joints)
        error = _pose_error(target, arm.tool)
        rows = jacobian_rows(robot, arm)
        weight = 0.5 * (dot(error[:3], error[:3]) + dot(error[3:], error[3:])) + damping
        multipliers = _solve_spd(gram(rows, weight), error)
        change = sum((row * y for row, y in zip(rows, multipliers, strict=True)), jnp.zeros(()))
        shrink = max_step / jnp.maximum(jnp.max(jnp.abs(change), axis=0), max_step)
        return jnp.clip(joints + shrink * change, lower, upper)

    return jax.lax.fori_loop(0, iterations, step, joints)


def residual(robot: Robot, target: Frame, joints: Float[Array, "dof *batch"]) -> tuple[Array, Array]:
    """Position (m) and orientation (rad) error of the tool frame at these joints."""
    error = _pose_error(target, chain(robot, joints).tool)
    return jnp.sqrt(dot(error[:3], error[:3])), jnp.sqrt(dot(error[3:], error[3:]))


def _pose_error(target: Frame, tool: Frame) -> tuple[Array, ...]:
    """Position error (m) and rotation vector (rad) from the tool frame to the target, in the arm's base frame."""
    linear = subtract(target.origin, tool.origin)
    twice_sine = add(add(cross(tool.x, target.x), cross(tool.y, target.y)), cross(tool.z, target.z))
    cosine = 0.5 * (dot(tool.x, target.x) + dot(tool.y, target.y) + dot(tool.z, target.z) - 1.0)
    sine = 0.5 * jnp.sqrt(dot(twice_sine, twice_sine))
    # angle / sine tends to 1 at 0; the float32 cosine knows nothing below 1e-3 rad, and atan2 uses the sine there.
    factor = jnp.where(sine > 1e-6, atan2(sine, cosine) / jnp.where(sine > 1e-6, sine, 1.0), 1.0)
    return (*linear, *_halve(scale(factor, twice_sine)))


def _halve(vector: Vector) -> Vector:
    return (0.5 * vector[0], 0.5 * vector[1], 0.5 * vector[2])


def gram(rows: tuple[Array, ...], weight: Array) -> list[list[Array]]:
    """The lower triangle of J J^T + weight I, from the rows of J."""
    products = [[jnp.sum(rows[i] * rows[j], axis=0) for j in range(i + 1)] for i in range(len(rows))]
    for i, row in enumerate(products):
        row[i] = row[i] + weight
    return products


def _solve_spd(lower: list[list[Array]], right: tuple[Array, ...]) -> list[Array]:
    """Solves A y = b for a symmetric positive definite A by an unrolled L D L^T factorisation without square roots."""
    size = len(right)
    inverse_d: list[Array] = []
    factor: list[list[Array]] = []
    for i in range(size):
        scaled: list[Array] = []  # L_ij D_j
        for j in range(i):
            scaled.append(lower[i][j] - sum((scaled[k] * factor[j][k] for k in range(j)), 0.0))
        factor.append([scaled[j] * inverse_d[j] for j in range(i)])
        pivot = lower[i][i] - sum((scaled[k] * factor[i][k] for k in range(i)), 0.0)
        inverse_d.append(1.0 / pivot)
    y: list[Array] = []
    for i in range(size):
        y.append(right[i] - sum((factor[i][k] * y[k] for k in range(i)), 0.0))
    y = [value * inverse for value, inverse in zip(y, inverse_d, strict=True)]
    for i in reversed(range(size)):
        y[i] = y[i] - sum((factor[k][i] * y[k] for k in range(i + 1, size)), 0.0)
    return y
