"""Every planner on the same scenes: `python -m basenet_jax.evaluate`, its summary kept without the single scenes.

Beside each planner stand paired differences to `greedy-stops`, the rule without learning, scene by scene. With
`--evaluations` it keeps the summaries of evaluations that were made before instead of making one.
"""

import dataclasses
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from basenet_jax import evaluate
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse
from benchmarks.paired import paired_difference

NAME = "planners"
RULE = "greedy-stops"


@dataclass(frozen=True)
class PlannersOptions(Options):
    """Options, and what is compared on how many scenes."""

    name: str = NAME
    """Of the result's file."""
    objects: tuple[int, ...] = (5, 10)
    """Numbers of objects in a scene."""
    scenes: int = 1_000
    """Scenes for each number of objects."""
    planners: tuple[str, ...] = ("all",)
    """Names of planners, or all."""
    evaluations: tuple[Path, ...] = ()
    """Folders that `python -m basenet_jax.evaluate --out` wrote."""
    repeats: int = 3
    """Warm calls per scene and planner; P is their median."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Runs the benchmark; returns what it writes."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(PlannersOptions, NAME, __doc__, arguments)
    if options.quick:
        options = dataclasses.replace(
            options, objects=(QUICK_OBJECTS,), scenes=2, planners=("pbg", "greedy-stops", "basenet-paper")
        )
    report = Report(options.name, options, arguments, script=NAME)
    if options.evaluations:
        return _finish(report, [_read(folder) for folder in options.evaluations])
    with tempfile.TemporaryDirectory() as folder:
        given = ["--out", folder, "--scenes", str(options.scenes), "--seed", str(options.seed)]
        given += ["--repeats", str(options.repeats), "--objects", *map(str, options.objects)]
        if code := evaluate.main([*given, "--planners", *options.planners]):
            raise SystemExit(code)
        return _finish(report, [_read(Path(folder))])


def _read(folder: Path) -> dict[str, Any]:
    try:
        return json.loads((folder / "results.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SystemExit(f"{NAME}: {folder}: found no results of an evaluation ({error})") from error


def _finish(report: Report, evaluations: list[dict[str, Any]]) -> dict[str, Any]:
    results = [result for evaluation in evaluations for result in _results(evaluation["results"])]
    about = [{name: value for name, value in each.items() if name != "results"} for each in evaluations]
    return report.finish(results, table=_table(results), evaluations=about)


def _results(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Summaries, and paired differences of N + G to the rule's over the scenes where both grasp every object."""
    results = []
    for row in rows:
        results.append({"what": row["planner"]} | (row["summary"] or {"refused": row["refused"]}))
        rule = next((each for each in rows if (each["planner"], each["objects"]) == (RULE, row["objects"])), None)
        if rule is None or rule is row or None in (row["scenes"], rule["scenes"]):
            continue
        pairs = [pair for pair in zip(row["scenes"], rule["scenes"], strict=True) if _complete(pair, row["objects"])]
        costs = np.array([[scene["execution_s"] for scene in pair] for pair in pairs]).reshape(-1, 2)
        results[-1][f"execution_s_less_{RULE}"] = paired_difference(costs[:, 0], costs[:, 1], seed=0)
    return results


def _complete(scenes: tuple[dict[str, Any], ...], objects: int) -> bool:
    return all(scene["grasped"] == objects for scene in scenes)


def _table(results: list[dict[str, Any]]) -> Table:
    table = Table(title="Planners")
    for column in (
        "planner",
        "objects",
        "scenes",
        "grasped %",
        "P median (ms)",
        "most",
        "N (s)",
        "G (s)",
        "N + G to DP's",
        "95 %",
    ):
        table.add_column(column, justify="left" if column == "planner" else "right")
    for row in results:
        if "figures" not in row:
            continue
        figures, ratio = row["figures"], row.get("ratio_to_dp") or {}
        times = (f"{figures[name]['mean']:.1f}" for name in ("navigation_s", "grasping_s"))
        relative = (
            (f"{ratio['ratio']:.3f}", "{:.3f} to {:.3f}".format(*ratio["ci95"])) if ratio.get("ci95") else ("", "")
        )
        planning = (f"{1e3 * row[name]:.1f}" for name in ("planning_median_s", "planning_max_s"))
        shares = (f"{100 * figures['grasped']['mean']:.1f}", *planning)
        table.add_row(row["what"], str(row["objects"]), str(row["scenes"]), *shares, *times, *relative)
    return table


if __name__ == "__main__":
    main()
