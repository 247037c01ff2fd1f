"""The paper's qualitative figure: every planner's plan for one scene, side by side."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import jax
import numpy as np
from matplotlib.figure import Figure

from basenet_jax.plots.drawing import draw_plan, legend_handles
from basenet_jax.robot.model import Robot
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.scene import Scene

_PANEL, _NARROWEST = 3.8, 3.3  # inches, of a panel's longer side, and what its titles need


class PlannedScene(NamedTuple):
    """What one planner made of the scene."""

    plan: Plan
    outcome: Outcome
    planning_s: float | None = None  # P, where it was measured


def plot_comparison(robot: Robot, scene: Scene, planned: Mapping[str, PlannedScene], *, columns: int = 3) -> Figure:
    """One panel per planner with shared axes and one legend; titles say what is grasped, N, G, N + G and P.

    Args:
        robot: the robot.
        scene: one scene, not a batch.
        planned: by planner, in the order of the panels.
        columns: of panels, at most.

    Raises:
        ValueError: there is no planner.
    """
    if not planned:
        raise ValueError("planned: found no planner, at least one is needed")
    scene = jax.device_get(scene)
    columns = min(columns, len(planned))
    rows = math.ceil(len(planned) / columns)
    figure = Figure(layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    failures = False
    for axes, (name, each) in zip(panels, planned.items(), strict=False):
        plan, outcome = jax.device_get((each.plan, each.outcome))
        draw_plan(axes, robot, scene, plan, outcome, size=7.0)
        axes.set_title(name, fontsize=11, weight="bold", loc="left")
        axes.set_title(_figures(outcome, each.planning_s), fontsize=8, loc="right")
        failures |= bool(np.any(outcome.is_step & ~outcome.feasible))
    (left, right), (bottom, top) = panels[0].get_xlim(), panels[0].get_ylim()
    scale = min(_PANEL / (right - left), _PANEL / (top - bottom))  # inches per metre
    wide, high = max(scale * (right - left), _NARROWEST) + 0.3, scale * (top - bottom) + 0.5
    figure.set_size_inches(wide * columns + 2.8, high * rows + 0.4)
    for axes in panels[len(planned) :]:
        axes.set_visible(False)
    for index, axes in enumerate(panels[: len(planned)]):
        axes.label_outer(remove_inner_ticks=True)
        if index + columns >= len(planned):  # no panel below
            axes.set_xlabel("x (m)")
            axes.tick_params(labelbottom=True, bottom=True)
        if index % columns == 0:
            axes.set_ylabel("y (m)")
    handles = legend_handles([scene], failures)
    figure.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=9)
    return figure


def _figures(outcome: Outcome, planning_s: float | None) -> str:
    count = int(np.sum(outcome.is_step))
    planning = "" if planning_s is None else f", P {planning_s:.3g} s"
    return (
        f"{int(outcome.grasped)} of {count} grasped{planning}\n"
        f"N {float(outcome.navigation):.1f} + G {float(outcome.picking):.1f} = {float(outcome.execution):.1f} s"
    )
