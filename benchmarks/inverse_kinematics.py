"""Inverse kinematics: damped-least-squares iterations per second beside closed-form poses per second.

An iteration is forward kinematics, Jacobian and a 6 x 6 solve for one pose; `solve_ik` does a fixed number of them,
plus one forward kinematics for the errors, which is not counted as an iteration. A closed-form pose is all eight
branches of one pose. Both get the same reachable poses: of the tool at joints uniform within the limits. The solver's
seeds are drawn likewise, so part of them can't converge; the number of iterations, and so the time, is the same.
"""

import sys
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from basenet_jax.robot import ur
from basenet_jax.robot.ik import IKSolution, solve_ik
from basenet_jax.robot.kinematics import Frame, components, forward_kinematics
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from benchmarks.harness import Options, Report, measure, parse, speed, speed_table

NAME = "inverse_kinematics"
BATCHES = (1_024, 4_096, 16_384, 65_536)
QUICK_BATCHES = (64,)
ITERATIONS = 30


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    robot: Robot = jax.device_put(load_robot())
    results = []
    for batch in QUICK_BATCHES if options.quick else BATCHES:
        joints_key, seed_key = jax.random.split(jax.random.key(options.seed))
        position, rotation = jax.jit(forward_kinematics)(robot, _draw_joints(joints_key, robot, batch))
        seeds = _draw_joints(seed_key, robot, batch)
        results += [
            _damped_least_squares(robot, position, rotation, seeds, options.repeats),
            _closed_form(robot, position, rotation, options.repeats),
        ]
    table = speed_table("Inverse kinematics", results, "batch", "converged_share")
    return report.finish(results, table=table, iterations_per_pose=ITERATIONS, branches_per_pose=ur.BRANCHES)


def _draw_joints(key: Array, robot: Robot, batch: int) -> Array:
    lower, upper = jnp.asarray(robot.joint_lower), jnp.asarray(robot.joint_upper)
    return lower + jax.random.uniform(key, (batch, robot.dof)) * (upper - lower)


def _damped_least_squares(robot: Robot, position: Array, rotation: Array, seeds: Array, repeats: int) -> dict[str, Any]:
    def solve(position: Array, rotation: Array, seeds: Array) -> IKSolution:
        return solve_ik(robot, position, rotation, seeds, iterations=ITERATIONS)

    batch = len(seeds)
    timing = measure(solve, [(position, rotation, seeds)], repeats=repeats)
    converged = float(np.mean(jax.jit(solve)(position, rotation, seeds).converged))
    facts = {"batch": batch, "converged_share": converged}
    return speed("damped least squares", "iterations/s", batch * ITERATIONS, timing, **facts)


def _closed_form(robot: Robot, position: Array, rotation: Array, repeats: int) -> dict[str, Any]:
    """A loop over the branches, as the pick check does it."""

    def solve(position: Array, rotation: Array) -> ur.ClosedForm:
        x, y, z = (components(rotation[..., k]) for k in range(3))
        target = Frame(x, y, z, components(position))
        return jax.lax.map(
            lambda branch: ur.closed_form(robot, target, ur.branch_signs(branch)), jnp.arange(ur.BRANCHES)
        )

    batch = len(position)
    return speed("closed form", "poses/s", batch, measure(solve, [(position, rotation)], repeats=repeats), batch=batch)


if __name__ == "__main__":
    main()
