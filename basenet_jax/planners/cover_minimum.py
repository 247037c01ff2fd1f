"""Fewest sets that cover all objects: the minimum set cover, solved exactly."""

import numpy as np
from jaxtyping import Bool, Int
from scipy.optimize import Bounds, LinearConstraint, milp


def minimum_cover(serves: Bool[np.ndarray, "K M"]) -> Int[np.ndarray, " K"]:
    """Chooses fewest coverage sets so that every object that some pose serves is in one of them.

    Only maximal sets are chosen from: where a cover has a set that is contained in another one, the other one can
    take its place.

    Args:
        serves: whether the object can be picked from the pose; M is at most 64.

    Returns:
        For each pose the number, from 0 on, of the chosen set that is exactly the pose's, or -1.
    """
    keys, set_of_pose = np.unique(_as_bits(serves), return_inverse=True)
    maximal = maximal_sets(keys)
    members = (keys[maximal, None] >> np.arange(serves.shape[1], dtype=np.uint64)) & np.uint64(1)
    chosen = maximal[_solve(members.astype(bool))]
    number = np.full(len(keys), -1, np.int32)
    number[chosen] = np.arange(len(chosen))
    return number[set_of_pose]


def maximal_sets(keys: np.ndarray) -> np.ndarray:
    """Indices of the distinct sets, each the bits of an integer, that are neither empty nor contained in another."""
    kept = np.zeros(0, np.int64)
    for index in np.argsort(-np.bitwise_count(keys).astype(int), kind="stable"):  # a set comes after its supersets
        key = keys[index]
        if key and not np.any((keys[kept] & key) == key):
            kept = np.append(kept, index)
    return np.sort(kept)


def _as_bits(serves: Bool[np.ndarray, "K M"]) -> np.ndarray:
    """Each row as one unsigned integer."""
    bits = np.uint64(1) << np.arange(serves.shape[1], dtype=np.uint64)
    return serves.astype(np.uint64) @ bits


def _solve(members: Bool[np.ndarray, "D M"]) -> Int[np.ndarray, " S"]:
    """Indices of fewest rows that together have every column that any row has.

    The integer programme `min sum x, A x >= 1, x in {0, 1}` by HiGHS's branch and bound, to optimality.

    Raises:
        RuntimeError: HiGHS doesn't prove an optimum.
    """
    wanted = members.any(axis=0)
    if not wanted.any():
        return np.zeros(0, np.int64)
    cover = LinearConstraint(members.T[wanted].astype(float), lb=1.0)
    count = len(members)
    result = milp(np.ones(count), constraints=cover, bounds=Bounds(0, 1), integrality=np.ones(count))
    if result.status != 0:
        raise RuntimeError(f"minimum cover of {wanted.sum()} objects by {count} sets: {result.message}")
    return np.flatnonzero(result.x > 0.5)
