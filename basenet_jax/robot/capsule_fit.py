"""Capsules about shapes: what collision geometry becomes, whatever it was."""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

# Of the search for the smallest circle: from the middle of the points' extent, which is never far off, in small steps.
_MOST_POINTS = 4096  # of a mesh, more are thinned out
_FIRST_STEP, _ROUNDS = 8, 64


class Fit(NamedTuple):
    """A capsule; a sphere where start and end are one."""

    start: Float[np.ndarray, "3"]
    end: Float[np.ndarray, "3"]
    radius: float

    @property
    def volume(self) -> float:
        """In m^3."""
        return float(np.pi * self.radius**2 * (np.linalg.norm(self.end - self.start) + 4.0 / 3.0 * self.radius))


def fit_capsule(points: Float[np.ndarray, "N 3"]) -> Fit:
    """A small capsule that holds all points: the smallest among those along the axes and the principal axes.

    Across an axis the smallest circle about the points gives the radius; along it the ends are moved in as far as the
    caps still hold every point.
    """
    principal = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2]
    return min((_along(points, axis) for axis in (*np.eye(3), *principal)), key=lambda fit: fit.volume)


def box_points(half_size: Float[np.ndarray, "3"]) -> Float[np.ndarray, "8 3"]:
    """The corners of a box about the origin."""
    return np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half_size


def extreme_points(points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "M 3"]:
    """The points that stand out in some direction: all that a capsule about them depends on, to about a per mille."""
    if len(points) <= _MOST_POINTS:
        return points
    index = np.arange(_MOST_POINTS) + 0.5
    z, turn = 1.0 - 2.0 * index / _MOST_POINTS, index * np.pi * (3.0 - np.sqrt(5.0))
    ring = np.sqrt(1.0 - z * z)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1).astype(np.float32)
    across = np.unique(points.astype(np.float32), axis=0).T
    parts = np.array_split(directions, 64)  # of a few MB each
    return across.T[np.unique(np.concatenate([np.argmax(part @ across, axis=1) for part in parts]))].astype(float)


def _along(points: Float[np.ndarray, "N 3"], axis: Float[np.ndarray, "3"]) -> Fit:
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    side = np.cross(axis, helper) / np.linalg.norm(np.cross(axis, helper))
    across = points @ np.stack([side, np.cross(axis, side)], axis=1)
    center = _circle_center(across)
    distance = np.linalg.norm(across - center, axis=1)
    radius = float(distance.max())
    height, cap = points @ axis, np.sqrt(np.maximum(radius**2 - distance**2, 0.0))
    low, high = float(np.min(height + cap)), float(np.max(height - cap))
    if low > high:  # the points fit into a sphere
        low = high = 0.5 * (low + high)
    origin = center[0] * side + center[1] * np.cross(axis, side)
    fit = Fit(origin + low * axis, origin + high * axis, radius)
    nearest = origin + np.clip(height, low, high)[:, None] * axis
    return fit._replace(radius=float(np.linalg.norm(points - nearest, axis=1).max()))


def _circle_center(points: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "2"]:
    """About the centre of the smallest circle: ever smaller steps to the farthest point (Badoiu and Clarkson, 2003)."""
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    best, least = center, np.inf
    for step in range(_FIRST_STEP, _FIRST_STEP + _ROUNDS):
        square = np.sum((points - center) ** 2, axis=1)
        farthest = int(np.argmax(square))
        if square[farthest] < least:
            best, least = center, square[farthest]
        center = center + (points[farthest] - center) / step
    return best
