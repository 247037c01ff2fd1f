"""How near an arm is to poses in which it can't move its tool in every direction: rule 7 of rooms."""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.robot.ik import gram
from basenet_jax.robot.kinematics import chain, jacobian_rows
from basenet_jax.robot.model import Robot


def near_singular(robot: Robot, joints: Float[Array, "dof *batch"], least: float) -> Bool[Array, "*batch"]:
    """Whether the least singular value of the tool's geometric Jacobian J (m and rad) is below a bound.

    It is, exactly if J J^T - least^2 I isn't positive definite, that is if a pivot of its L D L^T factorisation isn't
    positive (Sylvester's law of inertia): far cheaper than the singular values.

    Args:
        robot: the robot.
        joints: in the leading axis (rad, or m).
        least: the bound.
    """
    lower = gram(jacobian_rows(robot, chain(robot, joints)), jnp.asarray(-(least**2)))
    singular = jnp.zeros(joints.shape[1:], bool)
    factor: list[list[Array]] = []
    pivots: list[Array] = []
    for i, row in enumerate(lower):
        scaled: list[Array] = []  # L_ij D_j
        for j in range(i):
            scaled.append(row[j] - sum((scaled[k] * factor[j][k] for k in range(j)), jnp.zeros(())))
        own = [value / pivot for value, pivot in zip(scaled, pivots, strict=True)]
        pivot = row[i] - sum((a * b for a, b in zip(scaled, own, strict=True)), jnp.zeros(()))
        singular |= ~(pivot > 0)
        factor.append(own)
        pivots.append(jnp.where(pivot > 0, pivot, 1.0))  # what comes after a failure doesn't matter
    return singular
