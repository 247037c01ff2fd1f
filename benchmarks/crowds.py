"""Many objects close together on one table: what the planners grasp of what any order of picks can, how fast, how well.

Objects of the packaged classes stand anywhere on a strip of one table, turned by any angle, as near as `gap_m` to each
other, so that arms and grippers meet neighbours: what is picked first decides what can be picked then. What *any order
can* is counted on the stops in line with the table, of which each planner has at least those.
"""

import dataclasses
import statistics
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.table import Table

from basenet_jax.config import AlignedConfig
from basenet_jax.documents.yaml_text import to_yaml
from basenet_jax.planners.candidates import check_candidates
from basenet_jax.planners.protocol import Planner, PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.planners.timed import plan_timed
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.plan import judge
from basenet_jax.world.scene import OBJECT_CLASSES, NamedScene
from basenet_jax.world.scene_file import load_scene
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse

NAME = "crowds"
_FLOOR, _TABLE, _START = (6.0, 5.0), (3.0, 2.5, 0.0), (1.0, 0.8, 0.0)
_TRIES = 20_000

Row = dict[str, Any]


@dataclass(frozen=True)
class CrowdsOptions(Options):
    """Options, and what is planned."""

    objects: int = 20
    """On each table."""
    scenes: int = 50
    """Drawn, by seeds from 0."""
    gap_m: float = 0.015
    """Least distance between the rectangles on which objects stand."""
    strip_m: tuple[float, float] = (1.3, 0.55)
    """Of the table, in its middle, on which they stand."""
    planners: tuple[str, ...] = ("basenet", "refined", "greedy-stops", "mbp-gc", "pbg-gc")
    """Names of planners."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Plans, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(CrowdsOptions, NAME, __doc__, arguments)
    if options.quick:
        options = dataclasses.replace(options, objects=QUICK_OBJECTS, scenes=1, planners=("greedy-stops",))
    report = Report(NAME, options, arguments)
    scenes = [draw_crowd(options, seed) for seed in range(options.seed, options.seed + options.scenes)]
    setup = PlannerSetup(robot=jax.device_put(load_robot(scenes[0].robot)), room=scenes[0].arrays.room)
    possible = [_possible(setup, scene) for scene in scenes]
    rows = []
    for name in options.planners:
        planner = make_planner(name, setup)
        runs = [_plan(setup, planner, scene, possible=most) for scene, most in zip(scenes, possible, strict=True)]
        rows.append(_summary(name, runs))
    return report.finish(rows, table=_table(rows), most_of_any_order=possible)


def draw_crowd(options: CrowdsOptions, seed: int) -> NamedScene:
    """One table with so many objects close together.

    Raises:
        ValueError: they find no place; ask for fewer objects, a smaller gap or a larger strip.
    """
    rng = np.random.default_rng(seed)
    kinds = [OBJECT_CLASSES[number] for number in rng.integers(len(OBJECT_CLASSES), size=options.objects)]
    kinds.sort(key=lambda kind: -kind.size[0] * kind.size[1])
    placed: list[tuple[float, float, float]] = []
    outlines: list[np.ndarray] = []
    tries = 0
    while len(placed) < len(kinds):
        if (tries := tries + 1) > _TRIES:
            raise ValueError(f"objects: found {options.objects}, allowed are as many as find a place")
        x, y = rng.uniform(-0.5, 0.5, 2) * options.strip_m
        yaw = rng.uniform(-np.pi, np.pi)
        half = np.array(kinds[len(placed)].size[:2]) / 2 + options.gap_m / 2
        outline = _outline(x, y, yaw, half)
        if not any(_overlap(outline, other) for other in outlines):
            outlines.append(outline)
            placed.append((_TABLE[0] + x, _TABLE[1] + y, yaw))
    return _as_scene(kinds, placed)


def _as_scene(kinds: list[Any], placed: list[tuple[float, float, float]]) -> NamedScene:
    document = {
        "format": "basenet-scene/2",
        "floor": [0.0, 0.0, *_FLOOR],
        "surfaces": [{"name": "table", "pose": list(_TABLE), "size": [1.6, 0.8], "height": 0.75}],
        "robot": {"model": "ur5e_mobile", "start": list(_START)},
        "drives": "docked",
        "clutter": True,
        "objects": [
            {"name": f"{kind.name}_{number}", "class": kind.name, "pose": [round(float(v), 4) for v in pose]}
            for number, (kind, pose) in enumerate(zip(kinds, placed, strict=True))
        ],
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "crowd.yaml"
        path.write_bytes(to_yaml(document))
        return load_scene(path)


def _outline(x: float, y: float, yaw: float, half: np.ndarray) -> np.ndarray:
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return corners @ turn.T + (x, y)


def _overlap(a: np.ndarray, b: np.ndarray) -> bool:
    """By separating axes."""
    for corners in (a, b):
        for edge in (corners[1] - corners[0], corners[2] - corners[1]):
            one, other = a @ edge, b @ edge
            if one.max() < other.min() or other.max() < one.min():
                return False
    return True


def _possible(setup: PlannerSetup, scene: NamedScene) -> int:
    stops = setup.aligned_stops(AlignedConfig())
    candidates = check_candidates(setup.robot, scene.arrays, stops.poses, world=setup.world)
    return int(np.sum(np.any(np.asarray(candidates.serves), axis=0)))


def _plan(setup: PlannerSetup, planner: Planner, scene: NamedScene, *, possible: int) -> Row:
    timed = plan_timed(planner, scene.arrays, jax.random.key(0))
    outcome = jax.device_get(judge(setup.robot, scene.arrays, timed.plan, setup.world))
    waits = int(np.sum(np.asarray(timed.plan.served) & ~np.asarray(outcome.feasible)))
    return {
        "grasped": int(outcome.grasped),
        "possible": possible,
        "infeasible": waits,
        "execution": float(outcome.execution),
        "planning": timed.planning_time_s,
    }


def _summary(name: str, runs: list[Row]) -> Row:
    def each(key: str) -> list[float]:
        return [run[key] for run in runs]

    return {
        "planner": name,
        "grasped_of_possible": sum(each("grasped")) / max(sum(each("possible")), 1),
        "infeasible_picks": sum(each("infeasible")),
        "execution_mean_s": statistics.fmean(each("execution")),
        "execution_sd_s": statistics.pstdev(each("execution")),
        "planning_median_s": statistics.median(each("planning")),
        "planning_most_s": max(each("planning")),
        "scenes": len(runs),
    }


def _table(rows: list[Row]) -> Table:
    table = Table(title="Crowded tables")
    for column in ("planner", "grasped of what any order can, %", "N + G, s", "P median, s", "P most, s"):
        table.add_column(column, justify="left" if column == "planner" else "right")
    for row in rows:
        spread = f"{row['execution_mean_s']:.1f} ± {row['execution_sd_s']:.1f}"
        times = (f"{row['planning_median_s']:.3f}", f"{row['planning_most_s']:.3f}")
        table.add_row(row["planner"], f"{100 * row['grasped_of_possible']:.1f}", spread, *times)
    return table


if __name__ == "__main__":
    main()
