"""Rooms: what preparing one takes, planning in one, and what docked drives cost on the paper's scenes.

Prepared are the stops of a room of twelve boxes and of a map of 400 x 400 cells with three tables, with all drives
between them: anew, and from the cache folder. The map's file is read each time.

Plans are timed, warm, in random rooms with three surfaces and ten objects. So that all share programs they are those
with 385 to 512 stops. Apart stand the rooms in which the stops in line with the surfaces serve every object, and those
in which the grid round the surfaces, of some thousand poses, has to help. How many of each are drawn is said. The first
plan is that of a process of its own which finds nothing compiled.

Inverse kinematics clear of obstacles is that of grasps over twelve boxes from bases round them.

The paper's scenes are planned exactly over aligned stops twice, with docked drives and with those of a point. The ratio
of the two execution times says what truth to the footprint costs.

CPU is the process's time, all its threads together, beside the wall's: on a machine that others use it says more.
"""

import dataclasses
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from jax import Array
from rich.table import Table

from basenet_jax.config import NavigationConfig
from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.planners.candidates import check_candidates, only_reachable
from basenet_jax.planners.dp import plan_exactly
from basenet_jax.planners.protocol import Planner, PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.planners.timed import plan_timed
from basenet_jax.task.plan import compiled_execute
from basenet_jax.task.prepared_world import compiled_first_drives
from basenet_jax.world.generate_rooms import draw_room
from basenet_jax.world.scene import NamedScene, Scene
from basenet_jax.world.scene_file import save_scene
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse
from benchmarks.paired import bootstrap_interval
from benchmarks.room_preparation import Row, free_ik_rate, preparations, row_of
from benchmarks.timing import measure_plain

NAME = "rooms"
SURFACES = 3
STOPS = 512  # that the rooms' are filled up to

_INHERITED = ("JAX_COMPILATION_CACHE", "BASENET_JAX")  # of the environment, what a first plan doesn't inherit


@dataclass(frozen=True)
class RoomsOptions(Options):
    """Options, and what is planned."""

    objects: int = 10
    """In each room, and in each of the paper's scenes."""
    rooms: int = 4
    """Random rooms in which the aligned stops serve every object."""
    beyond: int = 0
    """Random rooms in which they don't, so that planners compile for the grid too: minutes."""
    planners: tuple[str, ...] = ("basenet", "refined", "dp")
    """Names of planners that are timed in the rooms."""
    first: tuple[str, ...] = ("basenet",)
    """Those of which the first plan is timed."""
    grasps: int = 65_536
    """Of which inverse kinematics is computed at once."""
    scenes: int = 200
    """Of the paper's, planned with docked drives and with those of a point."""


