"""Inverse kinematics: ours beside EAIK and ur-analytic-ik in closed form, and beside mink's iterations.

All get the same poses: of the tool at joints uniform within the limits. A closed-form pose is all eight branches of
one pose; EAIK gets the whole batch in one call, with one thread and with as many as there are cores, ur-analytic-ik
one pose after another. An iteration of ours is forward kinematics, Jacobian and a 6 x 6 solve for one pose;
`solve_ik` does a fixed number of them, plus one forward kinematics for the errors, which is not counted. An
iteration of mink is a quadratic program with the joints' limits; it stops as soon as a pose has converged, and takes
at most as many. Both start from the same joints, drawn likewise, so part of them can't converge. A solve is a pose
that has converged, within 1 mm and 0.5 degrees. Ours computes in float32 on all cores, the others in float64.
"""

import os
import sys
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from basenet_jax.config import PickConfig
from basenet_jax.robot import ur
from basenet_jax.robot.ik import IKSolution, solve_ik
from basenet_jax.robot.kinematics import Frame, components
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from benchmarks import peer_arms
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.peers import installed
from benchmarks.timing import compare, measure, measure_plain, speed

NAME = "inverse_kinematics"
BATCHES = (1_024, 4_096, 16_384, 65_536)
QUICK_BATCHES = (4_096,)
ONE_BY_ONE, QUICK_ONE_BY_ONE = 4_096, 256  # poses for ur-analytic-ik
MINK_POSES, QUICK_MINK_POSES = 200, 10
ITERATIONS = 30
OURS = "closed form"

Row = dict[str, Any]


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    robot = load_robot()
    results, iterated, closed = [], [], {}
    poses = seeds = np.zeros(0)
    for batch in QUICK_BATCHES if options.quick else BATCHES:
        joints_key, seed_key = jax.random.split(jax.random.key(options.seed))
        poses = peer_arms.tool_poses(robot, _draw_joints(joints_key, robot, batch))
        seeds = _draw_joints(seed_key, robot, batch)
        iterated = _damped_least_squares(robot, poses, seeds, options.repeats)
        closed = _closed_forms(robot, poses, options)
        results += [*iterated, *closed.values()]
    by_mink = _mink(robot, poses, seeds, options)
    results += by_mink
    comparisons = [
        *(compare(closed[OURS], row, at=f"{len(poses):,}") for name, row in closed.items() if name != OURS),
        *(compare(ours, theirs) for ours, theirs in zip(iterated, by_mink, strict=False)),
    ]
    table = speed_table("Inverse kinematics", results, "batch", "converged_share")
    return report.finish(
        results,
        table=table,
        comparisons=comparisons,
        iterations_per_pose=ITERATIONS,
        branches_per_pose=ur.BRANCHES,
    )


def _draw_joints(key: Array, robot: Robot, batch: int) -> np.ndarray:
    lower, upper = np.asarray(robot.joint_lower), np.asarray(robot.joint_upper)
    return lower + np.asarray(jax.random.uniform(key, (batch, robot.dof)), float) * (upper - lower)


def _targets(poses: peer_arms.Poses) -> tuple[Array, Array]:
    """Positions and rotations as our kernels take them."""
    return jnp.asarray(poses[:, :3, 3]), jnp.asarray(poses[:, :3, :3])


def _damped_least_squares(robot: Robot, poses: peer_arms.Poses, seeds: np.ndarray, repeats: int) -> list[Row]:
    def solve(position: Array, rotation: Array, seeds: Array) -> IKSolution:
        return solve_ik(robot, position, rotation, seeds, iterations=ITERATIONS)

    batch, arguments = len(seeds), (*_targets(poses), jnp.asarray(seeds))
    timing = measure(solve, [arguments], repeats=repeats)
    converged = np.asarray(jax.jit(solve)(*arguments).converged)
    facts = {"batch": batch, "converged_share": float(converged.mean())}
    what = "damped least squares"
    return [
        speed(what, "iterations/s", batch * ITERATIONS, timing, **facts),
        speed(what, "solves/s", int(converged.sum()), timing, **facts),
    ]


def _mink(robot: Robot, poses: peer_arms.Poses, seeds: np.ndarray, options: Options) -> list[Row]:
    if not installed("mink", asked_by=NAME):
        return []
    batch = QUICK_MINK_POSES if options.quick else MINK_POSES
    solve = peer_arms.mink_solver(
        robot,
        iterations=ITERATIONS,
        position_tolerance_m=PickConfig().position_tolerance_m,
        orientation_tolerance_rad=PickConfig().orientation_tolerance_rad,
    )
    solution = solve(poses[:batch], seeds[:batch])
    timing = measure_plain(lambda: solve(poses[:batch], seeds[:batch]), repeats=options.repeats)
    facts = {"batch": batch, "converged_share": float(solution.converged.mean())}
    return [
        speed("mink", "iterations/s", solution.iterations, timing, **facts),
        speed("mink", "solves/s", int(solution.converged.sum()), timing, **facts),
    ]


def _closed_forms(robot: Robot, poses: peer_arms.Poses, options: Options) -> dict[str, Row]:
    rows = {OURS: _closed_form(robot, poses, options.repeats)}
    if installed("eaik", asked_by=NAME):
        arm = peer_arms.eaik_arm(robot)
        for threads in sorted({1, os.cpu_count() or 1}):
            timing = measure_plain(
                lambda threads=threads: peer_arms.solve_by_eaik(arm, poses, threads), repeats=options.repeats
            )
            what = f"EAIK, {threads} thread{'s' if threads > 1 else ''}"
            rows[what] = speed(what, "poses/s", len(poses), timing, batch=len(poses))
    if installed("ur_analytic_ik", asked_by=NAME):
        some = poses[: QUICK_ONE_BY_ONE if options.quick else ONE_BY_ONE]
        timing = measure_plain(lambda: peer_arms.solve_by_ur_analytic_ik(some), repeats=options.repeats)
        rows["ur-analytic-ik"] = speed("ur-analytic-ik", "poses/s", len(some), timing, batch=len(some))
    return rows


def _closed_form(robot: Robot, poses: peer_arms.Poses, repeats: int) -> Row:
    """A loop over the branches, as the pick check does it."""

    def solve(position: Array, rotation: Array) -> ur.ClosedForm:
        x, y, z = (components(rotation[..., k]) for k in range(3))
        target = Frame(x, y, z, components(position))
        return jax.lax.map(
            lambda branch: ur.closed_form(robot, target, ur.branch_signs(branch)), jnp.arange(ur.BRANCHES)
        )

    batch = len(poses)
    return speed(OURS, "poses/s", batch, measure(solve, [_targets(poses)], repeats=repeats), batch=batch)


if __name__ == "__main__":
    main()
