"""Picks of an arm without a closed form: evaluations per second, and whether the lattice of seeds finds what there is.

An evaluation is all of `task.picking.pick`, with damped least squares from a lattice of seeds instead of branches.
Pairs of base pose and grasp are *mixed*: any whose base is clear of the table and whose grasp the arm might reach. The
lattice is judged by a search of another kind on the same pairs: random restarts, each from joints uniform within the
limits and all solved to convergence, for so many seconds. *Found* is the share of the pairs feasible by either that the
lattice calls feasible.
"""

import dataclasses
import sys
import time
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from basenet_jax.config import PickConfig, WorldConfig
from basenet_jax.planners.candidates import within_reach
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Pick, pick
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import base_collides
from basenet_jax.world.generate import draw_problem
from basenet_jax.world.grasps import top_down
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.pairs import RADIUS_M, Pairs
from benchmarks.timing import measure, speed

NAME = "any_robot"
_DRAWN_AT_ONCE = 16_384


@dataclass(frozen=True)
class AnyRobotOptions(Options):
    """Options of this script."""

    robot: str = "panda_mobile"
    """A packaged robot's name, or the path of a robot file."""
    batch: int = 1_024
    """Pairs evaluated at once."""
    search_s: float = 30.0
    """How long the random restarts go on."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(AnyRobotOptions, NAME, __doc__, arguments)
    if options.quick:
        options = dataclasses.replace(options, batch=32, search_s=0.0)
    report = Report(NAME, options, arguments)
    robot: Robot = jax.device_put(load_robot(options.robot))
    world = WorldConfig()
    room = Room.from_config(world.table)
    pairs = _draw_pairs(robot, room, options.batch, options.seed, world)
    base_pose, grasp = (jax.device_put(part) for part in pairs)

    def evaluate(base_pose: Array, grasp: Array) -> Pick:
        return pick(robot, base_pose, top_down(grasp), room, world.pick)

    timing = measure(evaluate, [(base_pose, grasp)], repeats=options.repeats)
    found = np.asarray(jax.jit(evaluate)(base_pose, grasp).feasible)
    restarts, by_restarts = _random_restarts(robot, room, base_pose, grasp, world.pick, options)
    either = found | by_restarts
    facts = {
        "robot": robot.name,
        "batch": options.batch,
        "feasible_share": float(np.mean(found)),
        "found_of_either": float(np.mean(found[either])) if either.any() else None,
        "found_by_restarts": float(np.mean(by_restarts[either])) if either.any() else None,
    }
    results = [speed("pick", "picks/s", options.batch, timing, **facts)]
    columns = ("robot", "batch", "feasible_share", "found_of_either", "found_by_restarts")
    return report.finish(
        results,
        table=speed_table("Picks without a closed form", results, *columns),
        restarts=restarts,
        feasible_by_either=int(either.sum()),
        pick_config=dataclasses.asdict(world.pick),
    )


def _draw_pairs(robot: Robot, room: Room, count: int, seed: int, world: WorldConfig) -> Pairs:
    """Grasps of the five classes, and base poses about them that are clear of the table and not plainly too far."""
    rng = np.random.default_rng(seed)
    draw = jax.jit(jax.vmap(lambda key: draw_problem(key, robot, room, config=world.scene)[0]))
    usable = jax.jit(
        lambda pose, grasp: (
            ~base_collides(robot, pose, room, world.pick.base_clearance_m, world.pick.touching_m)
            & within_reach(robot, pose, grasp[..., :3])
        )
    )
    parts: list[np.ndarray] = []
    while sum(map(len, parts)) < count:
        seed += 1
        grasp = np.asarray(draw(jax.random.split(jax.random.key(seed), _DRAWN_AT_ONCE)))
        distance, bearing = RADIUS_M * np.sqrt(rng.uniform(size=len(grasp))), rng.uniform(-np.pi, np.pi, len(grasp))
        offset = distance[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        pose = np.column_stack([grasp[:, :2] + offset, rng.uniform(-np.pi, np.pi, len(grasp))]).astype(np.float32)
        parts.append(np.column_stack([pose, grasp])[np.asarray(usable(pose, grasp))])
    both = np.concatenate(parts)[:count]
    return Pairs(both[:, :3], both[:, 3:])


def _random_restarts(
    robot: Robot, room: Room, base_pose: Array, grasp: Array, config: PickConfig, options: AnyRobotOptions
) -> tuple[int, np.ndarray]:
    """How many rounds of restarts there were, and which pairs were feasible in one of them."""
    seeds = 16  # of each pair in a round
    config = dataclasses.replace(
        config,
        lattice_kept=seeds,
        lattice_first_iterations=0,
        lattice_iterations=60,
        lattice_descent_iterations=10,
    )

    @jax.jit
    def restart(key: Array) -> Array:
        lower, upper = jnp.asarray(robot.joint_lower), jnp.asarray(robot.joint_upper)
        joints = lower + jax.random.uniform(key, (seeds, robot.dof)) * (upper - lower)
        return pick(robot, base_pose, top_down(grasp), room, config, seeds=joints).feasible

    key = jax.random.key(options.seed)
    found = np.array(restart(key))
    rounds, begin = 1, time.monotonic()
    while time.monotonic() - begin < options.search_s:
        found |= np.asarray(restart(jax.random.fold_in(key, rounds)))
        rounds += 1
    return rounds * seeds, found


if __name__ == "__main__":
    main()
