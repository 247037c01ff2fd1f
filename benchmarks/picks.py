"""Full pick evaluations per second, by batch size, on easy and on hard pairs of base pose and grasp.

An evaluation is all of `task.picking.pick`: both grasp yaws, all branches, refinement by damped least squares, arm
clearance of every waypoint and swept point, durations. *Mixed* pairs are any whose base is clear of the table: most
are rejected early. *Feasible* pairs are the dearest: each goes through the whole check. Both are compared at equal
batch sizes; small batches are called many times in one run, with other pairs each time.
"""

import sys
from typing import Any

import jax
import numpy as np

from basenet_jax.config import WorldConfig
from basenet_jax.learning.config import SacConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Pick, pick
from basenet_jax.world.scene import Table
from benchmarks.harness import Options, Report, measure, parse, speed, speed_table
from benchmarks.pairs import RADIUS_M, Pairs, draw_populations

NAME = "picks"
BATCHES = (1, 64, 1_024, 16_384, 65_536)
QUICK_BATCHES = (1, 64)
CALLED_AT_LEAST = 1_024  # pairs in one run, by repeated calls of small batches
MOST_CALLS = 64


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    robot: Robot = jax.device_put(load_robot())
    batches = QUICK_BATCHES if options.quick else BATCHES
    populations = draw_populations(robot, options.seed, max(max(batches), CALLED_AT_LEAST))
    kinds = {"mixed": populations.clear, "feasible": populations.feasible}
    results = [_measure(robot, kind, kinds[kind], batch, options) for kind in kinds for batch in batches]
    return report.finish(
        results,
        table=speed_table("Full pick evaluations", results, "population", "batch", "feasible_share"),
        population={
            "grasps": f"base-pose training's ({SacConfig().own_class_share:.0%} with random size and grasp)",
            "base_poses": f"uniform within {RADIUS_M} m of the grasp, any heading",
            "clear_share_of_drawn": populations.clear_share,
            "feasible_share_of_clear": populations.feasible_share,
        },
    )


def _measure(robot: Robot, kind: str, pairs: Pairs, batch: int, options: Options) -> dict[str, Any]:
    world = WorldConfig()
    table = Table.from_config(world.table)

    def evaluate(base_pose: jax.Array, grasp: jax.Array) -> Pick:
        return pick(robot, base_pose, grasp, table, world.pick)

    count = max(1, min(MOST_CALLS, CALLED_AT_LEAST // batch))
    calls = [tuple(jax.device_put(x[i * batch : (i + 1) * batch]) for x in pairs) for i in range(count)]
    timing = measure(evaluate, calls, repeats=options.repeats)
    check = jax.jit(evaluate)
    share = float(np.mean([np.mean(check(*arguments).feasible) for arguments in calls]))
    facts = {"population": kind, "batch": batch, "calls_per_run": count, "feasible_share": share}
    return speed("pick", "picks/s", batch * count, timing, **facts)


if __name__ == "__main__":
    main()
