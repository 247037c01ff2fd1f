"""Picks by many grasps among neighbours, inverse kinematics among obstacles, and picks of seven joints, per second.

- `collision_free_ik`: a UR5e, 12 boxes, another base for each grasp.
- `pick`, 16 grasps: each object can be held in 16 ways from above and all sides; nine other objects stand about it, and
  the arm must not touch itself nor come near singular poses.
- `ways_to_pick`: the same pairs, with what must be gone first, for planning.
- `pick`, seven joints: a Panda's arm, one top-down grasp, in closed form and (fewer) from a lattice of seeds.

Base poses are uniform beside the table within reach of the grasp, at any heading, clear of the table: `mixed`.
"""

import dataclasses
import sys
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from basenet_jax.config import PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.free_ik import collision_free_ik
from basenet_jax.task.picking import pick, ways_to_pick
from basenet_jax.world.boxes import Boxes, Room
from basenet_jax.world.grasps import Grasps, from_the_side, of_class, of_objects, padded, together, top_down
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.timing import measure, speed

NAME = "grasps"
BATCH, QUICK_BATCH = 65_536, 64
PAIRS, QUICK_PAIRS = 8_192, 32
BY_SEEDS, QUICK_BY_SEEDS = 512, 8
BOXES, NEIGHBOURS, WAYS = 12, 9, 3
CLUTTER = PickConfig(object_in_the_way="on", arm_hits_itself="on", near_singular="on")

Row = dict[str, Any]


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    rng, repeats = np.random.default_rng(options.seed), options.repeats
    ur5e, panda = (jax.device_put(load_robot(name)) for name in ("ur5e_mobile", "panda_mobile"))
    batch, pairs, few = (QUICK_BATCH, QUICK_PAIRS, QUICK_BY_SEEDS) if options.quick else (BATCH, PAIRS, BY_SEEDS)
    results = [
        _free_ik(ur5e, rng, batch, repeats),
        *_many_grasps(ur5e, rng, pairs, repeats),
        _top_down("pick, Panda, closed form", panda, rng, pairs, repeats),
        _top_down("pick, Panda, lattice of seeds", panda.replace(closed_form=None), rng, few, repeats),
    ]
    return report.finish(results, table=speed_table("Grasps", results, "batch", "found_share"))


def _free_ik(robot: Robot, rng: np.random.Generator, batch: int, repeats: int) -> Row:
    base, grasp = _beside_the_table(rng, batch)
    boxes = _obstacles(rng)
    arrays = (jnp.asarray(base), jax.device_put(top_down(grasp, np)))

    def solve(base: jax.Array, grasps: Grasps) -> jax.Array:
        return collision_free_ik(robot, boxes, base, grasps).found

    return _row(f"collision_free_ik, {BOXES} boxes", solve, arrays, batch, repeats)


def _many_grasps(robot: Robot, rng: np.random.Generator, pairs: int, repeats: int) -> list[Row]:
    room = Room.from_config()
    base, grasp = _beside_the_table(rng, pairs)
    above, level = of_class(np.zeros(3, np.float32), np), from_the_side(15, 0.25)
    above = dataclasses.replace(above, pose=above.pose + np.array([0, 0, 0.3, 0, 0, 0], np.float32))
    own = of_objects([padded(together([above, level]), 16)])[0]
    pose = np.tile(own.pose, (pairs, 1, 1))
    sine, cosine = np.sin(grasp[:, 3, None]), np.cos(grasp[:, 3, None])
    x, y = pose[..., 0].copy(), pose[..., 1].copy()
    pose[..., 0], pose[..., 1] = grasp[:, :1] + cosine * x - sine * y, grasp[:, 1:2] + sine * x + cosine * y
    pose[..., 2] += 0.75 + 0.12
    pose[..., 5] += grasp[:, 3, None]
    many = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (pairs, *leaf.shape)), own)
    grasps = jax.device_put(dataclasses.replace(many, pose=pose))
    neighbours = jax.device_put(_neighbours(rng, grasp))
    arrays = (jnp.asarray(base), grasps, neighbours)

    def picks(base: jax.Array, grasps: Grasps, neighbours: Boxes) -> jax.Array:
        return pick(robot, base, grasps, room, CLUTTER, neighbours=neighbours).feasible

    def ways(base: jax.Array, grasps: Grasps, neighbours: Boxes) -> jax.Array:
        found = ways_to_pick(robot, base, grasps, room, neighbours, CLUTTER, ways=WAYS)
        return jnp.isfinite(found.time[..., 0])

    return [
        _row(f"pick, 16 grasps, {NEIGHBOURS} neighbours", picks, arrays, pairs, repeats),
        _row(f"ways_to_pick, 16 grasps, {NEIGHBOURS} neighbours", ways, arrays, pairs, repeats),
    ]


