"""Runs every benchmark at a tiny size, one after the other: `python -m benchmarks`.

One table at the end has what each came to. The sizes are chosen so that all of it takes minutes: figures are a first
impression, and a script by itself (`python -m benchmarks.picks`) gives the real ones. What isn't installed of the
extra `benchmarks` is left out, and said so. Compiled programs are kept between runs. Left out are `training_memory`,
which trains for minutes, `viewer_latency`, which needs a browser, and what needs or makes the best known plans.
"""

import importlib
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rich.table import Table

from basenet_jax.compilation import enable_cache
from benchmarks.harness import make_console, short
from benchmarks.peers import why_missing

SCRIPTS = (
    "inverse_kinematics",
    "navigation",
    "picks",
    "any_robot",
    "contacts",
    "cost_matrix",
    "sampling",
    "sequence_training",
    "sac",
    "orders",
    "planners",
    "paper_planner",
    "scaling",
    "many_scenes",
    "many_devices",
    "stop_sets",
    "replanning",
    "exported_moves",
    "cold_start",
    "routing",
    "docked_drives",
    "rooms",
    "grasps",
    "grasp_maps",
)

Cells = tuple[str, ...]


@dataclass(frozen=True)
class Arguments:
    """Runs every benchmark at a tiny size and sums up what each came to."""

    out: Path | None = None
    """Folder for the results, one file NAME.json each. Default: nothing is written."""


def main(arguments: list[str] | None = None) -> None:
    """Runs the scripts, one after the other."""
    options = tyro.cli(Arguments, args=arguments, prog="python -m benchmarks", description=__doc__)
    enable_cache()
    console, begin = make_console(), time.perf_counter()
    table = Table(title="All benchmarks at a tiny size")
    for column in ("benchmark", "took (s)", "ours", "per second", "beside", "per second", "ratio"):
        left = column in ("benchmark", "ours", "beside")
        table.add_column(column, justify="left" if left else "right")
    for number, name in enumerate(SCRIPTS, start=1):
        console.rule(f"{name} ({number} of {len(SCRIPTS)})")
        start = time.perf_counter()
        try:
            rows = summarise(_run(name, options.out))
        except ModuleNotFoundError as error:
            if not (missing := why_missing(error.name)):
                raise
            console.print(f"{name}: left out, not installed: {missing}", markup=False)
            rows = [("left out: needs " + missing.partition(":")[0], "", "", "", "")]
        took = f"{time.perf_counter() - start:.1f}"
        for index, row in enumerate(rows):
            table.add_row(*((name, took) if index == 0 else ("", "")), *row, end_section=index == len(rows) - 1)
    console.print(table)
    console.print(f"All of it took {time.perf_counter() - begin:.0f} s.")


def _run(name: str, folder: Path | None) -> dict[str, Any]:
    written = ["--out", str(folder / f"{name}.json")] if folder else []
    return importlib.import_module(f"benchmarks.{name}").main(["--quick", *written])


def summarise(report: dict[str, Any]) -> list[Cells]:
    """Cells (ours, its rate, beside, its rate, ratio) for a report: its comparisons, or else its best rates."""
    if comparisons := report.get("comparisons"):
        return [_compared(row) for row in comparisons]
    best: dict[tuple[str, str], float] = {}
    for row in report["results"]:
        if "rate" in row:
            what = f"{row['what']}, {row['part']}" if "part" in row else row["what"]
            best[what, row["unit"]] = max(best.get((what, row["unit"]), 0.0), row["rate"]["median"])
    rates = [(f"{what} ({unit})", short(rate), "", "", "") for (what, unit), rate in best.items()]
    return rates or [(f"ran, {len(report['results'])} rows", "", "", "", "")]


def _compared(row: dict[str, Any]) -> Cells:
    at = f", {row['at']}" if row.get("at") else ""
    ours, theirs = (f"{row[side]} ({unit})" for side, unit in zip(("ours", "theirs"), row["units"], strict=True))
    return (f"{ours}{at}", short(row["rates"][0]), theirs, short(row["rates"][1]), short(row["ratio"]))


if __name__ == "__main__":
    sys.exit(main())
