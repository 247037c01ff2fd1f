"""Distances between the simple shapes that stand for links and boxes, in struct of arrays."""

import jax.numpy as jnp
from jax import Array

from basenet_jax.robot.kinematics import Vector, add, dot, scale, subtract


def segment_distance_square(start: Vector, end: Vector, other_start: Vector, other_end: Vector) -> Array:
    """Square of the distance between two segments (m^2).

    The point of one segment nearest to the other's line, clipped, then the other's nearest to it, clipped, then back
    once more (C. Ericson, *Real-Time Collision Detection*, 5.1.9).
    """
    u, v, w = subtract(end, start), subtract(other_end, other_start), subtract(start, other_start)
    uu, uv, vv, uw, vw = dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w)
    determinant = uu * vv - uv * uv
    s = jnp.clip((uv * vw - vv * uw) / jnp.where(determinant > 1e-9 * uu * vv, determinant, jnp.inf), 0.0, 1.0)
    t = jnp.clip((uv * s + vw) / jnp.where(vv > 0, vv, jnp.inf), 0.0, 1.0)
    s = jnp.clip((uv * t - uw) / jnp.where(uu > 0, uu, jnp.inf), 0.0, 1.0)
    gap = subtract(add(w, scale(s, u)), scale(t, v))
    return dot(gap, gap)


def segment_box_distance(start: Vector, end: Vector, half: Vector) -> Array:
    """Distance (m) from a segment to a solid box centred on the origin, 0 where they meet; exact.

    The squared distance of the point at parameter t is convex and piecewise quadratic, so half its derivative g(t)
    never falls and is linear between the parameters at which the segment crosses a face's plane. The last such
    parameter (or end) with g <= 0 and the first with g >= 0 enclose the minimum, and a straight line finds it.
    """
    along = subtract(end, start)
    inverse = tuple(jnp.where(d != 0, 1.0, 0.0) / jnp.where(d != 0, d, 1.0) for d in along)
    low, low_slope = jnp.zeros_like(start[0]), _half_slope(start, along, half, None)
    high, high_slope = jnp.ones_like(start[0]), _half_slope(start, along, half, 1.0)
    at_start, at_end = low_slope >= 0, high_slope <= 0
    for axis in range(3):
        for side in (-1.0, 1.0):
            t = jnp.clip((side * half[axis] - start[axis]) * inverse[axis], 0.0, 1.0)
            slope = _half_slope(start, along, half, t)
            better_low, better_high = (slope <= 0) & (t > low), (slope > 0) & (t < high)
            low, low_slope = jnp.where(better_low, t, low), jnp.where(better_low, slope, low_slope)
            high, high_slope = jnp.where(better_high, t, high), jnp.where(better_high, slope, high_slope)
    rise = high_slope - low_slope
    t = low - low_slope * (high - low) / jnp.where(rise > 0, rise, 1.0)
    t = jnp.where(at_start, 0.0, jnp.where(at_end, 1.0, t))
    outside = _outside(start, along, half, t)
    return jnp.sqrt(outside[0] * outside[0] + outside[1] * outside[1] + outside[2] * outside[2])


def _outside(start: Vector, along: Vector, half: Vector, t) -> Vector:
    """The vector from the box to the segment's point at parameter t (None: 0)."""
    point = start if t is None else add(start, scale(t, along))
    return tuple(p - jnp.clip(p, -h, h) for p, h in zip(point, half, strict=True))


def _half_slope(start: Vector, along: Vector, half: Vector, t) -> Array:
    """Half the derivative of the squared distance to the box, at parameter t (None: 0)."""
    outside = _outside(start, along, half, t)
    return along[0] * outside[0] + along[1] * outside[1] + along[2] * outside[2]
