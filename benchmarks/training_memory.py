"""Wall time and peak memory of a whole training, measured from outside, with the results it came to.

`python -m benchmarks.training_memory -- --preset quick --objects 10` runs `python -m basenet_jax.train` with what
stands after `--` as a child, compilation without any cache included. Memory is the child's largest resident set; on
Linux a child is never given less than the process that started it has.
"""

import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.environment import portable_argument
from benchmarks.harness import Options, Report, parse

NAME = "training_memory"
TRAIN = (sys.executable, "-m", "basenet_jax.train")


@dataclass(frozen=True)
class MemoryOptions(Options):
    """Options; quick, repeats and seed don't matter here: what stands after `--` says what is trained."""

    name: str = NAME
    """Of the result's file."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    split = arguments.index("--") if "--" in arguments else len(arguments)
    options, given = parse(MemoryOptions, NAME, __doc__, arguments[:split]), arguments[split + 1 :]
    report = Report(options.name, options, arguments, script=NAME)
    run, chosen = _run_directory(given)
    seconds, usage = _train([*given, *chosen])
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    result = {
        "what": "training",
        "arguments": [*map(portable_argument, given)],
        "wall_s": seconds,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "peak_memory_gib": usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 2**30,
        "summary": summary,
    }
    table = Table("arguments", "wall (s)", "CPU (s)", "peak memory (GiB)", "single-pick success", title="Training")
    figures = (f"{result[name]:.2f}" for name in ("wall_s", "cpu_s", "peak_memory_gib"))
    table.add_row(" ".join(result["arguments"]), *figures, f"{summary['single_pick_success']:.4f}")
    return report.finish([result], table=table)


def _run_directory(given: list[str]) -> tuple[Path, list[str]]:
    """The run directory, and the arguments that choose it where the given ones don't."""
    for i, argument in enumerate(given):
        if argument in ("--run-dir", "--run_dir"):
            return Path(given[i + 1]), []
        if argument.startswith(("--run-dir=", "--run_dir=")):
            return Path(argument.partition("=")[2]), []
    path = Path("runs") / f"{NAME}-{time.strftime('%Y%m%d-%H%M%S')}"
    return path, ["--run-dir", str(path)]


def _train(arguments: list[str]) -> tuple[float, resource.struct_rusage]:
    """Trains in a child: its wall time and use; ends the benchmark with its exit code if it fails."""
    no_cache = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    no_cache["BASENET_JAX_CACHE"] = "off"
    start = time.perf_counter()
    with subprocess.Popen([*TRAIN, *arguments], env=no_cache) as child:
        _, status, usage = os.wait4(child.pid, 0)  # this child's only; git, asked for the commit, is another
        seconds, child.returncode = time.perf_counter() - start, os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise SystemExit(child.returncode)
    return seconds, usage


if __name__ == "__main__":
    main()
