"""Runs every benchmark at a tiny size, to see that all of them work: `python -m benchmarks`.

The figures mean nothing. `training_memory` is left out: it trains for minutes; and so is `routing` where PyVRP isn't
installed (extra `benchmarks`).
"""

import importlib
import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

SCRIPTS = (
    "inverse_kinematics",
    "navigation",
    "picks",
    "sequence_training",
    "orders",
    "planners",
    "paper_planner",
    "stop_sets",
    "replanning",
    "cold_start",
    "routing",
)


@dataclass(frozen=True)
class Arguments:
    """Runs every benchmark at a tiny size and says what each writes."""

    out: Path | None = None
    """Folder for the results, one file NAME.json each. Default: nothing is written."""


def main(arguments: list[str] | None = None) -> None:
    """Runs the scripts asked for, one after the other."""
    options = tyro.cli(Arguments, args=arguments, prog="python -m benchmarks", description=__doc__)
    for name in SCRIPTS:
        if name == "routing" and importlib.util.find_spec("pyvrp") is None:
            print('routing: left out, it needs PyVRP: pip install "basenet_jax[benchmarks]"')
            continue
        written = ["--out", str(options.out / f"{name}.json")] if options.out else []
        importlib.import_module(f"benchmarks.{name}").main(["--quick", *written])


if __name__ == "__main__":
    sys.exit(main())
