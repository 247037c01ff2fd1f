"""Which base poses a planner should choose from: exact planning over grids and over stops in line with the table.

On the same random scenes, N + G of the best plan over each set, as a ratio to that over the paper's grid of 10 cm and
45 degrees (over the scenes where both plans grasp every object); and what continuous refinement adds.
"""

import sys
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from rich.table import Table
from scipy import stats

from basenet_jax.config import AlignedConfig, GridConfig, RefinementConfig
from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.planners.candidates import check_candidates, grid_poses
from basenet_jax.planners.dp import plan_exactly
from basenet_jax.planners.options import RefinedOptions
from basenet_jax.planners.protocol import Planner, PlannerSetup
from basenet_jax.planners.refined import Refined
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.world.scene import Scene
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse

NAME = "stop_sets"
REFERENCE = "grid 10 cm, 45 degrees"

Poses = Float[np.ndarray, "K 3"]


@dataclass(frozen=True)
class StopSetOptions(Options):
    """Options, and on how many scenes; timing repeats don't matter here."""

    objects: int = 10
    """In each scene."""
    scenes: int = 200
    """How many."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(StopSetOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    objects, count = (QUICK_OBJECTS, 2) if options.quick else (options.objects, options.scenes)
    setup = PlannerSetup()
    batch = random_scenes(jax.random.key(options.seed), objects, count)
    scenes = [jax.tree.map(lambda x, i=i: x[i], batch) for i in range(count)]
    reference, results = None, []
    planners = _planners(setup)
    if options.quick:
        planners = dict(list(planners.items())[:2])
    for name, (planner, poses) in planners.items():
        cost = _costs(setup, planner, scenes, objects)
        reference = cost if reference is None else reference
        results.append({"what": name, "poses": poses, "objects": objects} | _ratio(cost, reference))
    return report.finish(results, table=_table(results, count))


def _planners(setup: PlannerSetup) -> dict[str, tuple[Planner, int]]:
    """By name: a planner, and how many poses it chooses from at first."""
    grids = {
        "grid 20 cm, 45 degrees": (0.2, 8),
        "grid 15 cm, 45 degrees": (0.15, 8),
        "grid 20 cm, 90 degrees": (0.2, 4),
    }
    grids |= {"grid 10 cm, 90 degrees": (0.1, 4), "grid 5 cm, 45 degrees": (0.05, 8)}
    sets = {REFERENCE: _grid(setup, 0.1, 8)}
    sets |= {name: _grid(setup, step, turns) for name, (step, turns) in grids.items()}
    sets |= {f"in line, every {100 * step:.0f} cm": _in_line(setup, step) for step in (0.2, 0.1, 0.05)}
    farther = [_in_line(setup, 0.1, AlignedConfig().gap_m + gap) for gap in (0.0, 0.05, 0.1, 0.2)]
    sets["in line, every 10 cm, and rows 5, 10 and 20 cm farther off"] = np.concatenate(farther)
    planners = {name: (_exactly(setup, poses), len(poses)) for name, poses in sets.items()}
    in_line = len(_in_line(setup, AlignedConfig().step_m))
    for rounds in (RefinementConfig().rounds, 256):
        refined = Refined(setup, RefinedOptions(refinement=RefinementConfig(rounds=rounds)))
        planners[f"in line, every 10 cm, then {rounds} rounds of refinement"] = (refined, in_line)
    return planners


def _grid(setup: PlannerSetup, step_m: float, turns: int) -> Poses:
    return grid_poses(setup.robot, setup.room, GridConfig(step_m=step_m, turns=turns), setup.world.pick)


def _in_line(setup: PlannerSetup, step_m: float, gap_m: float = AlignedConfig().gap_m) -> Poses:
    return aligned_poses(setup.robot, setup.room, AlignedConfig(step_m=step_m, gap_m=gap_m), setup.world.pick)


def _exactly(setup: PlannerSetup, poses: Poses) -> Planner:
    def plan(scene: Scene, key: jax.Array) -> Plan:
        del key
        candidates = check_candidates(setup.robot, scene, poses, world=setup.world)
        return plan_exactly(setup.robot, setup.drives, scene, candidates)

    return plan


def _costs(setup: PlannerSetup, planner: Planner, scenes: list[Scene], objects: int) -> Float[np.ndarray, " B"]:
    """N + G of each scene's plan (s); no number where it doesn't grasp every object."""
    outcomes = [compiled_execute(setup.robot, scene, planner(scene, jax.random.key(0))) for scene in scenes]
    return np.array([float(each.execution) if int(each.grasped) == objects else np.nan for each in outcomes])


def _ratio(cost: Float[np.ndarray, " B"], reference: Float[np.ndarray, " B"]) -> dict[str, Any]:
    ratio = (cost / reference)[np.isfinite(cost) & np.isfinite(reference)]
    half = stats.t.ppf(0.975, len(ratio) - 1) * ratio.std(ddof=1) / np.sqrt(len(ratio)) if len(ratio) > 1 else None
    mean = float(ratio.mean()) if len(ratio) else None
    interval = None if half is None or mean is None else [mean - float(half), mean + float(half)]
    return {"ratio": mean, "ci95": interval, "scenes": len(ratio)}


def _table(results: list[dict[str, Any]], scenes: int) -> Table:
    table = Table(title=f"Sets of stops ({scenes} scenes)")
    for column in ("stops to choose from", "poses", "N + G to the first's", "95 %", "scenes"):
        table.add_column(column, justify="left" if column.startswith("stops") else "right")
    for row in results:
        interval = "" if row["ci95"] is None else "{:.4f} to {:.4f}".format(*row["ci95"])
        ratio = "" if row["ratio"] is None else f"{row['ratio']:.4f}"
        table.add_row(row["what"], f"{row['poses']:,}", ratio, interval, str(row["scenes"]))
    return table


if __name__ == "__main__":
    main()
