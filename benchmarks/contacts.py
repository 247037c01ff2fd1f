"""Contact-checked robot states per second: our kernels beside MuJoCo in C and MJX.

A check answers for one state, a base pose and the arm's joints, whether the base touches the grown table (rule 1) or
the arm touches the table or the body (rule 4): forward kinematics, then 17 pairs of shapes. All get the same states:
base poses near a grasp and clear of the table, joints uniform within the limits. MuJoCo's model declares just these
pairs; its loop is Python calling `mj_kinematics` and `mj_collision`, once on one core and once with the states dealt
to as many threads as there are cores (MuJoCo lets go of Python's lock, the rest of the loop doesn't). MJX runs its
kinematics and collisions under jit and vmap. Kernels and MJX compute in float32 on all cores, MuJoCo in float64.
`agree` is the share of states with MuJoCo's verdict.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.config import PickConfig, WorldConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import arm_collides, base_collides
from basenet_jax.world.mujoco_scene import build_model, state_addresses
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.pairs import draw_populations
from benchmarks.scaling_picture import draw_scaling, rate_points
from benchmarks.timing import Timing, compare, measure, measure_plain, speed

NAME = "contacts"
BATCHES, QUICK_BATCHES = (1, 64, 1_024, 16_384, 65_536), (16_384,)
IN_A_LOOP, QUICK_IN_A_LOOP = 16_384, 1_024  # states for MuJoCo in C
MOST_CALLS = 16  # of kernels in one run
BY_MJX, QUICK_BY_MJX = 4_096, 64

Row = dict[str, Any]
States = Float[np.ndarray, "B state"]  # base pose (x, y, heading in W), then joints
Touches = Callable[[States], Bool[np.ndarray, " B"]]


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    robot, room = load_robot(), Room.from_config(WorldConfig().table)
    batches = QUICK_BATCHES if options.quick else BATCHES
    in_loop, by_mjx = (QUICK_IN_A_LOOP, QUICK_BY_MJX) if options.quick else (IN_A_LOOP, BY_MJX)
    states = draw_states(robot, max(*batches, in_loop), options.seed)
    verdicts = mujoco_checks(robot, room)(states[:in_loop])
    kernels = [_kernels(robot, room, states, batch, verdicts, options.repeats) for batch in batches]
    others = [
        *_mujoco(robot, room, states[:in_loop], verdicts, options.repeats),
        _mjx(robot, room, states[:by_mjx], verdicts, options.repeats),
    ]
    results = [*kernels, *others]
    return report.finish(
        results,
        table=speed_table("Contact-checked states", results, "batch", "touching_share", "agree"),
        comparisons=[compare(kernels[-1], row, at=f"{batches[-1]:,}") for row in others],
        picture=draw_scaling(
            "Contact-checked states",
            {"kernels": rate_points(kernels, "batch")} | {row["what"]: rate_points([row], "batch") for row in others},
            size="batch",
            value="states per second",
        ),
    )


def draw_states(robot: Robot, count: int, seed: int) -> States:
    """Base poses near a grasp and clear of the table, with joints uniform within the limits."""
    lower, upper = np.asarray(robot.joint_lower), np.asarray(robot.joint_upper)
    joints = np.random.default_rng(seed).uniform(lower, upper, (count, robot.dof))
    return np.concatenate([draw_populations(robot, seed, count).clear.base_pose, joints], axis=1)


def kernel_checks(robot: Robot, room: Room) -> Callable[[Array], Array]:
    """Our kernels, as a function to be jitted."""
    config = PickConfig()

    def touches(states: Array) -> Array:
        base_pose, joints = states[:, :3], states[:, 3:]
        base = base_collides(robot, base_pose, room, config.base_clearance_m, config.touching_m)
        return base | arm_collides(robot, base_pose, joints, room)

    return touches


def mujoco_checks(robot: Robot, room: Room) -> Touches:
    """MuJoCo in C, one state after another; makes data of its own."""
    model = build_model(robot, room)
    data, addresses = mujoco.MjData(model), state_addresses(robot, model)

    def touches(states: States) -> Bool[np.ndarray, " B"]:
        verdict, positions = np.zeros(len(states), bool), np.zeros((len(states), model.nq))
        positions[:, addresses] = states
        qpos = data.qpos
        for index, position in enumerate(positions):
            qpos[:] = position
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            if data.ncon:
                verdict[index] = data.contact.dist.min() <= 0.0
        return verdict

    return touches


def mjx_checks(robot: Robot, room: Room) -> Callable[[Array], Array]:
    """MJX, as a function to be jitted."""
    from basenet_jax.world.mjx import MjxScene  # slow to import

    scene = MjxScene.create(robot, room, slots=0)

    def touches(state: Array) -> Array:
        data = scene.move(scene.blank, state[:3], state[3:])
        return scene.base_touches(data) | scene.arm_touches(data)

    return jax.vmap(touches)


def _kernels(robot: Robot, room: Room, states: States, batch: int, verdicts: np.ndarray, repeats: int) -> Row:
    """Small batches are called several times in a run, with other states each time."""
    check, calls = kernel_checks(robot, room), max(1, min(MOST_CALLS, len(states) // batch))
    parts = [jnp.asarray(states[i * batch : (i + 1) * batch]) for i in range(calls)]
    timing = measure(check, [(part,) for part in parts], repeats=repeats)
    return _row("kernels", timing, np.concatenate([jax.jit(check)(part) for part in parts]), verdicts, batch=batch)


def _mjx(robot: Robot, room: Room, states: States, verdicts: np.ndarray, repeats: int) -> Row:
    check, batch = mjx_checks(robot, room), jnp.asarray(states)
    return _row("MJX", measure(check, [(batch,)], repeats=repeats), np.asarray(jax.jit(check)(batch)), verdicts)


def _mujoco(robot: Robot, room: Room, states: States, verdicts: np.ndarray, repeats: int) -> list[Row]:
    check, threads = mujoco_checks(robot, room), os.cpu_count() or 1
    one = measure_plain(lambda: check(states), repeats=repeats)
    rows = [_row("MuJoCo C, 1 core", one, check(states), verdicts)]
    parts, checks = np.array_split(states, threads), [mujoco_checks(robot, room) for _ in range(threads)]
    with ThreadPoolExecutor(threads) as pool:

        def check_all() -> np.ndarray:
            return np.concatenate(list(pool.map(lambda check, part: check(part), checks, parts)))

        several = measure_plain(check_all, repeats=repeats)
        rows.append(_row(f"MuJoCo C, {threads} threads", several, check_all(), verdicts))
    return rows


def _row(
    what: str,
    timing: Timing,
    touching: Bool[np.ndarray, " B"],
    verdicts: Bool[np.ndarray, " V"],
    batch: int | None = None,
) -> Row:
    """Of all the states of a run; the batch is what one call gets."""
    both = min(len(touching), len(verdicts))
    facts = {
        "batch": batch or len(touching),
        "touching_share": float(touching.mean()),
        "agree": float(np.mean(touching[:both] == verdicts[:both])),
    }
    return speed(what, "states/s", len(touching), timing, **facts)


if __name__ == "__main__":
    main()