def main(arguments: list[str] | None = None) -> Row:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(RoomsOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    if options.quick:
        small = {"rooms": 1, "beyond": 0, "planners": ("dp",), "first": (), "grasps": 256, "scenes": 2}
        options = dataclasses.replace(options, objects=QUICK_OBJECTS, **small)
    results = preparations(options.seed, options.repeats, with_map=not options.quick)
    within, beyond, drawn = _rooms(options)
    results += [_plans(name, within, options.repeats, "") for name in options.planners]
    if beyond:
        results += [_plans(name, beyond, options.repeats, ", the grid has to help") for name in options.planners]
    results += [_first_plan(name, within[0]) for name in options.first]
    results += [free_ik_rate(options.seed, options.grasps, options.repeats), _cost_of_docking(options)]
    table = Table(title="Rooms")
    for column in ("what", "median (s)", "least (s)", "most (s)", "CPU (s)", "more"):
        table.add_column(column, justify="left" if column in ("what", "more") else "right")
    for row in results:
        numbers = (f"{row[name]:.4f}" for name in ("median_s", "min_s", "max_s"))
        table.add_row(row["what"], *numbers, f"{row['cpu_s']:.4f}" if "cpu_s" in row else "", row["said"])
    return report.finish(results, table=table, rooms_drawn=drawn)


def _rooms(options: RoomsOptions) -> tuple[list[NamedScene], list[NamedScene], dict[str, int]]:
    """The first random rooms of either kind, with so many surfaces and stops; and how many of each were drawn."""
    found: dict[bool, list[NamedScene]] = {True: [], False: []}
    seed = 0
    while len(found[True]) < options.rooms or len(found[False]) < options.beyond:
        room = draw_room([options.seed, seed], options.objects)
        seed += 1
        if room.furniture is None or len(room.furniture.surfaces) != SURFACES:
            continue
        setup = PlannerSetup(room=room.arrays.room)
        stops = setup.aligned_stops()
        if len(stops.poses) == STOPS:
            found[_stops_serve_all(setup, room.arrays)].append(room)
    counts = {"within": len(found[True]), "beyond": len(found[False]), "seeds": seed}
    return found[True][: options.rooms], found[False][: options.beyond], counts


def _stops_serve_all(setup: PlannerSetup, scene: Scene) -> bool:
    """Whether every object can be picked from one of the aligned stops that the robot gets to."""
    stops = setup.aligned_stops()
    checked = check_candidates(setup.robot, scene, stops.poses, world=setup.world)
    reached = only_reachable(checked, compiled_first_drives(setup.robot, stops, scene.robot_start))
    return bool(np.all(np.any(reached.serves, axis=0) | ~np.asarray(scene.mask)))


def _plans(name: str, rooms: list[NamedScene], repeats: int, where: str) -> Row:
    """Warm planning times of a planner, one for each room, and how its plans do."""
    times, cpu, grasped, execution = [], [], 0, []
    for room in rooms:
        scene, setup = room.arrays, PlannerSetup(room=room.arrays.room)
        planner, given = make_planner(name, setup), (scene, jax.random.key(0))
        timed = plan_timed(planner, *given, repeats=1)

        def plan(planner: Planner = planner, given: tuple[Scene, Array] = given) -> None:
            jax.block_until_ready(planner(*given))

        timing = measure_plain(plan, repeats=repeats)
        outcome = jax.device_get(compiled_execute(setup.robot, scene, timed.plan, setup.docked, config=setup.world))
        times.append(statistics.median(timing.runs_s))
        cpu.append(statistics.median(timing.cpu_s))
        grasped += int(outcome.grasped)
        execution.append(float(outcome.execution))
    every = sum(len(room.names) for room in rooms)
    said = f"{len(rooms)} rooms, {grasped} of {every} grasped, {statistics.mean(execution):.1f} s"
    return row_of(f"{name} plans{where}", times, cpu, said, grasped=grasped, objects=every, execution_s=execution)


def _first_plan(name: str, room: NamedScene) -> Row:
    """Time of `plan` where nothing is compiled, and again with what that left in the cache folder."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "room.yaml"
        save_scene(file, room)
        times, cpu = zip(*(_command(name, file) for _ in range(2)), strict=True)
    again = {"again_s": times[1], "again_cpu_s": cpu[1]}
    return row_of(f"{name}, first plan of a process", times[:1], cpu[:1], f"again: {times[1]:.2f} s", **again)


def _command(name: str, file: Path) -> tuple[float, float]:
    """Wall and CPU time (s) of `plan`, whose cache folder is beside the file."""
    inherited = {key: value for key, value in os.environ.items() if not key.startswith(_INHERITED)}
    begin, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "basenet_jax.plan", str(file), "--planner", name],
        env=inherited | {"XDG_CACHE_HOME": str(file.parent)},
        check=False,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    if done.returncode not in (0, 3):
        raise RuntimeError(f"plan ended with {done.returncode}: {done.stderr.decode()[-1000:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime
    return time.perf_counter() - begin, cpu


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
        "said": f"ratios; mean {found.mean():.4f}{between} (95 %), {len(found)} scenes",
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
