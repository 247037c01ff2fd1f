"""Maps of grasps of any orientation: how large they are, how long they take to build, and how often they are right.

Tools are uniform in the sphere that the arm can't leave, above the floor, and turned in any way; base poses are turned
in any way too. Right is what the arm alone reaches: the closed form's solutions within the limits of all joints, of
seven joints with 64 angles of the last. A UR5e is also mapped as an arm without a closed form is, from joint vectors.
"""

import dataclasses
import sys
import time
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float
from rich.table import Table
from scipy.spatial.transform import Rotation

from basenet_jax import rounds
from basenet_jax.config import PickConfig
from basenet_jax.planners.grasp_map import GraspMap, is_reached
from basenet_jax.planners.grasp_map_build import build_grasp_map, map_shape
from basenet_jax.robot.kinematics import reach_sphere
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.arm_solutions import Picks, reached
from basenet_jax.world.grasps import Grasps
from benchmarks.harness import Options, Report, parse
from benchmarks.timing import measure_plain

NAME = "grasp_maps"
PAIRS, QUICK_PAIRS = 100_000, 2_000
ANGLES = 64
ROBOTS = ("ur5e_mobile", "ur3e_mobile", "ur10e_mobile", "panda_mobile")

Row = dict[str, Any]


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    pairs, names = (QUICK_PAIRS, ROBOTS[:1]) if options.quick else (PAIRS, ROBOTS)
    rows = [_row(name, load_robot(name), closed_form=True, pairs=pairs, options=options) for name in names]
    rows.append(_row(names[0], load_robot(names[0]), closed_form=False, pairs=pairs, options=options))
    return report.finish(rows, table=_table(rows))


def _row(name: str, robot: Robot, *, closed_form: bool, pairs: int, options: Options) -> Row:
    own = robot if closed_form else dataclasses.replace(robot, closed_form=None)
    shape = map_shape(own)
    if options.quick:
        shape = shape._replace(heights=2, lowest=round(1.0 / shape.step_m))
    begin = time.perf_counter()
    grasp_map = build_grasp_map(own, shape=shape)
    first = time.perf_counter() - begin
    timing = measure_plain(lambda: build_grasp_map(own, shape=shape), repeats=options.repeats)
    found, truth = _judged(robot, grasp_map, np.random.default_rng(options.seed), pairs)
    return {
        "what": name if closed_form else f"{name}, from joint vectors",
        "shape": shape._asdict(),
        "bins": shape.total,
        "megabytes": grasp_map.bits.nbytes / 1e6,
        "first_build_s": first,
        **timing.summary(),
        "pairs": len(truth),
        "reached_share": float(np.mean(truth)),
        "right": float(np.mean(found == truth)),
        "true_positive": float(np.mean(found[truth])),
        "false_positive": float(np.mean(found[~truth])),
    }


def _judged(
    robot: Robot, grasp_map: GraspMap, rng: np.random.Generator, pairs: int
) -> tuple[Bool[np.ndarray, " B"], Bool[np.ndarray, " B"]]:
    """What the map says of random pairs, and what the arm reaches."""
    center, radius = (np.asarray(x, float) for x in jax.jit(reach_sphere)(robot))
    center = np.asarray(robot.mount_position) + np.asarray(robot.mount_rotation) @ center
    direction = rng.normal(size=(2 * pairs, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    tool = center + float(radius) * direction * rng.random((2 * pairs, 1)) ** (1 / 3)
    low, step = grasp_map.shape.lowest * grasp_map.shape.step_m, grasp_map.shape.step_m
    high = low + (grasp_map.shape.heights - 1) * step
    tool = tool[(tool[:, 2] > low) & (tool[:, 2] < high)][:pairs]
    base = rng.uniform([-3, -3, -np.pi], [3, 3, np.pi], (len(tool), 3))
    sine, cosine = np.sin(base[:, 2]), np.cos(base[:, 2])
    x, y = base[:, 0] + cosine * tool[:, 0] - sine * tool[:, 1], base[:, 1] + sine * tool[:, 0] + cosine * tool[:, 1]
    rpy = Rotation.random(len(tool), rng).as_euler("ZYX")[:, ::-1]
    pose = jnp.asarray(np.column_stack([x, y, tool[:, 2], rpy]), jnp.float32)
    base = jnp.asarray(base, jnp.float32)
    one = jnp.ones(len(pose), bool)
    found = jax.jit(is_reached)(grasp_map, base, Grasps(pose, jnp.zeros(len(pose)), one, one))
    return np.asarray(found), np.asarray(_reached(robot, base, pose))


@partial(jax.jit, static_argnames="config")
def _reached(
    robot: Robot,
    base: Float[Array, "B 3"],
    pose: Float[Array, "B 6"],
    config: PickConfig = dataclasses.replace(PickConfig(), last_joint_angles=ANGLES),
) -> Bool[Array, " B"]:
    def some(pair: tuple[Array, Array]) -> Array:
        single = jnp.zeros(len(pair[0]), bool)
        picks = Picks(tuple(pair[0].T), tuple(pair[1].T), jnp.zeros(len(pair[0])), single, ~single)
        return reached(robot, picks, config)

    return rounds.in_chunks(some, (base, pose), config.chunk)


def _table(rows: list[Row]) -> Table:
    table = Table(title="Maps of grasps of any orientation")
    for name in ("what", "bins (m)", "MB", "build (s)", "first (s)", "right", "true positive", "false positive"):
        table.add_column(name, justify="left" if name == "what" else "right")
    for row in rows:
        shares = (f"{row[name]:.4f}" for name in ("right", "true_positive", "false_positive"))
        times = f"{row['run_s']['median']:.2f}", f"{row['first_build_s']:.2f}"
        table.add_row(row["what"], f"{row['shape']['step_m']:g}", f"{row['megabytes']:.2f}", *times, *shares)
    return table


if __name__ == "__main__":
    main()
