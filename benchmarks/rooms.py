"""Rooms: what preparing one takes, planning in one, and what docked drives cost on the paper's scenes.

Rooms are random ones with three surfaces and ten objects. Timed are, warm: preparing the stops of a room with all
drives between them, the same from the cache folder, and plans of several planners; `dp` chooses from the stops in line
with the surfaces. The first plan is that of a process of its own which finds nothing compiled.

The paper's scenes are planned exactly over aligned stops twice, with docked drives and with those of a point. The ratio
of the two execution times says what truth to the footprint costs.
"""

import dataclasses
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.table import Table

from basenet_jax.config import NavigationConfig
from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.planners import prepared_stops
from basenet_jax.planners.candidates import check_candidates
from basenet_jax.planners.dp import plan_exactly
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.planners.timed import plan_timed
from basenet_jax.task.plan import compiled_execute
from basenet_jax.world.generate_rooms import draw_room
from basenet_jax.world.scene import NamedScene, Scene
from basenet_jax.world.scene_file import save_scene
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse
from benchmarks.paired import bootstrap_interval
from benchmarks.timing import measure_plain

NAME = "rooms"
SURFACES = 3

Row = dict[str, Any]


@dataclass(frozen=True)
class RoomsOptions(Options):
    """Options, and what is planned."""

    objects: int = 10
    """In each room, and in each of the paper's scenes."""
    rooms: int = 8
    """Random rooms with three surfaces."""
    planners: tuple[str, ...] = ("basenet", "refined", "dp", "greedy-stops")
    """Names of planners that are timed in the rooms."""
    first: tuple[str, ...] = ("basenet", "refined")
    """Those of which the first plan is timed."""
    scenes: int = 200
    """Of the paper's, planned with docked drives and with those of a point."""


