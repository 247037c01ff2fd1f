"""Optimality gaps: by how much each planner's plans take longer than the best known ones, scene by scene.

The best known plans are `benchmarks/best_known`'s. A gap is below the true one by as much as the best known plan is
from the optimum; a planner that beats a best known plan has a negative gap there, and the results say how often.
"""

import sys
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from rich.table import Table

from basenet_jax.evaluation.scene_sets import random_set
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import make_planner
from benchmarks.best_known import SCENE_SEED, judged, read
from benchmarks.harness import Options, Report, parse
from benchmarks.paired import bootstrap_interval, t_interval

NAME = "gaps"


@dataclass(frozen=True)
class GapOptions(Options):
    """Options, and which planners; timing repeats don't matter here."""

    objects: tuple[int, ...] = (5, 10)
    """Numbers of objects in a scene."""
    planners: tuple[str, ...] = (
        *("pbg-gc", "mbp-gc", "dp", "greedy-stops", "basenet-paper", "basenet", "basenet-sample", "refined"),
    )
    """Names of planners."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(GapOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    planners = ("basenet", "refined") if options.quick else options.planners
    setup, results = PlannerSetup(), []
    for objects in options.objects[:1] if options.quick else options.objects:
        known = read(objects)[: 2 if options.quick else None]
        if not known:
            raise SystemExit(f"gaps: no plans of {objects} objects are known yet; run python -m benchmarks.best_known")
        scenes = random_set(objects, 1 + max(each.scene for each in known), seed=SCENE_SEED)
        for name in planners:
            planner, gaps = make_planner(name, setup), []
            for each in known:
                scene = scenes.scene(each.scene)
                plan = judged(each.scene, name, scene, planner(scene, jax.random.key(options.seed)))
                gaps.append(plan.execution_s / each.execution_s - 1 if plan else np.nan)
            results.append({"what": name, "objects": objects} | _summary(np.array(gaps), options.seed))
    return report.finish(results, table=_table(results))


def _summary(gaps: np.ndarray, seed: int) -> dict[str, Any]:
    """Over the scenes where every object is grasped."""
    complete = gaps[np.isfinite(gaps)]
    interval = {"t": None, "bootstrap": None}
    if len(complete) > 1:
        interval = {"t": t_interval(complete), "bootstrap": bootstrap_interval(complete, seed=seed)}
    return {
        "scenes": len(gaps),
        "compared": len(complete),
        "gap": float(complete.mean()) if len(complete) else None,
        "median": float(np.median(complete)) if len(complete) else None,
        "most": float(complete.max()) if len(complete) else None,
        "better_than_known": int(np.sum(complete < -1e-4)),
    } | interval


def _table(results: list[dict[str, Any]]) -> Table:
    table = Table(title="Gaps to the best known plans, %")
    for column in ("planner", "objects", "mean", "95 %", "median", "most", "scenes compared", "better"):
        table.add_column(column, justify="left" if column == "planner" else "right")
    for row in results:
        figures = ("" if row[name] is None else f"{100 * row[name]:.2f}" for name in ("gap", "median", "most"))
        mean, median, most = figures
        interval = "" if row["t"] is None else "{:.2f} to {:.2f}".format(*(100 * end for end in row["t"]))
        counts = (f"{row['compared']} of {row['scenes']}", str(row["better_than_known"]))
        table.add_row(row["what"], str(row["objects"]), mean, interval, median, most, *counts)
    return table


if __name__ == "__main__":
    main()
