"""Where the time of the paper's learned planner goes: what it loses by learning, by its rewards, by the drives' model.

Beside `basenet-paper` and exact planning stand plans by the same scheme (choose an object, then a base pose for it
alone) with one part replaced: objects are picked from where the robot stands when they can be; base poses are not
learned but are those of greatest reward among a fine grid's, in the learned order and in the order of greatest reward;
drives are the paper's simplest reading, straight through anything; and these at constant speed, so that times are
weighted lengths and angles. Ratios of N + G to exact planning's on the paper's grid, with the same model of drives,
over the scenes where both grasp every object.
"""

import dataclasses
import itertools
import sys
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from rich.table import Table

from basenet_jax.config import GridConfig, WorldConfig
from basenet_jax.evaluation.scene_sets import random_set
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.robot.reading import load_robot
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse
from benchmarks.paired import t_interval
from benchmarks.paper_schemes import make_schemes

NAME = "paper_planner"
SCENE_SEED = 1
FINE = GridConfig(step_m=0.05, turns=16)
AT_ONCE = 1e6  # times the robot's own accelerations: full speed after a microsecond


@dataclass(frozen=True)
class PaperPlannerOptions(Options):
    """Options, and on how many scenes; timing repeats don't matter here."""

    objects: tuple[int, ...] = (5, 10)
    """Numbers of objects in a scene."""
    scenes: int = 100
    """Scenes for each number of objects: the first of `evaluate --seed 1`."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(PaperPlannerOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    sizes, count = ((QUICK_OBJECTS,), 2) if options.quick else (options.objects, options.scenes)
    results = []
    for objects in sizes:
        scenes = random_set(objects, count, seed=SCENE_SEED)
        for drives, setup in list(_setups().items())[: 1 if options.quick else None]:
            plans = make_schemes(setup, GridConfig() if options.quick else FINE)
            plans = dict(itertools.islice(plans.items(), 2 if options.quick else None))
            costs = {name: np.array([plan(scenes.scene(i)) for i in range(count)]) for name, plan in plans.items()}
            results += [_row(name, objects, drives, cost, costs["dp"]) for name, cost in costs.items()]
    return report.finish(results, table=_table(results, count))


def _setups() -> dict[str, PlannerSetup]:
    """How the base drives, by name."""
    world, robot = WorldConfig(), load_robot()
    straight = dataclasses.replace(world, navigation=dataclasses.replace(world.navigation, straight=True))
    at_once = dataclasses.replace(robot, base_acceleration=AT_ONCE * robot.base_acceleration)
    return {
        "round the table": PlannerSetup(),
        "straight": PlannerSetup(world=straight),
        "straight, constant speed": PlannerSetup(robot=jax.device_put(at_once), world=straight),
    }


def _row(name: str, objects: int, drives: str, cost: np.ndarray, reference: np.ndarray) -> dict[str, Any]:
    """Figures of one way to plan (columns N, G and share grasped) beside exact planning's."""
    both = (cost[:, 2] == 1.0) & (reference[:, 2] == 1.0)
    ratio = (cost[:, :2].sum(axis=1) / reference[:, :2].sum(axis=1))[both]
    return {
        "what": name,
        "objects": objects,
        "drives": drives,
        "grasped_share": float(cost[:, 2].mean()),
        "navigation_s": float(cost[:, 0].mean()),
        "grasping_s": float(cost[:, 1].mean()),
        "ratio": float(ratio.mean()) if len(ratio) else None,
        "ci95": t_interval(ratio) if len(ratio) > 1 else None,
        "complete_share": float(both.mean()),
    }


def _table(results: list[dict[str, Any]], scenes: int) -> Table:
    table = Table(title=f"The paper's planner and its parts ({scenes} scenes)")
    for column in ("objects", "drives", "plans", "grasped %", "N (s)", "G (s)", "N + G to dp's", "95 %", "complete %"):
        table.add_column(column, justify="left" if column in ("drives", "plans") else "right")
    for row in results:
        interval = "" if row["ci95"] is None else "{:.3f} to {:.3f}".format(*row["ci95"])
        ratio = "" if row["ratio"] is None else f"{row['ratio']:.3f}"
        times = (f"{row[name]:.1f}" for name in ("navigation_s", "grasping_s"))
        shares = (f"{100 * row[name]:.1f}" for name in ("grasped_share", "complete_share"))
        table.add_row(str(row["objects"]), row["drives"], row["what"], next(shares), *times, ratio, interval, *shares)
    return table


if __name__ == "__main__":
    main()
