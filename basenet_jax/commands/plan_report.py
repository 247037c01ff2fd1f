"""A plan as tables to read on a terminal."""

import numpy as np
from jaxtyping import Int
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from basenet_jax.planners.explanation import in_the_way
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.task.plan_file import reason_name
from basenet_jax.world.scene import NamedScene

_OF_BOXES = (Reason.BASE_COLLIDES, Reason.OUT_OF_REACH, Reason.NO_STRAIGHT_DESCENT, Reason.ARM_COLLIDES)
_NEARLY_SINGULAR = 0.02  # m and rad, of the least singular value: below it, a straight descent may not be followed


def print_plan(scene: NamedScene, plan: Plan, outcome: Outcome) -> None:
    """Prints the steps of one plan in order, and their totals, on stdout."""
    steps = np.flatnonzero(np.asarray(outcome.is_step))
    heads = ["#", "object", "x (m)", "y (m)", "heading\n(deg)", "N (s)", "G (s)"]
    heads += [] if outcome.reliability is None else ["sure\n(%)"]
    heads += ["not grasped"] if int(outcome.grasped) < len(steps) else []
    table = RichTable(box=SIMPLE_HEAD)
    for head in heads:
        table.add_column(head, justify="left" if head in ("object", "not grasped") else "right", overflow="fold")
    for number, step in enumerate(steps, start=1):
        x, y, heading = np.asarray(plan.base_pose[step], float)
        pose = (f"{x:.2f}", f"{y:.2f}", f"{np.degrees(heading):.0f}") if plan.served[step] else ("-", "-", "-")
        times = (f"{float(outcome.navigation_time[step]):.1f}", f"{float(outcome.pick_time[step]):.1f}")
        # As `Text`, since a name may look like rich's markup.
        name = Text(scene.names[int(plan.object_index[step])])
        sure = () if outcome.reliability is None else (f"{100 * float(outcome.reliability[step]):.0f}",)
        cells = (str(number), name, *pose, *times, *sure, reason_name(outcome.reason[step]) or "")
        table.add_row(*cells[: len(heads)])
    Console().print(table)
    navigation, picking, execution = (float(x) for x in (outcome.navigation, outcome.picking, outcome.execution))
    totals = f"N {navigation:.1f} s + G {picking:.1f} s = {execution:.1f} s"
    print(f"{int(outcome.grasped)} of {len(steps)} objects grasped, {totals}")


def nearly_singular(scene: NamedScene, plan: Plan, outcome: Outcome) -> list[tuple[str, float]]:
    """Names and least singular values of the picks that come near a singular pose of the arm, in the plan's order.

    Args:
        scene: that was planned.
        plan: of the scene.
        outcome: of executing it, with singular values.
    """
    least = np.asarray(outcome.least_singular_value)
    steps = np.flatnonzero(np.asarray(outcome.feasible) & (least < _NEARLY_SINGULAR))
    return [(scene.names[int(plan.object_index[step])], float(least[step])) for step in steps]


def unsure(scene: NamedScene, plan: Plan, outcome: Outcome, setup: PlannerSetup) -> list[tuple[str, float]]:
    """Names and reliabilities of the picks that are less reliable than the planner was asked for, in the plan's order.

    Args:
        scene: that was planned.
        plan: of the scene.
        outcome: of executing it, with reliabilities.
        setup: of a planner that was asked for some.
    """
    assert setup.chance is not None
    assert outcome.reliability is not None
    misses = np.asarray(outcome.feasible) & ~np.asarray(setup.chance.holds(outcome.reliability))
    steps = np.flatnonzero(misses)
    return [(scene.names[int(plan.object_index[step])], float(outcome.reliability[step])) for step in steps]


def failures(scene: NamedScene, plan: Plan, outcome: Outcome, setup: PlannerSetup) -> list[tuple[str, str]]:
    """Names and reasons of the objects that executing the plan leaves where they are, in the plan's order.

    Of a room's objects, also what is in the way.
    """
    steps = np.flatnonzero(np.asarray(outcome.is_step & ~outcome.feasible))
    failed = []
    for step in steps:
        slot, reason = int(plan.object_index[step]), Reason(int(outcome.reason[step]))
        more = "" if scene.furniture is None else _in_a_room(scene, setup, slot, reason)
        failed.append((scene.names[slot], f"{reason_name(reason)}{more}"))
    return failed


def _in_a_room(scene: NamedScene, setup: PlannerSetup, slot: int, reason: Reason) -> str:
    """What is in an object's way, as the end of a line."""
    if reason == Reason.UNREACHABLE:
        return " (no way leads to where it could be picked)"
    if reason not in _OF_BOXES:
        return ""
    names, together = in_the_way(setup, scene.arrays, slot, scene.box_names)
    said = (" and " if together else " or ").join(repr(name) for name in names)
    return f" (in the way: {said})" if said else ""


def print_order(scene: NamedScene, waits: list[tuple[int, tuple[int, ...]]]) -> None:
    """Prints why objects are picked after others.

    Args:
        scene: the scene.
        waits: of `planners.explanation.what_waits`.
    """
    for slot, needed in waits:
        names = " and ".join(repr(scene.names[other]) for other in needed)
        stands = "they stand" if len(needed) > 1 else "it stands"
        print(f"{scene.names[slot]!r} after {names}: {stands} before it")


def print_explanation(scene: NamedScene, counts: Int[np.ndarray, "M reasons"]) -> None:
    """Prints, for each object, from how many candidate base poses it can be picked, and how many each rule excludes.

    Args:
        scene: the scene.
        counts: of `planners.explanation.count_reasons`.
    """
    shown = (Reason.NONE, Reason.OUT_OF_REACH, Reason.NO_STRAIGHT_DESCENT, Reason.ARM_COLLIDES)
    if scene.furniture is None:
        print(f"from how many of {int(counts[0].sum())} base poses of the grid, all clear of the table:")
    else:
        shown += (Reason.BASE_COLLIDES, Reason.UNREACHABLE)
        print("from how many base poses of the grid, of those round each object:")
    table = RichTable(box=SIMPLE_HEAD)
    table.add_column("object", overflow="fold")
    for reason in shown:
        first, _, last = (reason_name(reason) or "can be_picked").rpartition("_")
        table.add_column(f"{first}\n{last}".replace("_", " "), justify="right")
    for slot, name in enumerate(scene.names):
        table.add_row(Text(name), *(str(counts[slot, reason]) for reason in shown))
    Console().print(table)
