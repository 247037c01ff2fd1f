"""How many scenes a second every planner plans, by how many it is given at once.

The learned planners plan them in one program, the others one scene after the other. A planner gets larger batches as
long as the next one is expected to take no more than `--patience` seconds.
"""

import sys
from dataclasses import dataclass
from typing import Any

import jax

from basenet_jax.batch import sample_scenes
from basenet_jax.planners.protocol import PlannerSetup, plan_batch
from basenet_jax.planners.registry import PLANNERS, make_planner
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse, speed_table
from benchmarks.scaling_picture import draw_scaling, rate_points
from benchmarks.timing import measure_plain, speed

NAME = "many_scenes"

Row = dict[str, Any]


@dataclass(frozen=True)
class ManyScenesOptions(Options):
    """Options, and what is planned."""

    objects: int = 10
    """In each scene."""
    batches: tuple[int, ...] = (1, 4, 16, 64, 256, 1_024, 4_096)
    """Scenes planned at once."""
    planners: tuple[str, ...] = tuple(PLANNERS)
    """Names of planners."""
    patience: float = 3.0
    """Seconds that a call may take."""
    repeats: int = 5
    """Timed runs after the warm-up."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(ManyScenesOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    objects, batches = (QUICK_OBJECTS, (1, 4)) if options.quick else (options.objects, options.batches)
    planners = ("pbg", "basenet-paper") if options.quick else options.planners
    results: list[Row] = []
    for name in planners:
        results += _measure(name, objects, batches, options)
    series = {name: rate_points((row for row in results if row["what"] == name), "batch") for name in planners}
    return report.finish(
        results,
        table=speed_table(f"Scenes of {objects} objects", results, "batch"),
        picture=draw_scaling(
            f"Scenes of {objects} objects planned per second", series, size="scenes at once", value="scenes per second"
        ),
    )


def _measure(name: str, objects: int, batches: tuple[int, ...], options: ManyScenesOptions) -> list[Row]:
    planner, rows = make_planner(name, PlannerSetup()), []
    for batch in sorted(batches):
        if rows and rows[-1]["run_s"]["median"] * batch / rows[-1]["batch"] > options.patience:
            break
        scenes = sample_scenes(jax.random.key(options.seed), count=batch, objects=objects)

        def run(scenes: Any = scenes) -> None:
            jax.block_until_ready(plan_batch(planner, scenes, jax.random.key(options.seed)))

        rows.append(speed(name, "scenes/s", batch, measure_plain(run, repeats=options.repeats), batch=batch))
    return rows


if __name__ == "__main__":
    main()
