"""Every planner on the same scenes: `python -m basenet_jax.evaluate`, its summary kept without the single scenes.

With `--evaluations` it keeps the summaries of evaluations that were made before instead of making one.
"""

import dataclasses
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.table import Table

from basenet_jax import evaluate
from benchmarks.harness import Options, Report, parse

NAME = "planners"


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
        options = dataclasses.replace(options, objects=(2,), scenes=2, planners=("pbg", "basenet"))
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
    rows = [row for evaluation in evaluations for row in evaluation["results"]]
    results = [{"what": row["planner"]} | (row["summary"] or {"refused": row["refused"]}) for row in rows]
    about = [{name: value for name, value in each.items() if name != "results"} for each in evaluations]
    return report.finish(results, table=_table(results), evaluations=about)


def _table(results: list[dict[str, Any]]) -> Table:
    table = Table(title="Planners")
    for column in ("planner", "objects", "scenes", "grasped %", "P (ms)", "N (s)", "G (s)", "N + G to DP's", "95 %"):
        table.add_column(column, justify="left" if column == "planner" else "right")
    for row in results:
        if "figures" not in row:
            continue
        figures, ratio = row["figures"], row.get("ratio_to_dp") or {}
        times = (f"{figures[name]['mean']:.1f}" for name in ("navigation_s", "grasping_s"))
        relative = (
            (f"{ratio['ratio']:.3f}", "{:.3f} to {:.3f}".format(*ratio["ci95"])) if ratio.get("ci95") else ("", "")
        )
        shares = (f"{100 * figures['grasped']['mean']:.1f}", f"{1e3 * figures['planning_s']['mean']:.1f}")
        table.add_row(row["what"], str(row["objects"]), str(row["scenes"]), *shares, *times, *relative)
    return table


if __name__ == "__main__":
    main()
