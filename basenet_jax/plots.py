"""Pictures of plans: data in, Matplotlib figures out."""

from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from numpy.typing import ArrayLike

from basenet_jax.robot.model import Robot
from basenet_jax.task.navigation import navigation_path
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.scene import OBJECT_CLASSES, Scene

# Okabe and Ito's palette, told apart with any colour vision: one colour for each class, the last for users' own.
CLASS_COLORS = ("#D55E00", "#56B4E9", "#F0E442", "#009E73", "#CC79A7", "#999999")
_BASE, _PATH, _FAILED = "#1B3A5C", "#7A93AC", "#B00020"


def plot_plan(robot: Robot, scene: Scene, plan: Plan, outcome: Outcome, title: str | None = None) -> Figure:
    """Top view of one plan: the table, the objects and their grasps, where the base parks, what it drives.

    Stops are numbered in order; steps at one stop share a rectangle. The bar is the heading, the dot the arm's mount.

    Args:
        robot: the robot.
        scene: one scene, not a batch.
        plan: of that scene.
        outcome: of executing it.
        title: above the figure; by default the plan's totals.
    """
    scene, plan, outcome = jax.device_get((scene, plan, outcome))
    figure = Figure(figsize=(9.5, 5.6), layout="constrained")
    axes = figure.add_subplot()
    corner = scene.table.half_size
    axes.add_patch(Polygon(_rectangle((0.0, 0.0, 0.0), corner), facecolor="#EFE6D8", edgecolor="#8A7A60", zorder=1))
    _draw_objects(axes, scene, plan, outcome)
    _draw_stops(axes, robot, scene, plan, outcome)
    count = int(outcome.is_step.sum())
    totals = f"{int(outcome.grasped)} of {count} objects grasped, N {float(outcome.navigation):.1f} s"
    totals += f" + G {float(outcome.picking):.1f} s = {float(outcome.execution):.1f} s"
    axes.set_title(title or totals, fontsize=11)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.grid(color="#DDDDDD", linewidth=0.5, zorder=0)
    figure.legend(handles=_legend(scene), loc="outside right upper", frameon=False, fontsize=9)
    return figure


def _draw_objects(axes: Any, scene: Scene, plan: Plan, outcome: Outcome) -> None:
    """Rectangles by class, their grasps, and the number of the step that picks them."""
    for slot in np.flatnonzero(scene.mask):
        pose, size = scene.object_pose[slot], scene.object_size[slot]
        color = CLASS_COLORS[int(scene.object_class[slot])]
        axes.add_patch(Polygon(_rectangle(pose, size[:2] / 2), facecolor=color, edgecolor="black", lw=0.8, zorder=3))
        x, y, _, yaw = scene.grasps[slot]
        span = 0.05 * np.array([-np.sin(yaw), np.cos(yaw)])
        axes.plot([x - span[0], x + span[0]], [y - span[1], y + span[1]], color="black", lw=1.6, zorder=4)
        steps = np.flatnonzero(plan.object_index == slot)
        if len(steps):
            step = int(steps[0])
            feasible = bool(outcome.feasible[step])
            label = str(step + 1) if feasible else f"{step + 1} not grasped"
            style = {"fontsize": 8, "zorder": 7, "color": "black" if feasible else _FAILED}
            above = float(pose[1]) + 0.5 * float(np.hypot(size[0], size[1]))
            axes.annotate(label, (float(pose[0]), above), ha="center", va="bottom", weight="bold", **style)


def _draw_stops(axes: Any, robot: Robot, scene: Scene, plan: Plan, outcome: Outcome) -> None:
    """The start, every different base pose with the steps made there, and the driven path."""
    _draw_base(axes, robot, scene.robot_start, "start", hollow=True)
    steps = np.flatnonzero(outcome.is_step & plan.served)
    labels: dict[tuple[float, ...], list[str]] = {}
    before = scene.robot_start
    for step in steps:
        pose = plan.base_pose[step]
        labels.setdefault(tuple(np.round(pose, 6)), []).append(str(step + 1))
        if float(outcome.navigation_time[step]) > 0:
            path = navigation_path(robot, before, pose, scene.table)
            axes.plot(path[:, 0], path[:, 1], color=_PATH, lw=1.4, ls=(0, (5, 2)), zorder=2)
            before = pose
    for pose, numbers in labels.items():
        _draw_base(axes, robot, np.array(pose), ", ".join(numbers))
    for slot in steps:
        grasp = scene.grasps[plan.object_index[slot]]
        mount = _to_world(plan.base_pose[slot], np.asarray(robot.mount_position)[None, :2])[0]
        axes.plot([mount[0], grasp[0]], [mount[1], grasp[1]], color="#BBBBBB", lw=0.8, zorder=2)


def _draw_base(axes: Any, robot: Robot, pose: ArrayLike, label: str, hollow: bool = False) -> None:
    half = np.asarray(robot.footprint_half_size)
    face = "none" if hollow else (0.11, 0.23, 0.36, 0.16)
    axes.add_patch(Polygon(_rectangle(pose, half), facecolor=face, edgecolor=_BASE, lw=1.1, zorder=5))
    front = _to_world(pose, np.array([[half[0], -0.6 * half[1]], [half[0], 0.6 * half[1]]]))
    axes.plot(front[:, 0], front[:, 1], color=_BASE, lw=3, solid_capstyle="butt", zorder=6)
    mount = _to_world(pose, np.asarray(robot.mount_position)[None, :2])[0]
    axes.plot(*mount, "o", color=_BASE, ms=4.5, zorder=6)
    axes.annotate(
        label, np.asarray(pose)[:2], ha="center", va="center", fontsize=9, weight="bold", color=_BASE, zorder=7
    )


def _legend(scene: Scene) -> list[Any]:
    names = [*(kind.name.replace("_", " ") for kind in OBJECT_CLASSES), "own class"]
    present = sorted({int(scene.object_class[slot]) % len(names) for slot in np.flatnonzero(scene.mask)})
    handles: list[Any] = [Patch(facecolor=CLASS_COLORS[i], edgecolor="black", lw=0.8, label=names[i]) for i in present]
    return [
        *handles,
        Line2D([], [], color="black", lw=1.6, label="grasp (gripper axis)"),
        Patch(facecolor=(0.11, 0.23, 0.36, 0.16), edgecolor=_BASE, label="base, steps made there"),
        Line2D([], [], color=_BASE, lw=3, label="front of the base"),
        Line2D([], [], color=_BASE, marker="o", ls="", ms=4.5, label="arm mount"),
        Line2D([], [], color="#BBBBBB", lw=0.8, label="pick"),
        Line2D([], [], color=_PATH, lw=1.4, ls=(0, (5, 2)), label="drive"),
    ]


def _rectangle(pose: ArrayLike, half: ArrayLike) -> np.ndarray:
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    return _to_world(pose, signs * np.asarray(half))


def _to_world(pose: ArrayLike, points: np.ndarray) -> np.ndarray:
    pose = np.asarray(pose)
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return points @ np.array([[cosine, sine], [-sine, cosine]]) + pose[:2]
