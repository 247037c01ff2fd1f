"""The picture of one plan."""

from collections.abc import Sequence

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from basenet_jax.config import NavigationConfig
from basenet_jax.plots.drawing import CLASS_NAMES, draw_plan, legend_handles
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.scene import Scene

_WIDTH, _SIDE, _MARGIN = 11.5, 3.5, 0.7  # inches: the figure, the part right of the drawing, round the drawing
_HIGHEST = 6.5  # inches, of the drawing
_LINE, _FONT = 0.176, 8  # of legend and list: inches per line, points


def plot_plan(
    robot: Robot,
    scene: Scene,
    plan: Plan,
    outcome: Outcome,
    title: str | None = None,
    *,
    names: Sequence[str] | None = None,
    navigation: NavigationConfig = NavigationConfig(),
) -> Figure:
    """Top view of one plan: the table, the objects and their grasps, where the base parks, what it drives.

    Stops are numbered by the picks made there. Beside the drawing stand the legend and the list of steps with their
    navigation time N and grasping time G.

    Args:
        robot: the robot.
        scene: one scene, not a batch.
        plan: of that scene.
        outcome: of executing it.
        title: above the figure; by default the plan's totals.
        names: of the objects by slot, for the list of steps; by default their classes.
        navigation: of the drives that are drawn.
    """
    scene, plan, outcome = jax.device_get((scene, plan, outcome))
    figure = Figure(figsize=(_WIDTH, _WIDTH / 2))
    axes = figure.add_subplot()
    draw_plan(axes, robot, scene, plan, outcome, navigation=navigation)
    axes.set_title(title or totals(outcome), fontsize=11)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    handles = legend_handles([scene], bool(np.any(outcome.is_step & ~outcome.feasible)))
    lines = _step_lines(scene, plan, outcome, names)
    _arrange(figure, axes, legend_lines=len(handles), step_lines=len(lines))
    height, left = figure.get_figheight(), (_WIDTH - _SIDE) / _WIDTH
    top = 1.0 - 0.2 / height
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(left, top), frameon=False, fontsize=_FONT)
    top -= (len(handles) * _LINE + 0.3) / height
    figure.text(left + 0.012, top, "\n".join(lines), va="top", family="monospace", fontsize=_FONT, linespacing=1.3)
    return figure


def _arrange(figure: Figure, axes: Axes, *, legend_lines: int, step_lines: int) -> None:
    """A figure as high as the drawing (within reason) or the texts beside it need."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    drawing = _WIDTH - _SIDE - 1.3 * _MARGIN
    wanted = min(drawing * (top - bottom) / (right - left), _HIGHEST) + 1.4 * _MARGIN
    height = max(wanted, (legend_lines + step_lines) * _LINE + 0.9)
    figure.set_figheight(height)
    axes.set_position((_MARGIN / _WIDTH, _MARGIN / height, drawing / _WIDTH, 1 - 1.4 * _MARGIN / height))


def totals(outcome: Outcome) -> str:
    """Objects grasped, N, G and N + G of one plan, in words."""
    count = int(np.sum(outcome.is_step))
    text = f"{int(outcome.grasped)} of {count} objects grasped, N {float(outcome.navigation):.1f} s"
    return text + f" + G {float(outcome.picking):.1f} s = {float(outcome.execution):.1f} s"


def _step_lines(scene: Scene, plan: Plan, outcome: Outcome, names: Sequence[str] | None) -> list[str]:
    """The list of steps; of one that fails, its reason instead of G."""
    lines = [f"{'step':<21}{'N (s)':>8}{'G (s)':>8}"]
    for step in np.flatnonzero(outcome.is_step):
        slot = int(plan.object_index[step])
        name = names[slot] if names is not None else CLASS_NAMES[int(scene.object_class[slot])]
        drive, pick = float(outcome.navigation_time[step]), float(outcome.pick_time[step])
        last = f"{pick:8.1f}" if outcome.feasible[step] else f"  {Reason(outcome.reason[step]).name.lower()}"
        lines.append(f"{step + 1:>2} {_cut(name, 18):<18}{drive:8.1f}{last}")
    return lines


def _cut(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 1] + "…"
