"""What arms' closed forms give."""

from typing import NamedTuple

from jax import Array


class ClosedForm(NamedTuple):
    """Joints of a branch, whole turns aside, and by how many metres it misses the target (0: reached)."""

    joints: tuple[Array, ...]  # rad
    shortfall: Array
