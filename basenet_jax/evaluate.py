"""Compares planners on the same scenes, the paper's Table I: `python -m basenet_jax.evaluate --out DIR`."""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class Arguments:
    """Runs planners on random scenes or scene files, judges their plans and writes the paper's Table I.

    Into --out come table.md, table.csv and results.json: share of objects grasped, planning time P, navigation time N,
    grasping time G and their sums, in seconds, with the spread over scenes. P is measured warm. Every executed pick is
    replayed in MuJoCo. A planner that refuses a number of objects gets a row that says so.
    """

    out: Path
    """Folder for the results; made if it isn't there."""
    objects: tuple[int, ...] | None = None
    """Numbers of objects of random scenes, each 1 to 50. Default: 5 10."""
    scenes: int | None = None
    """How many random scenes for each number of objects. Default: 50."""
    planners: tuple[str, ...] = ("all",)
    """Names of planners, or all."""
    scene_dir: Path | None = None
    """Folder of scene files to use instead of random scenes."""
    robot: str | None = None
    """A packaged robot's name or the path of a robot file. Default: ur5e_mobile, or what the scene files name."""
    seed: int = 0
    """Of the random scenes, and of planners that draw random numbers."""
    repeats: int = 3
    """Warm calls per scene and planner; P is their median."""
    timed: int = 100
    """So many scenes are planned again and again, for P; the rest once, together where the planner can."""
    weights: Path | None = None
    """Weights file of the learned planners. Default: the one shipped with the package."""
    budget: float = 0.0
    """Seconds that an anytime planner (refined) goes on for a better plan; its first one it always finishes."""
    samples: int = 256
    """Rollouts that basenet-sample draws and takes the best of."""
    devices: int | None = None
    """How many of this machine's devices plan the scenes beyond --timed together. Default: all."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    options = tyro.cli(Arguments, args=given, prog="python -m basenet_jax.evaluate")
    try:
        return _evaluate(options, given)
    except KeyboardInterrupt:
        return _fail(130, f"interrupted; nothing was written to {options.out}")


def _evaluate(options: Arguments, given: list[str]) -> int:
    # Here and not above: JAX and MuJoCo take seconds to import, which --help needn't wait for.
    from basenet_jax.compilation import enable_cache
    from basenet_jax.evaluation.preparation import Request, prepare
    from basenet_jax.evaluation.table import compare
    from basenet_jax.evaluation.table_files import write_tables
    from basenet_jax.evaluation.table_text import print_table
    from basenet_jax.learning.progress import make_reporter

    enable_cache()
    request = Request(**dataclasses.asdict(options))
    try:
        planners, sets, about = prepare(request, given)
    except ValueError as error:
        return _fail(2, str(error))
    rows = compare(
        planners,
        sets,
        repeats=options.repeats,
        seed=options.seed,
        reporter=make_reporter(),
        timed=options.timed,
    )
    try:
        write_tables(options.out, rows, about)
    except OSError as error:
        return _fail(1, f"{options.out}: can't be written: {error.strerror}")
    print_table(rows, about["scenes"])
    return 0


def _fail(code: int, message: str) -> int:
    print(f"basenet_jax.evaluate: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
