"""How long a command takes from nothing: `plan` of a random scene, the first time and again, and `--help`.

Each is a process of its own. The first run finds no compiled programs, no reachability map and no byte code, the others
find what the first left in the cache folder.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
from rich.table import Table

from basenet_jax.api import sample_scene
from basenet_jax.world.scene_file import save_scene
from benchmarks.harness import Options, Report, parse

NAME = "cold_start"
COMMANDS = ("train", "generate", "plan", "evaluate")


@dataclass(frozen=True)
class ColdStartOptions(Options):
    """Options, and what is planned."""

    objects: int = 10
    """In the scene."""
    planners: tuple[str, ...] = ("basenet", "basenet-paper", "basenet-sample", "refined", "dp", "greedy-stops")
    """Names of planners; with --quick nothing is planned."""
    repeats: int = 3
    """Further runs after the first; the median counts."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(ColdStartOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    if options.quick:
        options = replace(options, planners=(), repeats=1)
    with tempfile.TemporaryDirectory() as folder:
        scene = str(Path(folder) / "scene.yaml")
        save_scene(scene, sample_scene(jax.random.key(options.seed), objects=options.objects))
        results = []
        for planner in options.planners:
            call = ["plan", [scene, "--planner", planner], str(Path(folder) / planner)]
            first, *later = (_seconds(*call) for _ in range(1 + options.repeats))
            results.append({"what": f"plan --planner {planner}", "first_s": first} | _spread(later))
        for command in COMMANDS:
            times = [_seconds(command, ["--help"], folder) for _ in range(1 + options.repeats)]
            results.append({"what": f"{command} --help", "first_s": times[0]} | _spread(times[1:]))
    return report.finish(results, table=_table(results))


def _seconds(command: str, arguments: list[str], cache: str) -> float:
    """Wall time of one run of a command, with this folder for all that it keeps."""
    settings = ("JAX_COMPILATION_CACHE", "BASENET_JAX", "PYTHONDONTWRITEBYTECODE")
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(settings)}
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", f"basenet_jax.{command}", *arguments],
        env=inherited | {"XDG_CACHE_HOME": cache, "PYTHONPYCACHEPREFIX": str(Path(cache) / "byte-code")},
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    return time.perf_counter() - begin


def _spread(times: list[float]) -> dict[str, Any]:
    return {"later_s": statistics.median(times), "later_min_s": min(times), "later_max_s": max(times)}


def _table(results: list[dict[str, Any]]) -> Table:
    table = Table(title="Cold start, wall time (s)")
    for column in ("command", "first run", "later runs, median", "least", "most"):
        table.add_column(column, justify="left" if column == "command" else "right")
    for row in results:
        times = (row[name] for name in ("first_s", "later_s", "later_min_s", "later_max_s"))
        table.add_row(row["what"], *(f"{time:.2f}" for time in times))
    return table


if __name__ == "__main__":
    main()
