"""Many objects, beyond exact planning: our planners beside a strong routing solver on the paper's grid.

PyVRP (extra `benchmarks`) gets the costs that exact planning would: one client for each pair of grid pose and object
that the pose serves, one required group of clients for each object, pick times as service, drives as travel; one
vehicle that may end anywhere. It runs for a fixed time, the tables made before it not counted.
"""

import sys
import time
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import jax
import numpy as np
import pyvrp
from jaxtyping import Int
from pyvrp.stop import MaxRuntime
from rich.table import Table
from scipy import stats

from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.planners.candidates import check_candidates
from basenet_jax.planners.protocol import Planner, PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.planners.stop_problem import SizedProblem, stop_problem
from basenet_jax.planners.timed import plan_timed
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.world.scene import Scene
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse

NAME = "routing"
ROUTING = "PyVRP on the grid"
_UNITS = 10_000  # PyVRP's costs are integers: units of 0.1 ms


@dataclass(frozen=True)
class RoutingOptions(Options):
    """Options, and what is compared on how many scenes."""

    objects: tuple[int, ...] = (20, 30)
    """Numbers of objects in a scene."""
    scenes: int = 20
    """Scenes for each number of objects."""
    seconds: float = 10.0
    """That PyVRP searches for each scene."""
    planners: tuple[str, ...] = ("greedy-stops", "basenet", "basenet-sample", "refined")
    """Ours."""
    repeats: int = 3
    """Warm calls of ours per scene; P is their median."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(RoutingOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    sizes, count, seconds = (
        ((QUICK_OBJECTS,), 2, 0.2) if options.quick else (options.objects, options.scenes, options.seconds)
    )
    setup = PlannerSetup()
    planners = ("greedy-stops", "basenet") if options.quick else options.planners
    results = []
    for objects in sizes:
        batch = random_scenes(jax.random.key(options.seed), objects, count)
        scenes = [jax.tree.map(lambda x, i=i: x[i], batch) for i in range(count)]
        routed = [_judged(setup, scene, plan_by_routing(setup, scene, seconds, options.seed)) for scene in scenes]
        results.append(_row(ROUTING, objects, np.array(routed), np.array(routed), [seconds] * count))
        for name in planners:
            costs, times = _ours(setup, make_planner(name, setup), scenes, options.repeats)
            results.append(_row(name, objects, costs, np.array(routed), times))
    facts = {"pyvrp": metadata.version("pyvrp"), "scenes": count, "seconds": seconds}
    return report.finish(results, table=_table(results), **facts)


def plan_by_routing(setup: PlannerSetup, scene: Scene, seconds: float, seed: int) -> Plan:
    """The best plan over the grid's poses that PyVRP finds in some seconds."""
    candidates = check_candidates(setup.robot, scene, setup.grid_poses, world=setup.world)
    problem = stop_problem(setup.robot, setup.drives, scene, candidates)
    return problem.plan(scene, *solve(problem, seconds, seed))


def solve(problem: SizedProblem, seconds: float, seed: int) -> tuple[Int[np.ndarray, " N"], Int[np.ndarray, " N"]]:
    """Which object each step picks, and at which stop, by PyVRP."""
    pick_time, first, drive = map(np.asarray, problem.costs)
    useful = np.isfinite(first)  # without those that fill up
    stops, objects = np.nonzero(np.isfinite(pick_time) & useful[:, None])
    durations: Any = _durations(first, drive)  # PyVRP's own annotation of arrays fits none
    data = pyvrp.ProblemData(
        locations=[pyvrp.Location(0, 0) for _ in range(2 + len(first))],  # the start, then the end, then the stops
        clients=[
            pyvrp.Client(2 + int(stop), service_duration=_units(pick_time[stop, slot]), required=False, group=int(slot))
            for stop, slot in zip(stops, objects, strict=True)
        ],
        depots=[pyvrp.Depot(0), pyvrp.Depot(1)],
        vehicle_types=[pyvrp.VehicleType(1, start_depot=0, end_depot=1, unit_distance_cost=0, unit_duration_cost=1)],
        distance_matrices=[0 * durations],
        duration_matrices=[durations],
        groups=[pyvrp.ClientGroup(np.flatnonzero(objects == slot).tolist()) for slot in range(pick_time.shape[1])],
    )
    solution = pyvrp.solve(data, MaxRuntime(seconds), seed=seed, collect_stats=False, display=False).best
    (route,) = solution.routes()
    visited = np.array([activity.idx for activity in route if activity.is_client()])
    return objects[visited], stops[visited]


def _durations(first: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Travel times in units: from the start by `first`, to the end nothing, elsewhere as never if there is no way."""
    matrix = np.zeros((2 + len(first),) * 2, np.int64)
    never = _units(1e6)
    matrix[0, 2:] = np.where(np.isfinite(first), np.round(first * _UNITS), never)
    matrix[2:, 2:] = np.where(np.isfinite(drive), np.round(drive * _UNITS), never)
    matrix[2:, 0] = never  # nothing returns to the start
    return matrix


def _units(seconds: float) -> int:
    return round(float(seconds) * _UNITS)


def _ours(setup: PlannerSetup, planner: Planner, scenes: list[Scene], repeats: int) -> tuple[np.ndarray, list[float]]:
    timed = [plan_timed(planner, scene, jax.random.key(0), repeats=repeats) for scene in scenes]
    costs = [_judged(setup, scene, each.plan) for scene, each in zip(scenes, timed, strict=True)]
    return np.array(costs), [each.planning_time_s for each in timed]


def _judged(setup: PlannerSetup, scene: Scene, plan: Plan) -> float:
    """N + G (s) by the judge; no number if an object isn't grasped."""
    outcome = compiled_execute(setup.robot, scene, plan)
    return float(outcome.execution) if int(outcome.grasped) == int(np.sum(scene.mask)) else np.nan


def _row(name: str, objects: int, cost: np.ndarray, reference: np.ndarray, times: list[float]) -> dict[str, Any]:
    ratio = (cost / reference)[np.isfinite(cost) & np.isfinite(reference)]
    half = stats.t.ppf(0.975, len(ratio) - 1) * ratio.std(ddof=1) / np.sqrt(len(ratio)) if len(ratio) > 1 else None
    mean = float(ratio.mean()) if len(ratio) else None
    return {
        "what": name,
        "objects": objects,
        "execution_s": float(np.nanmean(cost)),
        "ratio": mean,
        "ci95": None if half is None or mean is None else [mean - float(half), mean + float(half)],
        "scenes": len(ratio),
        "planning_s": {"median": float(np.median(times)), "max": float(np.max(times))},
    }


def _table(results: list[dict[str, Any]]) -> Table:
    table = Table(title=f"Beside a routing solver ({time.strftime('%Y-%m-%d')})")
    for column in ("planner", "objects", "N + G (s)", "to PyVRP's", "95 %", "scenes", "P median (s)", "P most (s)"):
        table.add_column(column, justify="left" if column == "planner" else "right")
    for row in results:
        interval = "" if row["ci95"] is None else "{:.4f} to {:.4f}".format(*row["ci95"])
        ratio = "" if row["ratio"] is None else f"{row['ratio']:.4f}"
        times = (f"{row['planning_s'][name]:.3f}" for name in ("median", "max"))
        cells = (str(row["objects"]), f"{row['execution_s']:.1f}", ratio, interval, str(row["scenes"]))
        table.add_row(row["what"], *cells, *times)
    return table


if __name__ == "__main__":
    main()
