"""What a robot does beside what the judge costs: exported plans take a little longer, and descents are a little bent.

The judge's arm moves last as long as their slowest joint needs. Exported ones are straight lines in joint space, within
all limits at once, and smoothed; so they take longer. A descent is one such line from pre-grasp to grasp, so that the
tool leaves the straight line between them: departures are the largest distances to it in one descent.
"""

import sys
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.table import Table

import basenet_jax as bn
from basenet_jax.config import ExportConfig
from basenet_jax.robot.reading import DEFAULT_ROBOT
from basenet_jax.task.motion import Doing, Motion, plan_motion
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse

NAME = "exported_moves"
_POINTS = 41  # of each descent


@dataclass(frozen=True)
class MoveOptions(Options):
    """Options, and what is planned; nothing is timed, so repeats don't matter."""

    scenes: int = 50
    """Random scenes for each robot."""
    objects: int = 10
    """In a scene."""
    robots: tuple[str, ...] = ("ur5e_mobile", "ur10e_mobile", "panda_mobile")
    """Packaged ones; the default robot is planned for by basenet, others by greedy-stops."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(MoveOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    scenes, objects = (2, QUICK_OBJECTS) if options.quick else (options.scenes, options.objects)
    robots = options.robots[:1] if options.quick else options.robots
    rows = [_measure(name, scenes, objects, options.seed) for name in robots]
    return report.finish(rows, table=_table(rows))


def _measure(name: str, scenes: int, objects: int, seed: int) -> dict[str, Any]:
    robot, smoothing = bn.load_robot(name), ExportConfig().smoothing_s
    planner = "basenet" if name == DEFAULT_ROBOT else "greedy-stops"
    kinematics = jax.jit(jax.vmap(bn.forward_kinematics, (None, 0)))
    judged, exact, smoothed, departures = [], [], [], []
    for key in jax.random.split(jax.random.key(seed), scenes):
        scene = bn.sample_scene(key, objects=objects, robot=name)
        plan = bn.make_plan(scene, planner=planner)
        outcome = bn.execute(scene, plan)
        motion = plan_motion(robot, scene.arrays, plan, outcome)
        judged.append(float(outcome.execution))
        exact.append(float(motion.time[-1]))
        longer = plan_motion(robot, scene.arrays, plan, outcome, smoothing_s=smoothing)
        smoothed.append(float(longer.time[-1]))
        departures += _departures(robot, motion, kinematics)
    return {
        "what": name,
        "planner": planner,
        "plans": scenes,
        "picks": len(departures),
        "judged_s": float(np.mean(judged)),
        "longer_s": float(np.mean(np.subtract(exact, judged))),
        "longer_smoothed_s": float(np.mean(np.subtract(smoothed, judged))),
        "departure_median_mm": 1e3 * float(np.median(departures)),
        "departure_most_mm": 1e3 * float(np.max(departures)),
    }


def _departures(robot: bn.Robot, motion: Motion, kinematics) -> list[float]:
    """Of each descent: the tool's largest distance (m) to the line between its ends."""
    found = []
    for key, part in enumerate(motion.parts):
        if part.doing is Doing.DESCEND:
            joints = np.linspace(motion.joints[key], motion.joints[key + 1], _POINTS)
            position = np.asarray(kinematics(robot, jnp.asarray(joints, jnp.float32))[0], float)
            way = position - position[0]
            along = way[-1] / np.linalg.norm(way[-1])
            found.append(float(np.linalg.norm(way - np.outer(way @ along, along), axis=1).max()))
    return found


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="Exported plans beside the judge's: means per plan, and departures of descents")
    for column in ("robot", "planner", "N + G (s)", "longer (s)", "smoothed (s)", "median (mm)", "most (mm)"):
        table.add_column(column, justify="left" if column in ("robot", "planner") else "right")
    for row in rows:
        figures = (f"{row['judged_s']:.1f}", f"{row['longer_s']:.2f}", f"{row['longer_smoothed_s']:.2f}")
        departures = (f"{row['departure_median_mm']:.1f}", f"{row['departure_most_mm']:.1f}")
        table.add_row(row["what"], row["planner"], *figures, *departures)
    return table


if __name__ == "__main__":
    main()
