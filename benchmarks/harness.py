"""What all benchmarks share: options, and reports that say how to get a figure again; `timing` has the stopwatches."""

import dataclasses
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import jax
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from basenet_jax.atomic import write_atomically
from basenet_jax.evaluation.provenance import commit
from benchmarks import environment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUICK_OBJECTS = 3  # in every script, so that what one of them compiles serves the next
RESULTS = Path(__file__).resolve().parent / "results"
_WIDTH = 160  # of tables that go to a file or a pipe

AnyOptions = TypeVar("AnyOptions", bound="Options")


@dataclass(frozen=True)
class Options:
    """What every benchmark can be told."""

    quick: bool = False
    """Tiny sizes, to see that it runs; its figures are a first impression and are written only with --out."""
    out: Path | None = None
    """File to write. Default: benchmarks/results/NAME.json; with --quick nothing."""
    repeats: int = 9
    """Timed runs after the warm-up."""
    seed: int = 0
    """Of everything random."""


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

    def finish(
        self,
        results: list[dict[str, Any]],
        *,
        table: Table,
        comparisons: Sequence[dict[str, Any]] = (),
        picture: "Figure | None" = None,
        **facts: Any,
    ) -> dict[str, Any]:
        """Prints the results, and writes them unless they are of a quick run without `out`; returns all of it.

        Args:
            results: one row for each thing measured.
            table: of them.
            comparisons: rows of `timing.compare`, printed as a table of their own.
            picture: written beside the results, as NAME.png.
            facts: written with the results.

        Raises:
            OSError: a file can't be written.
        """
        cached = bool(getattr(jax.config, "jax_compilation_cache_dir", None))
        machine = {"hardware": environment.hardware(), "versions": environment.versions()}
        machine["peak_memory_gib"] = environment.peak_memory_gib()
        report = {**self.start, **machine, "compilation_cache": cached, **_plain(facts), "results": results}
        if comparisons:
            report["comparisons"] = list(comparisons)
        content = json.dumps(report, indent=2, allow_nan=False, ensure_ascii=False)
        console = make_console()
        console.print(table, *([comparison_table(comparisons)] if comparisons else []))
        path = self.options.out or (None if self.options.quick else RESULTS / f"{self.name}.json")
        if path is None:
            console.print(f"{self.name}: quick run, not written")
            return report
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content.encode() + b"\n")
        if picture is not None:
            picture.savefig(path.with_suffix(".png"))
        console.print(f"{self.name}: wrote {environment.portable(path)}")
        return report


def make_console() -> Console:
    """A console that is wide enough for tables, wherever they go."""
    return Console(width=None if sys.stdout.isatty() else _WIDTH)


def speed_table(title: str, results: list[dict[str, Any]], *columns: str) -> Table:
    """Rows made by `speed`, with some of their facts as columns."""
    table = Table(title=title)
    for name in ("what", *columns, "per second", "quartiles", "unit", "cores", "run (ms)", "compile (s)"):
        table.add_column(name, justify="left" if name in ("what", "unit") else "right")
    for row in results:
        facts = (f"{row.get(name, ''):.3f}" if isinstance(row.get(name), float) else row.get(name) for name in columns)
        rate, run = row["rate"], row["run_s"]
        cells = (f"{rate['median']:,.0f}", f"{rate['q1']:,.0f} to {rate['q3']:,.0f}", row["unit"])
        compile_s = "" if row["compile_s"] is None else f"{row['compile_s']:.2f}"
        times = (f"{row['cores']:.1f}", f"{1e3 * run['median']:,.2f}", compile_s)
        table.add_row(row["what"], *("" if fact is None else str(fact) for fact in facts), *cells, *times)
    return table


def comparison_table(comparisons: Sequence[dict[str, Any]]) -> Table:
    """Rows made by `timing.compare`."""
    table = Table(title="Beside others, in the same run")
    for name in ("ours", "other", "at", "ours per second", "other per second", "ratio", "ratio per busy core"):
        table.add_column(name, justify="left" if name in ("ours", "other") else "right")
    for row in comparisons:
        rates = map(short, row["rates"])
        ratios = (short(row[name]) for name in ("ratio", "ratio_per_core"))
        names = (f"{row[side]} ({unit})" for side, unit in zip(("ours", "theirs"), row["units"], strict=True))
        table.add_row(*names, row.get("at", ""), *rates, *ratios)
    return table


def short(number: float) -> str:
    """About three digits."""
    return f"{number:,.0f}" if number >= 100 else f"{number:.3g}"


def _plain(value: Any) -> Any:
    """The same with paths that don't name the machine, and arrays as numbers."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return environment.portable(value)
    return value.tolist() if isinstance(value, np.generic | np.ndarray | jax.Array) else value
