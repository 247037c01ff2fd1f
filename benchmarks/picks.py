"""Full pick evaluations per second, by batch size, beside bare inverse kinematics by EAIK.

An evaluation is all of `task.picking.pick`: both grasp yaws, all branches, refinement by damped least squares, arm
clearance of every waypoint and swept point, durations. *Mixed* pairs are any whose base is clear of the table: most
are rejected early. *Feasible* pairs are the dearest: each goes through the whole check. Both are compared at equal
batch sizes; small batches are called many times in one run, with other pairs each time. EAIK solves one tool pose of
each of the same feasible pairs, at the grasp, on one core and without limits, collisions or times: what a pick needs
first, and at least four times (two heights, two yaws).
"""

import sys
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from basenet_jax.config import WorldConfig
from basenet_jax.learning.config import SacConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Pick, pick
from basenet_jax.world.boxes import Room
from basenet_jax.world.grasps import top_down
from benchmarks import peer_arms
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.pairs import RADIUS_M, Pairs, draw_populations
from benchmarks.peers import installed
from benchmarks.scaling_picture import draw_scaling, rate_points
from benchmarks.timing import compare, measure, measure_plain, speed

NAME = "picks"
BATCHES = (1, 64, 1_024, 16_384, 65_536)
QUICK_BATCHES = (1_024,)
CALLED_AT_LEAST = 1_024  # pairs in one run, by repeated calls of small batches
MOST_CALLS = 64


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    robot = load_robot()
    batches = QUICK_BATCHES if options.quick else BATCHES
    populations = draw_populations(robot, options.seed, max(max(batches), CALLED_AT_LEAST))
    kinds = {"mixed": populations.clear, "feasible": populations.feasible}
    rows = {
        kind: [_measure(jax.device_put(robot), kind, pairs, batch, options) for batch in batches]
        for kind, pairs in kinds.items()
    }
    by_eaik = _eaik(robot, populations.feasible, batches, options)
    results = [*(row for kind in kinds for row in rows[kind]), *by_eaik]
    series = {f"picks, {kind}": rows[kind] for kind in kinds} | ({"EAIK, bare IK": by_eaik} if by_eaik else {})
    return report.finish(
        results,
        table=speed_table("Full pick evaluations", results, "population", "batch", "feasible_share"),
        comparisons=[
            compare(ours, theirs, at=f"{ours['batch']:,} {kind}")
            for kind in kinds
            for ours, theirs in zip(rows[kind], by_eaik, strict=False)
        ],
        picture=draw_scaling(
            "Full pick evaluations beside bare inverse kinematics",
            {name: rate_points(each, "batch") for name, each in series.items()},
            size="batch",
            value="per second",
        ),
        population={
            "grasps": f"base-pose training's ({SacConfig().own_class_share:.0%} with random size and grasp)",
            "base_poses": f"uniform within {RADIUS_M} m of the grasp, any heading",
            "clear_share_of_drawn": populations.clear_share,
            "feasible_share_of_clear": populations.feasible_share,
        },
    )


def _measure(robot: Robot, kind: str, pairs: Pairs, batch: int, options: Options) -> dict[str, Any]:
    world = WorldConfig()
    room = Room.from_config(world.table)

    def evaluate(base_pose: jax.Array, grasp: jax.Array) -> Pick:
        return pick(robot, base_pose, top_down(grasp), room, world.pick)

    calls = [tuple(map(jax.device_put, part)) for part in _parts(pairs, batch)]
    timing = measure(evaluate, calls, repeats=options.repeats)
    check = jax.jit(evaluate)
    share = float(np.mean([np.mean(check(*arguments).feasible) for arguments in calls]))
    facts = {"population": kind, "batch": batch, "calls_per_run": len(calls), "feasible_share": share}
    return speed("pick", "picks/s", batch * len(calls), timing, **facts)


def _eaik(robot: Robot, pairs: Pairs, batches: Sequence[int], options: Options) -> list[dict[str, Any]]:
    if not installed("eaik", asked_by=NAME):
        return []
    arm, rows = peer_arms.eaik_arm(robot), []
    for batch in batches:
        calls = [peer_arms.grasp_poses(robot, *part) for part in _parts(pairs, batch)]

        def solve(calls: list[peer_arms.Poses] = calls) -> None:
            for poses in calls:
                peer_arms.solve_by_eaik(arm, poses)

        timing = measure_plain(solve, repeats=options.repeats)
        facts = {"population": "feasible", "batch": batch, "calls_per_run": len(calls)}
        rows.append(speed("EAIK, 1 thread", "poses/s", batch * len(calls), timing, **facts))
    return rows


def _parts(pairs: Pairs, batch: int) -> list[tuple[np.ndarray, ...]]:
    """What the calls of one run get."""
    count = max(1, min(MOST_CALLS, CALLED_AT_LEAST // batch))
    return [tuple(x[i * batch : (i + 1) * batch] for x in pairs) for i in range(count)]


if __name__ == "__main__":
    main()
