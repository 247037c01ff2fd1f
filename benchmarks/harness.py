"""What all benchmarks share: timing of compiled functions, and reports that say how to get a figure again.

Compilation is timed apart from running. A run is repeated after a warm-up, every repeat ends when its results are
there, and the median is given with quartiles and extremes.
"""

import dataclasses
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from basenet_jax.atomic import write_atomically
from basenet_jax.evaluation.provenance import commit
from benchmarks import environment

RESULTS = Path(__file__).resolve().parent / "results"
_WIDTH = 160  # of tables that go to a file or a pipe

AnyOptions = TypeVar("AnyOptions", bound="Options")


@dataclass(frozen=True)
class Options:
    """What every benchmark can be told."""

    quick: bool = False
    """Tiny sizes, to see that it runs; its figures mean nothing and are written only with --out."""
    out: Path | None = None
    """File to write. Default: benchmarks/results/NAME.json; with --quick nothing."""
    repeats: int = 9
    """Timed runs after the warm-up."""
    seed: int = 0
    """Of everything random."""


@dataclass(frozen=True)
class Timing:
    """Times of one compiled function (s)."""

    compile_s: float  # tracing, lowering and compiling
    runs_s: tuple[float, ...]

    def summary(self) -> dict[str, Any]:
        """Median, quartiles and extremes of a run, and the compile time (s)."""
        minimum, q1, median, q3, maximum = np.quantile(self.runs_s, [0, 0.25, 0.5, 0.75, 1]).tolist()
        spread = {"median": median, "q1": q1, "q3": q3, "min": minimum, "max": maximum}
        return {"run_s": spread, "compile_s": self.compile_s, "repeats": len(self.runs_s)}

    def rate(self, items: int) -> dict[str, float]:
        """Items per second when one run does so many: at the median run, and between the run's quartiles."""
        q1, median, q3 = np.quantile(self.runs_s, [0.25, 0.5, 0.75]).tolist()
        return {"median": items / median, "q1": items / q3, "q3": items / q1}


def measure(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], *, repeats: int) -> Timing:
    """Times a function under jit.

    Args:
        function: of arrays.
        calls: arguments, all of the same shapes; one run calls the function with each, one after another, and waits
            for each result before the next call.
        repeats: timed runs, after one that isn't.
    """
    start = time.perf_counter()
    compiled = jax.jit(function).lower(*calls[0]).compile()
    compile_s = time.perf_counter() - start

    def run() -> float:
        start = time.perf_counter()
        for arguments in calls:
            jax.block_until_ready(compiled(*arguments))
        return time.perf_counter() - start

    run()
    return Timing(compile_s, tuple(run() for _ in range(repeats)))


def measure_steps(step: Callable[[Any], tuple[Any, Any]], state: Any, *, repeats: int) -> tuple[Timing, Any]:
    """Times a training step `state -> (state, metrics)`, each run from where the last one stopped.

    The state is donated, as in training. Returns the last metrics too.
    """
    start = time.perf_counter()
    compiled = jax.jit(step, donate_argnums=0).lower(state).compile()
    compile_s = time.perf_counter() - start
    state, metrics = jax.block_until_ready(compiled(state))
    runs = []
    for _ in range(repeats):
        start = time.perf_counter()
        state, metrics = jax.block_until_ready(compiled(state))
        runs.append(time.perf_counter() - start)
    return Timing(compile_s, tuple(runs)), jax.device_get(metrics)


def speed(what: str, unit: str, items: int, timing: Timing, **facts: Any) -> dict[str, Any]:
    """A row of results: items per second, and the times behind it."""
    return {"what": what, **facts, "unit": unit, "items": items, "rate": timing.rate(items), **timing.summary()}


def parse(kind: type[AnyOptions], name: str, description: str | None, arguments: list[str]) -> AnyOptions:
    """Options of a script from its command line; exits on --help and on errors."""
    options = tyro.cli(kind, args=arguments, prog=f"python -m benchmarks.{name}", description=description)
    if options.repeats < 1:
        raise SystemExit(f"--repeats: found {options.repeats}, allowed are 1 and more")
    return dataclasses.replace(options, repeats=min(options.repeats, 2)) if options.quick else options


class Report:
    """Results of one benchmark, with where and how they were measured."""

    def __init__(self, name: str, options: Options, arguments: list[str], *, script: str | None = None):
        """Notes command, commit, date and load; starts no backend.

        Args:
            name: of the result's file.
            options: all of them, written with the results.
            arguments: of the command line as typed.
            script: if it has another name.
        """
        self.name, self.options = name, options
        self.start: dict[str, Any] = {
            "benchmark": name,
            "command": environment.command(f"benchmarks.{script or name}", arguments),
            "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "commit": commit(),
            "load_average_at_start": round(os.getloadavg()[0], 2),
            "options": _plain(dataclasses.asdict(options)),
        }

    def finish(self, results: list[dict[str, Any]], *, table: Table, **facts: Any) -> dict[str, Any]:
        """Prints the results, and writes them unless they are of a quick run without `out`; returns all of it.

        Raises:
            OSError: the file can't be written.
        """
        cached = bool(getattr(jax.config, "jax_compilation_cache_dir", None))
        machine = {"hardware": environment.hardware(), "versions": environment.versions()}
        machine["peak_memory_gib"] = environment.peak_memory_gib()
        report = {**self.start, **machine, "compilation_cache": cached, **_plain(facts), "results": results}
        content = json.dumps(report, indent=2, allow_nan=False, ensure_ascii=False)
        console = Console(width=None if sys.stdout.isatty() else _WIDTH)
        console.print(table)
        path = self.options.out or (None if self.options.quick else RESULTS / f"{self.name}.json")
        if path is None:
            console.print(f"{self.name}: quick run, not written")
            return report
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content.encode() + b"\n")
        console.print(f"{self.name}: wrote {environment.portable(path)}")
        return report


def speed_table(title: str, results: list[dict[str, Any]], *columns: str) -> Table:
    """Rows made by `speed`, with some of their facts as columns."""
    table = Table(title=title)
    for name in ("what", *columns, "per second", "quartiles", "unit", "run (ms)", "compile (s)"):
        table.add_column(name, justify="left" if name in ("what", "unit") else "right")
    for row in results:
        facts = (f"{row.get(name, ''):.3f}" if isinstance(row.get(name), float) else row.get(name) for name in columns)
        rate, run = row["rate"], row["run_s"]
        cells = (f"{rate['median']:,.0f}", f"{rate['q1']:,.0f} to {rate['q3']:,.0f}", row["unit"])
        times = (f"{1e3 * run['median']:,.2f}", f"{row['compile_s']:.2f}")
        table.add_row(row["what"], *("" if fact is None else str(fact) for fact in facts), *cells, *times)
    return table


def _plain(value: Any) -> Any:
    """The same with paths that don't name the machine, and arrays as numbers."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return environment.portable(value)
    return value.tolist() if isinstance(value, np.generic | np.ndarray | jax.Array) else value
