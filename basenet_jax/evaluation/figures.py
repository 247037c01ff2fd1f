"""Means, spreads and 95 % intervals over scenes, and ratios between planners."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from jaxtyping import Float

from basenet_jax.evaluation.table import REFERENCE, Row, Scores

CONFIDENCE = 0.95
RESAMPLES = 2_000
WITH_ERRORS = "noisy_"  # before figures of executions with errors of parking
SHARES = ("grasped", "reliability", f"{WITH_ERRORS}grasped", f"{WITH_ERRORS}at_first")


@dataclass(frozen=True)
class Figure:
    """A mean over scenes with Student's t interval; of one scene only the mean is known."""

    mean: float
    sd: float | None
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class Ratio:
    """A planner's N + G over another's, over the scenes where both grasp every object."""

    scenes: int  # number of such scenes
    share: float  # of all scenes
    ratio: float | None  # mean over them; None where there is no such scene
    ci95: tuple[float, float] | None  # by bootstrap over scenes


@dataclass(frozen=True)
class Summary:
    """What a planner comes to on one set of scenes."""

    planner: str
    objects: int
    scenes: int
    timed: int  # scenes that were planned with a stopwatch, which P and P + N + G are of
    figures: dict[
        str, Figure
    ]  # grasped (share), planning_s, navigation_s, grasping_s, execution_s, total_s, see `per_scene`
    planning_median_s: float  # of P over the scenes
    planning_max_s: float  # of the scene that took longest
    compile_s: float  # by how much first calls took longer, all scenes together
    disagreements: int
    ratio_to_dp: Ratio | None  # None where DP wasn't run or refused


def summarise(row: Row, rows: Sequence[Row]) -> Summary | None:
    """The summary of a row, None if refused; `rows` are searched for DP on the same scenes."""
    if row.scores is None:
        return None
    reference = next((each.scores for each in rows if (each.planner, each.objects) == (REFERENCE, row.objects)), None)
    return Summary(
        planner=row.planner,
        objects=row.objects,
        scenes=len(row.labels),
        timed=int(np.sum(~np.isnan(row.scores.planning_s))),
        figures={
            name: mean_figure(values, most=1.0 if name in SHARES else np.inf)
            for name, values in per_scene(row.scores, row.objects).items()
        },
        planning_median_s=float(np.nanmedian(row.scores.planning_s)),
        planning_max_s=float(np.nanmax(row.scores.planning_s)),
        compile_s=float(np.nansum(row.scores.compile_s)),
        disagreements=int(row.scores.disagreements.sum()),
        ratio_to_dp=None if reference is None else ratio(row.scores, reference, row.objects),
    )


def per_scene(scores: Scores, objects: int) -> dict[str, Float[np.ndarray, " B"]]:
    """The table's figures on every scene: the share of objects grasped, times in seconds, and those with errors."""
    figures = {
        "grasped": scores.grasped / objects,
        "planning_s": scores.planning_s,
        "navigation_s": scores.navigation_s,
        "grasping_s": scores.grasping_s,
        "execution_s": scores.execution_s,
        "total_s": scores.total_s,
    }
    if scores.noisy is not None:
        figures["reliability"] = scores.noisy.reliability
        figures |= {f"{WITH_ERRORS}{name}": values for name, values in scores.noisy.executed.items()}
    return figures


def mean_figure(values: Float[np.ndarray, " B"], *, most: float = np.inf) -> Figure:
    """Mean, standard deviation (of a sample) and Student's t interval of the mean, cut to 0 and `most`; without NaN."""
    values = values[~np.isnan(values)]
    mean, count = float(np.mean(values)), len(values)
    if count < 2:
        return Figure(mean, None, None)
    sd = float(np.std(values, ddof=1))
    half = float(scipy.stats.t.ppf(0.5 + CONFIDENCE / 2, count - 1)) * sd / count**0.5
    return Figure(mean, sd, (max(mean - half, 0.0), min(mean + half, most)))


def ratio(scores: Scores, reference: Scores, objects: int) -> Ratio:
    """The mean of paired ratios of N + G, planner over reference, over the scenes where both grasp every object.

    The interval is the percentile bootstrap's over scenes, drawn with a fixed seed.
    """
    both = (scores.grasped == objects) & (reference.grasped == objects)
    count, share = int(both.sum()), float(both.mean())
    if count == 0:
        return Ratio(0, share, None, None)
    ratios = scores.execution_s[both] / reference.execution_s[both]
    if count < 2:
        return Ratio(count, share, float(ratios.mean()), None)
    settings = {"confidence_level": CONFIDENCE, "n_resamples": RESAMPLES, "method": "percentile", "rng": 0}
    low, high = scipy.stats.bootstrap((ratios,), np.mean, **settings).confidence_interval
    return Ratio(count, share, float(ratios.mean()), (float(low), float(high)))
