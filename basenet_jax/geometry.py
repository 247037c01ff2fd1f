"""Poses in the plane and the rectangles of base and table.

A pose of SE(2) is an array whose last axis is `(x, y, heading)` in metres and radians.
"""

import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.trigonometry import sin_cos, wrap_angle


def compose(first: Float[Array, "*batch 3"], second: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """The pose `second`, given in the frame of `first`, in the frame that `first` is given in: T_W_a · T_a_b."""
    sine, cosine = sin_cos(first[..., 2])
    x, y = second[..., 0], second[..., 1]
    return jnp.stack(
        [
            first[..., 0] + cosine * x - sine * y,
            first[..., 1] + sine * x + cosine * y,
            wrap_angle(first[..., 2] + second[..., 2]),
        ],
        axis=-1,
    )


def relative(frame: Float[Array, "*batch 3"], pose: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """The pose as seen from `frame`, both given in one frame: T_a_b = T_W_a^-1 · T_W_b, the inverse of `compose`."""
    sine, cosine = sin_cos(frame[..., 2])
    x, y = pose[..., 0] - frame[..., 0], pose[..., 1] - frame[..., 1]
    return jnp.stack(
        [cosine * x + sine * y, cosine * y - sine * x, wrap_angle(pose[..., 2] - frame[..., 2])],
        axis=-1,
    )


def rectangles_overlap(
    pose: Float[Array, "*batch 3"],
    half_size: Float[Array, "*batch 2"],
    other_half_size: Float[Array, "*batch 2"],
    touching: float,
) -> Bool[Array, "*batch"]:
    """Whether a rectangle at a pose overlaps another one, aligned with the axes about the origin.

    Args:
        pose: of the first rectangle's centre, in the frame of the second.
        half_size: half the first rectangle's sides along its x and y (m).
        other_half_size: half the second rectangle's sides (m).
        touching: a clearance up to this (m) counts as overlap.
    """
    return rectangle_gap(pose, half_size, other_half_size) <= touching


def rectangle_gap(
    pose: Float[Array, "*batch 3"], half_size: Float[Array, "*batch 2"], other_half_size: Float[Array, "*batch 2"]
) -> Float[Array, "*batch"]:
    """By how much (m) some direction separates two rectangles; negative: they overlap by so much in every direction.

    By the separating-axis theorem: disjoint exactly if one of the four edge normals separates them. Between two corners
    the distance is greater than this.

    Args:
        pose: as for `rectangles_overlap`.
        half_size: likewise.
        other_half_size: likewise.
    """
    sine, cosine = sin_cos(pose[..., 2])
    x, y = pose[..., 0], pose[..., 1]
    length, width = half_size[..., 0], half_size[..., 1]
    other_length, other_width = other_half_size[..., 0], other_half_size[..., 1]
    sine_size, cosine_size = jnp.abs(sine), jnp.abs(cosine)
    gaps = (
        jnp.abs(x) - other_length - length * cosine_size - width * sine_size,
        jnp.abs(y) - other_width - length * sine_size - width * cosine_size,
        jnp.abs(cosine * x + sine * y) - length - other_length * cosine_size - other_width * sine_size,
        jnp.abs(cosine * y - sine * x) - width - other_length * sine_size - other_width * cosine_size,
    )
    return jnp.maximum(jnp.maximum(gaps[0], gaps[1]), jnp.maximum(gaps[2], gaps[3]))
