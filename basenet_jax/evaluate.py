"""Compares planners on the same scenes, the paper's Table I: `python -m basenet_jax.evaluate --out DIR`."""

import dataclasses
import sys
from dataclasses import dataclass, field
from pathlib import Path

from basenet_jax.command_line import PlannerArguments, UncertaintyArguments, parse, world_of_file
from basenet_jax.config import WorldConfig


@dataclass(frozen=True, kw_only=True)
class Arguments(PlannerArguments, UncertaintyArguments):
    """Runs planners on random scenes or scene files, judges their plans and writes the paper's Table I.

    Into --out come table.md, table.csv and results.json: share of objects grasped, planning time P, navigation time N,
    grasping time G and their sums, in seconds, with the spread over scenes. P is measured warm. Every executed pick is
    replayed in MuJoCo. A planner that refuses a number of objects gets a row that says so. With --uncertainty planners
    that can are there twice, as they are and planning for errors ("robust"), with how sure their picks are.
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
    devices: int | None = None
    """How many of this machine's devices plan the scenes beyond --timed together. Default: all."""
    noise: bool = False
    """With --uncertainty: also executes all plans with these errors; what is left after parking is planned anew."""
    config: Path | None = None
    """YAML or JSON file of settings, such as a training's config.json, whose world is used. Options come before it."""
    world: WorldConfig = field(default_factory=WorldConfig)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        defaults = {"world": world_of_file(given)}
    except ValueError as error:
        return _fail(2, str(error))
    options = parse(Arguments, given, "python -m basenet_jax.evaluate", defaults)
    try:
        return _evaluate(options, given)
    except KeyboardInterrupt:
        return _fail(130, f"interrupted; nothing was written to {options.out}")


def _evaluate(options: Arguments, given: list[str]) -> int:
    # Here and not above: JAX and MuJoCo take seconds to import, which --help needn't wait for.
    from basenet_jax.commands.table_files import write_tables
    from basenet_jax.commands.table_text import print_table
    from basenet_jax.compilation import enable_cache
    from basenet_jax.evaluation.noise import Noise
    from basenet_jax.evaluation.preparation import Request, prepare
    from basenet_jax.evaluation.table import compare
    from basenet_jax.progress import make_reporter
    from basenet_jax.task.reliability import Chance

    enable_cache()
    named = {each.name for each in dataclasses.fields(Request)} - {"options"}
    request = Request(**{name: getattr(options, name) for name in named}, options=options.given_options())
    try:
        uncertainty = options.given_uncertainty()
        if options.noise and uncertainty is None:
            raise ValueError("--noise: found without --uncertainty, which says how large the errors are")
        planners, sets, about = prepare(request, given, uncertainty)
    except ValueError as error:
        return _fail(2, str(error))
    noise = None
    if uncertainty is not None:
        noise = Noise(Chance.of(uncertainty, options.reliability), options.noise, options.seed)
    rows = compare(
        planners,
        sets,
        repeats=options.repeats,
        seed=options.seed,
        reporter=make_reporter(),
        timed=options.timed,
        noise=noise,
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