def main(arguments: list[str] | None = None) -> Row:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(RoomsOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    if options.quick:
        options = dataclasses.replace(
            options, objects=QUICK_OBJECTS, rooms=1, planners=("basenet",), first=(), scenes=2
        )
    rooms = _rooms(options)
    results = [*_prepare(rooms[0], options.repeats)]
    results += [_plans(name, rooms, options.repeats) for name in options.planners]
    results += [_first_plan(name, rooms[0]) for name in options.first]
    results.append(_cost_of_docking(options))
    table = Table(title="Rooms")
    for column in ("what", "median (s)", "least (s)", "most (s)", "more"):
        table.add_column(column, justify="left" if column in ("what", "more") else "right")
    for row in results:
        numbers = (f"{row[name]:.4f}" for name in ("median_s", "min_s", "max_s"))
        table.add_row(row["what"], *numbers, row["said"])
    return report.finish(results, table=table)


def _rooms(options: RoomsOptions) -> list[NamedScene]:
    """The first random rooms with so many surfaces."""
    found: list[NamedScene] = []
    seed = 0
    while len(found) < options.rooms:
        room = draw_room([options.seed, seed], options.objects)
        if room.furniture is not None and len(room.furniture.surfaces) == SURFACES:
            found.append(room)
        seed += 1
    return found


def _row(what: str, times: list[float], said: str = "", **facts: Any) -> Row:
    spread = {"median_s": statistics.median(times), "min_s": min(times), "max_s": max(times)}
    return {"what": what, **spread, "said": said, **facts}


def _prepare(scene: NamedScene, repeats: int) -> list[Row]:
    """Times of making a room's stops and drives ready, anew and from the cache folder."""
    setup = PlannerSetup(room=scene.arrays.room)
    before = {name: os.environ.get(name) for name in ("XDG_CACHE_HOME", "BASENET_JAX_CACHE")}

    def anew() -> None:
        prepared_stops.forget()
        jax.block_until_ready(dataclasses.replace(setup).aligned_stops())

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for what, cache in (("anew", "off"), ("from the cache folder", "on")):
            os.environ |= {"XDG_CACHE_HOME": folder, "BASENET_JAX_CACHE": cache}
            times = list(measure_plain(anew, repeats=repeats).runs_s)
            stops = len(setup.aligned_stops().poses)
            rows.append(_row(f"prepare a room {what}", times, f"{stops} stops", stops=stops))
    for name, value in before.items():
        os.environ.pop(name, None) if value is None else os.environ.update({name: value})
    prepared_stops.forget()
    return rows


def _plans(name: str, rooms: list[NamedScene], repeats: int) -> Row:
    """Warm planning times of a planner, one for each room, and how its plans do."""
    times, grasped, execution = [], 0, []
    for room in rooms:
        scene, setup = room.arrays, PlannerSetup(room=room.arrays.room)
        timed = plan_timed(make_planner(name, setup), scene, jax.random.key(0), repeats=repeats)
        outcome = jax.device_get(compiled_execute(setup.robot, scene, timed.plan, setup.docked, config=setup.world))
        times.append(timed.planning_time_s)
        grasped += int(outcome.grasped)
        execution.append(float(outcome.execution))
    every = sum(len(room.names) for room in rooms)
    said = f"{grasped} of {every} grasped, {statistics.mean(execution):.1f} s"
    return _row(f"{name} plans", times, said, grasped=grasped, objects=every, execution_s=execution)


def _first_plan(name: str, room: NamedScene) -> Row:
    """Wall time of `plan` where nothing is compiled, and again with what that left in the cache folder."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "room.yaml"
        save_scene(file, room)
        settings = ("JAX_COMPILATION_CACHE", "BASENET_JAX")
        inherited = {key: value for key, value in os.environ.items() if not key.startswith(settings)}
        times = []
        for _ in range(2):
            begin = time.perf_counter()
            subprocess.run(
                [sys.executable, "-m", "basenet_jax.plan", str(file), "--planner", name],
                env=inherited | {"XDG_CACHE_HOME": folder},
                check=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )
            times.append(time.perf_counter() - begin)
    return _row(f"{name}, first plan of a process", times[:1], f"again: {times[1]:.2f} s", again_s=times[1])


def _cost_of_docking(options: RoomsOptions) -> Row:
    """Exact plans' execution times with docked drives over those with drives of a point, scene by scene."""
    kinds = [
        dataclasses.replace(PlannerSetup().world, navigation=NavigationConfig(drives=drives))
        for drives in ("docked", "point")
    ]
    setups = [PlannerSetup(world=world) for world in kinds]
    batch = random_scenes(jax.random.key(options.seed), options.objects, options.scenes)
    ratios = []
    for index in range(options.scenes):
        scene = jax.tree.map(lambda x, index=index: x[index], batch)
        docked, point = (_exact_time(setup, scene) for setup in setups)
        ratios.append(docked / point)
    found = np.array(ratios)[np.isfinite(ratios)]
    interval = bootstrap_interval(found, seed=options.seed) if len(found) > 1 else None
    between = "" if interval is None else f", {interval[0]:.4f} to {interval[1]:.4f}"
    return {
        "what": "docked over point, exact plans over aligned stops",
        "median_s": float(np.median(found)),
        "min_s": float(found.min()),
        "max_s": float(found.max()),
        "said": f"ratios; mean {found.mean():.4f}{between} (95 %)",
        "mean_ratio": float(found.mean()),
        "interval": interval,
        "scenes": len(found),
    }


def _exact_time(setup: PlannerSetup, scene: Scene) -> float:
    """N + G (s) of the exact plan over the aligned stops; no number where they don't serve every object."""
    stops = setup.aligned_stops()
    candidates = check_candidates(setup.robot, scene, stops.poses, world=setup.world)
    plan = plan_exactly(setup.robot, setup.drives, scene, candidates, between=stops.known)
    outcome = compiled_execute(setup.robot, scene, plan, setup.docked, config=setup.world)
    return float(outcome.execution) if int(outcome.grasped) == int(np.sum(scene.mask)) else np.nan


if __name__ == "__main__":
    main()
