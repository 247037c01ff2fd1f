"""Navigation times per second: every pose with every other, beside as many pairs element by element.

Poses are collision-free, drawn as the robot's in the base-pose training. The outer product (1000 x 1000) is what
planners ask for, where a part of the work is shared by a row or a column; the element-wise batch is what training and
execution ask for.
"""

import sys
from typing import Any

import jax
import numpy as np
from jax import Array

from basenet_jax.config import WorldConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.navigation import navigation_time
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_problem
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.timing import measure, speed

NAME = "navigation"
POSES, QUICK_POSES = 1_000, 16
BATCHES, QUICK_BATCHES = (1_024, 16_384, 65_536, 1_000_000), (64,)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    robot: Robot = jax.device_put(load_robot())
    start_key, goal_key = jax.random.split(jax.random.key(options.seed))
    poses = QUICK_POSES if options.quick else POSES
    start, goal = (_draw_poses(key, robot, poses) for key in (start_key, goal_key))
    results = [_measure(robot, f"outer product {poses} x {poses}", start[:, None], goal[None], options.repeats)]
    for batch in QUICK_BATCHES if options.quick else BATCHES:
        start, goal = (_draw_poses(key, robot, batch) for key in (start_key, goal_key))
        results.append(_measure(robot, "element by element", start, goal, options.repeats))
    return report.finish(results, table=speed_table("Navigation times", results, "pairs", "reachable_share"))


def _draw_poses(key: Array, robot: Robot, count: int) -> Array:
    world = WorldConfig()
    room = Room.from_config(world.table)
    draw = jax.jit(jax.vmap(lambda key: draw_problem(key, robot, room, config=world.scene)[1]))
    return draw(jax.random.split(key, count))


def _measure(robot: Robot, what: str, start: Array, goal: Array, repeats: int) -> dict[str, Any]:
    world = WorldConfig()
    room = Room.from_config(world.table)

    def drive(start: Array, goal: Array) -> Array:
        return navigation_time(robot, start, goal, room, world.navigation)

    timing = measure(drive, [(start, goal)], repeats=repeats)
    times = np.asarray(jax.jit(drive)(start, goal))
    reachable = float(np.mean(np.isfinite(times)))
    return speed(what, "pairs/s", times.size, timing, pairs=times.size, reachable_share=reachable)


if __name__ == "__main__":
    main()
