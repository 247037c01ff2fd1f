"""Rectangles on the floor, on the host and in double precision: for what is checked or drawn once."""

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike


def in_frame(
    frame: Float[np.ndarray, "*batch 3"], point: Float[np.ndarray, "*batch 2"]
) -> Float[np.ndarray, "*batch 2"]:
    """Points of W (m) as seen from poses in W."""
    offset = point - frame[..., :2]
    cosine, sine = np.cos(frame[..., 2]), np.sin(frame[..., 2])
    x = cosine * offset[..., 0] + sine * offset[..., 1]
    return np.stack([x, cosine * offset[..., 1] - sine * offset[..., 0]], axis=-1)


def rectangle_gaps(
    pose: Float[ArrayLike, "N 3"],
    half_size: Float[ArrayLike, "#N 2"],
    other_pose: Float[ArrayLike, "K 3"],
    other_half_size: Float[ArrayLike, "K 2"],
) -> Float[np.ndarray, "N K"]:
    """By how much (m) one of the four edge normals separates rectangles; negative: they overlap, at least so deep.

    Args:
        pose: x, y (m) and yaw (rad) of the first ones' centres in W.
        half_size: half their sides (m).
        other_pose: likewise of the second ones.
        other_half_size: likewise.
    """
    first, half = (np.asarray(each, float)[:, None] for each in (pose, half_size))
    second, other_half = (np.asarray(each, float)[None] for each in (other_pose, other_half_size))
    turn = second[..., 2] - first[..., 2]
    cosine, sine = np.abs(np.cos(turn))[..., None], np.abs(np.sin(turn))[..., None]
    gap = np.maximum(
        np.abs(in_frame(first, second[..., :2])) - half - cosine * other_half - sine * other_half[..., ::-1],
        np.abs(in_frame(second, first[..., :2])) - other_half - cosine * half - sine * half[..., ::-1],
    )
    return np.max(gap, axis=-1)


def within(
    point: Float[ArrayLike, "N 2"], pose: Float[ArrayLike, "K 3"], half_size: Float[ArrayLike, "K 2"], margin: float
) -> Bool[np.ndarray, "N K"]:
    """Which points of W lie in which rectangles grown by a margin (m) per side, edges included."""
    seen = in_frame(np.asarray(pose, float)[None], np.asarray(point, float)[:, None])
    return np.all(np.abs(seen) <= np.asarray(half_size, float) + margin, axis=-1)


def extent(pose: Float[np.ndarray, "*batch 3"], half_size: Float[np.ndarray, "2"]) -> Float[np.ndarray, "*batch 4"]:
    """x_min, y_min, x_max, y_max (m) of rectangles in W."""
    cosine, sine = np.abs(np.cos(pose[..., 2:])), np.abs(np.sin(pose[..., 2:]))
    reach = cosine * half_size + sine * half_size[::-1]
    return np.concatenate([pose[..., :2] - reach, pose[..., :2] + reach], axis=-1)
