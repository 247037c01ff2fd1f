"""The report of `python -m basenet_jax.robot check`."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.table import Table as RichTable

from basenet_jax.evaluation.robot_check import (
    check_service,
    compare_with_mujoco,
    find_causes,
    rest_faults,
    solved_share,
)
from basenet_jax.evaluation.servable import Served, random_grasps
from basenet_jax.robot import seven, ur
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import Source
from basenet_jax.robot.set_up import tool_tilt_degrees
from basenet_jax.task.picking import Reason
from basenet_jax.world.boxes import Room

_POOR_IK = 0.9
_SOLVERS = {
    ur.NAME: "the closed form of Universal Robots' arms",
    seven.NAME: "the closed form of seven joints with a spherical shoulder",
    None: "damped least squares",
}
_MANY, _FEW = 0.5, 0.1  # shares of grasps: with less served the causes are looked for; the robot is no use


class Findings(NamedTuple):
    """What a check has found."""

    faults: list[str]  # a line each
    grasps: Float[np.ndarray, "N 4"]  # tool0's x, y, z, yaw in W
    served: Served


def report(source: Source, grasps: int, seed: int) -> Findings:
    """Prints what is found, step by step.

    Args:
        source: the robot and what it was read from.
        grasps: how many random ones to serve.
        seed: of everything random.
    """
    console, robot, room = Console(), source.robot, Room.from_config()
    waiting = Console(stderr=True)
    console.print(_facts(source))
    for note in source.notes:
        console.print(f"note: {note}")
    faults = []
    with waiting.status("comparing kinematics with MuJoCo ..."):
        difference = compare_with_mujoco(source, seed)
    worst = f"{max(difference):.1e}"
    console.print(
        f"forward kinematics and Jacobian differ from MuJoCo's by {worst} at most (200 random states, float64)"
    )
    if not difference.is_small:
        faults.append(f"kinematics differ from MuJoCo's by {worst}: this is a fault of basenet_jax, please report it")
    with waiting.status("checking home and stow ..."):
        faults += rest_faults(source, room)
    console.print(f"at stow the tool's z is {tool_tilt_degrees(robot):.0f}° from straight down")
    with waiting.status("solving inverse kinematics ..."):
        solved = solved_share(robot, seed)
    console.print(f"inverse kinematics finds {100 * solved:.0f} % of random poses in reach")
    if solved < _POOR_IK:
        console.print(f"  (below {100 * _POOR_IK:.0f} %: narrow joint limits, or links of very different lengths)")
    with waiting.status("looking for base poses (compiling first) ..."):
        targets = random_grasps(robot, room, grasps, seed)
        served, speed = check_service(jax.device_put(robot), targets, room)
    _print_service(console, served, speed)
    if served.share < _MANY:
        with waiting.status("little is served: trying alternatives ..."):
            causes = _causes(robot, targets, room, served)
        if served.share < _FEW:
            faults += causes
        else:
            console.print("\n  ".join(causes))
    return Findings(faults, targets, served)


def _facts(source: Source) -> RichTable:
    """Joint by joint, what was read."""
    robot = source.robot
    table = RichTable(title=f"{robot.name}: {robot.dof} joints, {len(robot.capsule_radius)} shapes", pad_edge=False)
    for column in ("joint", "from", "to", "unit", "speed (/s)", "acceleration (/s²)", "home", "stow"):
        table.add_column(column, justify="left" if column in ("joint", "unit") else "right")
    for index, name in enumerate(robot.joint_names):
        factor, unit = (1.0, "m") if robot.prismatic[index] else (180.0 / np.pi, "°")
        angles = (robot.joint_lower, robot.joint_upper, robot.home, robot.stow)
        low, high, home, stow = (f"{factor * values[index]:.5g}" for values in angles)
        rates = (f"{factor * values[index]:.4g}" for values in (robot.joint_speed, robot.joint_acceleration))
        table.add_row(name, low, high, unit, *rates, home, stow)
    solver = _SOLVERS[robot.closed_form]
    table.caption = f"inverse kinematics by {solver}"
    return table


def _print_service(console: Console, served: Served, speed: float) -> None:
    share, count = 100 * served.share, len(served.served)
    console.print(
        f"{share:.1f} % of {count} random top-down grasps on the default table have a base pose that serves them"
    )
    if served.served.any():
        times = served.pick_time[served.served]
        console.print(
            f"  a pick from such a base pose takes {times.mean():.1f} s (from {times.min():.1f} to {times.max():.1f} s)"
        )
    unserved = served.farthest[~served.served]
    for reason in np.unique(unserved):
        console.print(f"  not served: {np.sum(unserved == reason)}, {Reason(int(reason)).name.lower()}")
    console.print(f"{speed:,.0f} pick evaluations per second")


def _causes(robot: Robot, grasps: np.ndarray, room: Room, served: Served) -> list[str]:
    much = f"{100 * served.share:.0f} %" if served.served.any() else "nothing"
    causes = find_causes(jax.device_put(robot), grasps, room)
    if not causes:
        reason = Reason(int(np.bincount(served.farthest).argmax())).name.lower()
        return [f"serves {much} ({reason}); no other tool frame, mount height, limit or shape alone would help"]
    lines = [f"{cause.what}: {100 * cause.share:.0f} % would be served" for cause in causes[:4]]
    return [f"serves {much}; likeliest cause first:", *lines]
