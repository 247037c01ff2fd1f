"""What the page says, as HTML. Every name goes through `escape`: files may call objects anything."""

from collections.abc import Sequence
from html import escape

import numpy as np

from basenet_jax.plots.drawing import FAILED
from basenet_jax.task.motion import Doing
from basenet_jax.task.picking import Reason
from basenet_jax.viewer.asking import Answer
from basenet_jax.viewer.planned import Awaited, Planned, Refused, Shown

REASONS = {
    Reason.BASE_COLLIDES: "the base would touch something or its margin, or leave the floor",
    Reason.OUT_OF_REACH: "out of the arm's reach",
    Reason.NO_STRAIGHT_DESCENT: "the arm can't come down straight onto it",
    Reason.ARM_COLLIDES: "the arm would touch something, or the robot's body",
    Reason.OBJECT_IN_THE_WAY: "the arm would touch another object that still stands",
    Reason.ARM_HITS_ITSELF: "the arm would touch itself",
    Reason.NEAR_SINGULAR: "the arm would be stretched or folded so far that it can't follow a straight line",
    Reason.UNREACHABLE: "there is no way to drive to where it could be picked",
    Reason.NOT_EXECUTED: "the plan ended before it",
}
HELP = """<b>Drag</b> objects, furniture, or the robot where it starts. <b>Click</b> one to turn it by the ring about
it, or to remove it. <b>Click the floor</b> to ask what can be picked from there. Drag elsewhere to look around, scroll
to come nearer."""
START = "the robot's start"
NOTHING = "nothing"
NOT_GRASPED = "not grasped"

_ALONG = 0.99  # cosine of how far a straight piece may be askew and still go along the heading
_SMALL = "font-size:0.85em;padding:2px 0.6em"
_TABLE = "font-size:0.9em;margin:2px 0.5em;border-collapse:collapse"
_ROWS = ("navigation N", "grasping G", "N + G", "grasped", "planned in")
_CELL = "padding:1px 8px 1px 0;text-align:right;white-space:nowrap"


def paragraph(text: str, *, color: str = "inherit") -> str:
    """Plain text as a small paragraph."""
    return f'<div style="{_SMALL};color:{color};overflow-wrap:anywhere">{escape(text)}</div>'


def hints() -> str:
    """How to use the page."""
    return f'<div style="{_SMALL};color:#666;line-height:1.4">{HELP}</div>'


def figures(plans: Sequence[Shown], colors: Sequence[str]) -> str:
    """N, G, their sum and the planning time of each plan, side by side, and what isn't grasped and why."""
    pairs = zip(plans, colors, strict=False)
    heads = "".join(f'<th style="{_CELL};color:{color}">{escape(plan.maker)}</th>' for plan, color in pairs)
    rows = "".join(
        f'<tr><td style="padding-right:10px">{name}</td>'
        + "".join(f'<td style="{_CELL}">{escape(cell)}</td>' for cell in cells)
        + "</tr>"
        for name, *cells in zip(_ROWS, *(_column(plan) for plan in plans), strict=True)
    )
    table = f'<table style="{_TABLE}"><tr><th></th>{heads}</tr>{rows}</table>'
    return table + "".join(_troubles(plan) for plan in plans)


def failures(planned: Planned) -> list[tuple[str, str]]:
    """Names of the objects that a plan leaves on the table, and why, in its order."""
    outcome = planned.outcome
    steps = np.flatnonzero(outcome.is_step & ~np.asarray(outcome.feasible))
    return [
        (planned.scene.names[int(planned.plan.object_index[step])], REASONS[Reason(int(outcome.reason[step]))])
        for step in steps
    ]


def labels(planned: Planned) -> dict[str, str]:
    """What stands over each object: when it is picked, counted from 1, or that it isn't."""
    plan, outcome = planned.plan, planned.outcome
    names = {int(step): planned.scene.names[int(plan.object_index[step])] for step in np.flatnonzero(outcome.is_step)}
    return {name: str(step + 1) if outcome.feasible[step] else NOT_GRASPED for step, name in names.items()}


