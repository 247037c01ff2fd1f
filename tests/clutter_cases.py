"""Random problems in which objects are in each other's way, and what any order can have of them, by brute force."""

import itertools
from typing import Any

import numpy as np

from basenet_jax.task.clutter import Clutter, as_bits


def random_clutter(seed, stops, objects, ways=2, served=0.6):
    """Ways with up to two blockers each, other objects than the one that is picked."""
    rng = np.random.default_rng(seed)
    time = rng.uniform(8, 14, (stops, objects, ways)).astype(np.float32)
    time[rng.random(time.shape) > served] = np.inf
    blockers = np.zeros((*time.shape, objects), bool)
    for index in np.ndindex(time.shape):
        others = [item for item in range(objects) if item != index[1]]
        blockers[(*index, rng.permutation(others)[: rng.integers(0, 3)])] = True
    return time, blockers


def as_clutter(time, blockers):
    arrays: tuple[Any, ...] = (time, as_bits(blockers, np))
    return Clutter(*arrays)


def time_of(time, blockers, stop, item, gone):
    """Of the fastest open way, by sets."""
    open_ways = [
        t for t, b in zip(time[stop, item], blockers[stop, item], strict=True) if set(np.flatnonzero(b)) <= gone
    ]
    return min(open_ways, default=np.inf)


def most_of_any_order(time, blockers, reachable):
    """The largest set of objects that some order of picks can have: all orders are tried."""
    stops, objects = time.shape[:2]
    best: set[int] = set()
    for order in itertools.permutations(range(objects)):
        gone: set[int] = set()
        for item in order:
            if any(np.isfinite(time_of(time, blockers, s, item, gone)) for s in range(stops) if reachable[s]):
                gone.add(item)
        best = max(best, gone, key=len)
    return best
