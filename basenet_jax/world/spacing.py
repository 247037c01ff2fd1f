"""How far apart objects stand on the table."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from basenet_jax.config import SceneConfig
from basenet_jax.geometry import rectangle_gap, relative
from basenet_jax.world.generate import footprint_radius

_radius, _rectangle_gap = jax.jit(footprint_radius), jax.jit(lambda a, b, *half: rectangle_gap(relative(b, a), *half))


class Footprints(NamedTuple):
    """What N objects cover of the table; on the host."""

    pose: Float[np.ndarray, "N 3"]  # (x, y, yaw) in W
    size: Float[np.ndarray, "N 3"]  # m
    own_size: Bool[np.ndarray, " N"]  # of no packaged class
    crowded: bool = False  # in a room: only rectangles count, or for the packaged classes what random scenes keep


def needed_distance(first: Footprints, second: Footprints) -> Float[np.ndarray, "N K"]:
    """How far apart (m) centres are at least: what random scenes keep, less what rounding of files may take."""
    radius = (np.asarray(_radius(each.size.astype(np.float32)), float) for each in (first, second))
    return np.add.outer(*radius) - SceneConfig().overlap_tolerance_m


def gaps(first: Footprints, second: Footprints) -> Float[np.ndarray, "N K"]:
    """How much farther apart (m) objects stand than they have to; negative: they overlap.

    Centres keep their distance. That is bounded, for the packaged classes' sake; so an object of its own size, which
    may be larger, also keeps its rectangle clear of the other's. In rooms objects stand as close as their rectangles
    let them, and round ones of the packaged classes as close as they are drawn.
    """
    gap = np.linalg.norm(first.pose[:, None, :2] - second.pose[:, :2], axis=-1) - needed_distance(first, second)
    own = first.own_size[:, None] | second.own_size
    if not np.any(own) and not second.crowded:
        return gap
    halves = first.size[:, None, :2] / 2, second.size[:, :2] / 2
    rectangles = np.asarray(_rectangle_gap(first.pose[:, None], second.pose, *halves), float)
    rectangles += SceneConfig().overlap_tolerance_m
    if second.crowded:
        return np.where(own, rectangles, np.maximum(gap, rectangles))
    return np.where(own, np.minimum(gap, rectangles), gap)
