"""One program on several devices: how training and planning go with the number of devices that share a batch.

On a machine with accelerators these are its devices. A CPU is made as many as are asked for, by XLA's
`--xla_force_host_platform_device_count`; they share its cores, which one device by itself keeps busy already, so there
the question is not what is gained but what sharing costs. Each number of devices is measured in a process of its own.
"""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import jax

from basenet_jax.batch import sample_scenes
from basenet_jax.devices import Devices, use_devices
from basenet_jax.learning.config import ReinforceConfig, SacConfig, TrainConfig
from basenet_jax.learning.training import Training
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import make_options, make_planner
from basenet_jax.policies.trained import load_policies
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.scaling_picture import draw_scaling, rate_points
from benchmarks.timing import measure_plain, measure_steps, speed

NAME = "many_devices"
OBJECTS, PLANNER = 10, "basenet"
QUICK_SCENES, QUICK_PLANNER = 16, "basenet-paper"  # which compiles in a few seconds
FLAG = "--xla_force_host_platform_device_count"

Row = dict[str, Any]


@dataclass(frozen=True)
class ManyDevicesOptions(Options):
    """Options, and on how many devices."""

    counts: tuple[int, ...] = (1, 2, 4, 8)
    """Numbers of devices."""
    scenes: int = 1_024
    """Planned in one call."""
    iterations: int = 20
    """Training steps of a run; with --quick nothing is trained."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(ManyDevicesOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    counts = (2,) if options.quick else options.counts
    sizes = (QUICK_PLANNER, QUICK_SCENES, 0) if options.quick else (PLANNER, options.scenes, options.iterations)
    results = [row for count in counts for row in _in_own_process(count, *sizes, options.repeats)]
    names = dict.fromkeys(f"{row['what']} ({row['unit']})" for row in results)
    series = {name: [row for row in results if f"{row['what']} ({row['unit']})" == name] for name in names}
    return report.finish(
        results,
        table=speed_table("Sharing a batch out to devices", results, "devices", "batch"),
        picture=draw_scaling(
            "Training and planning by the number of devices",
            {name: rate_points(rows, "devices") for name, rows in series.items()},
            size="devices that share a batch",
            value="per second",
        ),
        platform=jax.default_backend(),
    )


def _in_own_process(count: int, planner: str, scenes: int, iterations: int, repeats: int) -> list[Row]:
    environment = dict(os.environ)
    if jax.default_backend() == "cpu":
        given = [flag for flag in environment.get("XLA_FLAGS", "").split() if not flag.startswith(FLAG)]
        environment["XLA_FLAGS"] = " ".join([*given, f"{FLAG}={count}"])
    if cache := getattr(jax.config, "jax_compilation_cache_dir", None):
        environment["JAX_COMPILATION_CACHE_DIR"] = str(cache)
    program = (
        f"from benchmarks.{NAME} import print_rows; print_rows({count}, {planner!r}, {scenes}, {iterations}, {repeats})"
    )
    child = subprocess.run(
        [sys.executable, "-c", program], env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(child.stdout.splitlines()[-1])


def print_rows(count: int, planner: str, scenes: int, iterations: int, repeats: int) -> None:
    """What a process of its own does: measures on so many devices, and prints the rows as JSON."""
    devices = use_devices(count)
    rows = [
        _planning(devices, planner, scenes, repeats),
        *(_training(devices, iterations, repeats) if iterations else []),
    ]
    print(json.dumps([row | {"devices": count} for row in rows]))


def _training(devices: Devices, iterations: int, repeats: int) -> list[Row]:
    """Both learners of the paper, with the default preset's batches; the shipped base poses under the second one."""
    sac = SacConfig(iterations_per_interval=iterations, evaluation_problems=devices.count)
    reinforce = ReinforceConfig(
        updates_per_interval=iterations, test_episodes=2 * devices.count, evaluation_scenes=devices.count
    )
    training = Training(TrainConfig(sac=sac, reinforce=reinforce), devices=devices)
    base_pose = load_policies(None, training.robot.name).base_pose
    learners: tuple[tuple[str, Any, int], ...] = (
        ("SAC", training.sac, sac.episodes_per_iteration),
        ("REINFORCE", training.reinforce(base_pose), reinforce.episodes_per_update),
    )
    rows = []
    for what, learner, batch in learners:
        state = jax.jit(learner.init)(jax.random.key(0))
        timing, _ = measure_steps(learner.interval, state, repeats=repeats)
        rows.append(speed(what, "episodes/s", batch * iterations, timing, batch=batch))
    return rows


def _planning(devices: Devices, name: str, count: int, repeats: int) -> Row:
    scenes = sample_scenes(jax.random.key(0), count=count, objects=OBJECTS)
    planner: Any = make_planner(name, PlannerSetup(), make_options(name, {"devices": devices.count}))

    def run() -> None:
        jax.block_until_ready(planner.plan_batch(scenes, jax.random.key(1)))

    return speed(f"plan_batch with {name}", "scenes/s", count, measure_plain(run, repeats=repeats), batch=count)


if __name__ == "__main__":
    main()
