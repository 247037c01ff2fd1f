"""Clearances of the base and the arm, by polygons and by one-dimensional search."""

import numpy as np

from tests.oracles import arm


def base_clearance(base_pose, table=(2.0, 0.8), margin=0.10):
    """Distance (m) between the base's rectangle and the table grown by the margin; 0 where they overlap."""
    base = _corners(arm.BODY[:2]) @ arm.rotation_z(base_pose[2])[:2, :2].T + np.asarray(base_pose[:2])
    grown = _corners((table[0] + 2 * margin, table[1] + 2 * margin))
    return polygon_distance(base, grown)


def polygon_distance(first, second):
    """Distance (m) of two convex polygons, corners counter-clockwise: the least from a corner of one to the other.

    They overlap if a corner of one lies in the other or if two edges cross.
    """
    overlap = any(_inside(p, second) for p in first) or any(_inside(p, first) for p in second)
    if overlap or any(_cross(*e, *f) for e in _edges(first) for f in _edges(second)):
        return 0.0
    pairs = [(p, edge) for p in first for edge in _edges(second)] + [
        (p, edge) for p in second for edge in _edges(first)
    ]
    return min(_point_segment(p, *edge) for p, edge in pairs)


def capsule_clearance(segments, base_pose, table, height, steps=16):
    """Distance (m) of each segment (..., 2, 3) to the table box or the body box, whichever is nearer.

    The distance to a convex box is convex along a segment: samples bracket the minimum, golden sections narrow it.
    """
    boxes = (
        (np.eye(4), np.array([table[0] / 2, table[1] / 2, height / 2])),
        (arm.pose(base_pose[0], base_pose[1], 0.0, base_pose[2]), np.array(arm.BODY) / 2),
    )
    distances = []
    for frame, half in boxes:
        ends = (segments - frame[:3, 3]) @ frame[:3, :3] - (0.0, 0.0, half[2])
        distances.append(_least_distance(ends[..., 0, :], ends[..., 1, :], half, steps))
    return np.minimum(*distances)


def _least_distance(start, end, half, steps):
    def distance(t):
        point = start + t[..., None] * (end - start)
        return np.linalg.norm(point - np.clip(point, -half, half), axis=-1)

    grid = np.linspace(0.0, 1.0, steps + 1)
    samples = np.stack([distance(np.full(start.shape[:-1], t)) for t in grid])
    best = grid[np.argmin(samples, axis=0)]
    low, high = np.maximum(best - 1 / steps, 0.0), np.minimum(best + 1 / steps, 1.0)
    golden = (np.sqrt(5.0) - 1) / 2
    for _ in range(30):
        left, right = high - golden * (high - low), low + golden * (high - low)
        nearer_left = distance(left) <= distance(right)
        low, high = np.where(nearer_left, low, left), np.where(nearer_left, right, high)
    return np.minimum(distance((low + high) / 2), samples.min(axis=0))


def _corners(size):
    return np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * np.asarray(size) / 2


def _edges(polygon):
    return list(zip(polygon, np.roll(polygon, -1, axis=0), strict=True))


def _turns_left(a, b, p):
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def _inside(point, polygon):
    return all(_turns_left(a, b, point) >= 0 for a, b in _edges(polygon))


def _cross(a, b, c, d):
    return _turns_left(a, b, c) * _turns_left(a, b, d) < 0 and _turns_left(c, d, a) * _turns_left(c, d, b) < 0


def _point_segment(point, a, b):
    t = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(point - a - t * (b - a)))