def _top_down(what: str, robot: Robot, rng: np.random.Generator, pairs: int, repeats: int) -> Row:
    room = Room.from_config()
    base, grasp = _beside_the_table(rng, pairs)

    def picks(base: jax.Array, grasps: Grasps) -> jax.Array:
        return pick(robot, base, grasps, room).feasible

    return _row(what, picks, (jnp.asarray(base), jax.device_put(top_down(grasp, np))), pairs, repeats)


def _row(what: str, function: Callable[..., jax.Array], arrays: tuple, batch: int, repeats: int) -> Row:
    timing = measure(function, [arrays], repeats=repeats)
    share = float(np.mean(np.asarray(jax.jit(function)(*arrays))))
    return speed(what, "per second", batch, timing, batch=batch, found_share=share)


def _beside_the_table(
    rng: np.random.Generator, count: int
) -> tuple[Float[np.ndarray, "B 3"], Float[np.ndarray, "B 4"]]:
    """Base poses along the table's long sides and top-down grasps (x, y, z, yaw) on it, less than 1.1 m apart."""
    base, grasp = np.zeros((0, 3)), np.zeros((0, 4))
    while len(base) < count:
        poses = rng.uniform([-1.2, 0.76, -np.pi], [1.2, 1.1, np.pi], (4 * count, 3))
        poses[:, 1] *= rng.choice([-1.0, 1.0], 4 * count)
        goals = rng.uniform([-0.9, -0.35, 1.05, -np.pi], [0.9, 0.35, 1.2, np.pi], (4 * count, 4))
        near = np.hypot(*(poses[:, :2] - goals[:, :2]).T) < 1.1
        base, grasp = np.concatenate([base, poses[near]]), np.concatenate([grasp, goals[near]])
    return base[:count].astype(np.float32), grasp[:count].astype(np.float32)


def _obstacles(rng: np.random.Generator) -> Boxes:
    """The table, and pillars and boards about it."""
    places = rng.uniform([-1.5, -1.5, -np.pi], [1.5, 1.5, np.pi], (BOXES, 3))
    half, low = rng.uniform(0.05, 0.2, (BOXES, 2)), rng.choice([0.0, 1.4], BOXES)
    places[0], half[0], low[0] = 0.0, (1.0, 0.4), 0.0
    return _boxes(places, half, low, np.where(np.arange(BOXES) == 0, 0.75, low + 0.3))


def _neighbours(rng: np.random.Generator, grasp: Float[np.ndarray, "B 4"]) -> Boxes:
    """Bottles and boxes on the table about each object, 8 cm and more from its centre."""
    count = (len(grasp), NEIGHBOURS)
    bearing, distance = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.08, 0.5, count)
    x, y = grasp[:, :1] + distance * np.cos(bearing), grasp[:, 1:2] + distance * np.sin(bearing)
    places = np.stack([x, y, rng.uniform(-np.pi, np.pi, count)], axis=-1)
    return _boxes(places, rng.uniform(0.02, 0.05, (*count, 2)), np.full(count, 0.75), rng.uniform(0.83, 1.0, count))


def _boxes(pose: np.ndarray, half: np.ndarray, low: np.ndarray, high: np.ndarray) -> Boxes:
    there = np.ones(low.shape, bool)
    single = (x.astype(np.float32) for x in (pose, half, low, high))
    leaves: tuple[Any, ...] = (*single, there, there, there)
    return Boxes(*leaves)


if __name__ == "__main__":
    main()
