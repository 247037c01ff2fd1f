"""Paired comparisons: the mean difference of two plans' costs over the same scenes, and how sure it is."""

from typing import Any

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
RESAMPLES = 10_000


def paired_difference(ours: np.ndarray, theirs: np.ndarray, *, seed: int) -> dict[str, Any]:
    """Mean of ours - theirs with 95 % intervals by Student's t and, as a check, by the bootstrap (percentiles).

    Args:
        ours: one figure per scene.
        theirs: of the same scenes, in the same order.
        seed: of the bootstrap.

    Returns:
        `mean`, `sd`, `scenes`, `mean_of_theirs`, and intervals `t` and `bootstrap`, which are None below two scenes.
    """
    difference = np.asarray(ours, float) - np.asarray(theirs, float)
    count = len(difference)
    if count < 2:
        mean = float(difference[0]) if count else None
        reference = float(theirs[0]) if count else None
        return {"mean": mean, "sd": None, "scenes": count, "mean_of_theirs": reference, "t": None, "bootstrap": None}
    return {
        "mean": float(difference.mean()),
        "sd": float(difference.std(ddof=1)),
        "scenes": count,
        "mean_of_theirs": float(np.mean(theirs)),
        "t": t_interval(difference),
        "bootstrap": bootstrap_interval(difference, seed=seed),
    }


def t_interval(difference: np.ndarray) -> list[float]:
    """Ends of Student's interval of the mean: mean ± t sd / sqrt(n)."""
    count = len(difference)
    half = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1) * difference.std(ddof=1) / np.sqrt(count)
    return [float(difference.mean() - half), float(difference.mean() + half)]


def bootstrap_interval(difference: np.ndarray, *, seed: int) -> list[float]:
    """Percentiles of the means of resamples with replacement."""
    settings = {"confidence_level": CONFIDENCE, "n_resamples": RESAMPLES, "method": "percentile", "rng": seed}
    interval = stats.bootstrap((difference,), np.mean, **settings).confidence_interval
    return [float(interval.low), float(interval.high)]
