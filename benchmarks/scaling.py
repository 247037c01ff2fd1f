"""How long every planner takes as scenes grow: planning time P of warm calls for 2 to 30 objects.

The same random scenes for all planners, one after another; P is a scene's median of warm calls, and a row is the
median over the scenes. `dp` is left out above 12 objects: its time and memory double with each.
"""

import dataclasses
import sys
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from rich.table import Table

from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import PLANNERS, make_planner
from basenet_jax.planners.timed import plan_timed
from basenet_jax.world.scene import Scene
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse
from benchmarks.scaling_picture import draw_scaling

NAME = "scaling"
EXACT, MOST_FOR_EXACT = "dp", 12


@dataclass(frozen=True)
class ScalingOptions(Options):
    """Options, and what is planned."""

    objects: tuple[int, ...] = (2, 5, 10, 12, 15, 20, 25, 30)
    """Numbers of objects in a scene."""
    scenes: int = 10
    """Scenes for each number of objects."""
    planners: tuple[str, ...] = tuple(PLANNERS)
    """Names of planners."""
    repeats: int = 3
    """Warm calls per scene and planner; P is their median."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(ScalingOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    if options.quick:
        options = dataclasses.replace(
            options, objects=(QUICK_OBJECTS,), scenes=2, planners=("pbg", "mbp", "basenet-paper")
        )
    setup, results = PlannerSetup(), []
    planners = {name: make_planner(name, setup) for name in options.planners}
    for objects in options.objects:
        batch = random_scenes(jax.random.key(options.seed), objects, options.scenes)
        scenes: list[Scene] = [jax.tree.map(lambda x, i=i: x[i], batch) for i in range(options.scenes)]
        for name, planner in planners.items():
            if name == EXACT and objects > MOST_FOR_EXACT:
                continue
            key = jax.random.key(options.seed)
            timed = [plan_timed(planner, scene, key, repeats=options.repeats) for scene in scenes]
            results.append({"what": name, "objects": objects} | _times([each.planning_time_s for each in timed]))
        if not options.quick:
            jax.clear_caches()  # compiled programs use up the memory mappings that Linux allows a process
    series = {name: [_point(row) for row in results if row["what"] == name] for name in planners}
    return report.finish(
        results,
        table=_table(results, options),
        picture=draw_scaling(
            "Planning time by the size of the scene (median and quartiles)",
            series,
            size="objects in the scene",
            value="planning time, warm (s)",
            log_size=False,
        ),
    )


def _times(seconds: list[float]) -> dict[str, Any]:
    minimum, q1, median, q3, maximum = np.quantile(seconds, [0, 0.25, 0.5, 0.75, 1]).tolist()
    return {"planning_s": {"median": median, "q1": q1, "q3": q3, "min": minimum, "max": maximum}}


def _point(row: dict[str, Any]) -> tuple[float, float, float, float]:
    return (row["objects"], *(row["planning_s"][name] for name in ("median", "q1", "q3")))


def _table(results: list[dict[str, Any]], options: ScalingOptions) -> Table:
    table = Table(title="Planning time (ms), median over the scenes")
    table.add_column("planner")
    for objects in options.objects:
        table.add_column(f"{objects} objects", justify="right")
    for name in options.planners:
        times = {row["objects"]: 1e3 * row["planning_s"]["median"] for row in results if row["what"] == name}
        cells = (f"{times[objects]:.1f}" if objects in times else "" for objects in options.objects)
        table.add_row(name, *cells)
    return table


if __name__ == "__main__":
    main()