def answer(found: Answer) -> str:
    """What can be picked from a place, and why not the rest."""
    x, y, heading = found.base_pose
    where = f"From ({x:.2f}, {y:.2f}) m"
    if found.collides:
        return paragraph(f"{where} nothing: at every heading tried the base would {_trouble(found)}.")
    turned = f"{np.degrees(heading):.0f}°"
    rows = "".join(
        f'<tr><td style="padding-right:10px">{escape(name)}</td>'
        f'<td style="color:{"inherit" if time is not None else FAILED}">'
        f"{f'{time:.1f} s' if time is not None else escape(_why(found, name, reason), quote=False)}</td></tr>"
        for name, time, reason in zip(found.names, found.times, found.reasons, strict=True)
    )
    best = f"{where}, heading {turned}, the best of those tried: {found.count} of {len(found.names)} objects."
    head = best if found.count else f"{where} nothing, at any heading tried:"
    note = "" if found.way else paragraph("There is no way for the base to get there from its start.", color=FAILED)
    return paragraph(head) + note + f'<table style="{_SMALL};border-collapse:separate">{rows}</table>'


def _trouble(found: Answer) -> str:
    """What keeps the base from standing somewhere."""
    if not found.on_floor:
        return "leave the floor"
    if not found.at_base:
        return "touch something or its margin"
    margins = "its margin" if len(found.at_base) == 1 else "their margins"
    return f"touch {_listed(found.at_base, 'or')} or {margins}"


def _why(found: Answer, name: str, reason: Reason) -> str:
    boxes = found.in_the_way.get(name, ())
    return f"the arm would touch {_listed(boxes, 'or')}" if boxes else REASONS[reason]


def _listed(names: Sequence[str], last: str) -> str:
    return ", ".join(names[:-1]) + f" {last} " + names[-1] if len(names) > 1 else names[0]


def doing(planned: Planned, time_s: float) -> str:
    """What the robot does at a time (s) of its plan; nothing when it is over."""
    motion = planned.motion
    key = int(np.searchsorted(motion.time, time_s, side="right")) - 1
    if not 0 <= key < len(motion.parts):
        return ""
    part = motion.parts[key]
    name = planned.scene.names[int(planned.plan.object_index[part.step])]
    if part.doing not in (Doing.TURN, Doing.DRIVE):
        return f"{name}: {part.doing}"
    how = part.doing.value
    if part.doing == Doing.DRIVE:
        shift, heading = np.diff(motion.base_pose[key : key + 2, :2], axis=0)[0], motion.base_pose[key, 2]
        along = float(shift @ (np.cos(heading), np.sin(heading))) / float(np.hypot(*shift))
        how += " in reverse" if along < -_ALONG else "" if along > _ALONG else " sideways"
    return f"to {name}: {how}"


def duration(seconds: float) -> str:
    """A planning time in ms or s."""
    return f"{1e3 * seconds:.0f} ms" if seconds < 1.0 else f"{seconds:.1f} s"


def _column(plan: Shown) -> tuple[str, ...]:
    if not isinstance(plan, Planned):
        return ("…" if isinstance(plan, Awaited) else "-",) * len(_ROWS)
    outcome = plan.outcome
    times = (f"{float(value):.1f} s" for value in (outcome.navigation, outcome.picking, outcome.execution))
    grasped = f"{int(outcome.grasped)} of {int(np.sum(outcome.is_step))}"
    return (*times, grasped, "from a file" if plan.planning_s is None else duration(plan.planning_s))


def _troubles(plan: Shown) -> str:
    """Why there is no plan, or which objects it leaves and why."""
    if isinstance(plan, Refused):
        return paragraph(f"{plan.maker}: {plan.reason}", color=FAILED)
    if isinstance(plan, Awaited):
        return ""
    return "".join(paragraph(f"{plan.maker} leaves {name}: {reason}", color=FAILED) for name, reason in failures(plan))
