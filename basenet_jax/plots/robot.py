"""Pictures of a robot: its frames and shapes, and which grasps on the table it serves."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from basenet_jax.plots.drawing import draw_room, rectangle
from basenet_jax.robot.fields import GRASP_DEPTH_M
from basenet_jax.robot.model import Robot
from basenet_jax.robot.posture import link_frames
from basenet_jax.world.boxes import Room

_AXES = ("#D55E00", "#009E73", "#0072B2")  # x, y, z of frames
_BODY, _ARM, _TOOL_M = "#1B3A5C", "#8C8C8C", 0.12
_GRIPPER = "#CC79A7"
_YES, _NO = "#009E73", "#B00020"
_VIEWS = (("from the side", 0, 2), ("from above", 0, 1), ("from the front", 1, 2))  # title, axes across and up


def plot_robot(robot: Robot) -> Figure:
    """Home and stow from three sides, in the base frame: body box, shapes, joint axes (z), and the tool's frame."""
    figure = Figure(figsize=(13.0, 8.0), layout="constrained")
    panels = figure.subplots(2, len(_VIEWS))
    for row, (name, joints) in zip(panels, (("home", robot.home), ("stow", robot.stow)), strict=True):
        frames = link_frames(robot, np.asarray(joints))
        for axes, (view, across, up) in zip(row, _VIEWS, strict=True):
            _draw_body(axes, robot, across, up)
            _draw_arm(axes, robot, frames, across, up)
            axes.set_title(f"{name}, {view}", fontsize=10)
            axes.set_xlabel(f"{'xyz'[across]} (m)")
            axes.set_ylabel(f"{'xyz'[up]} (m)")
            axes.set_aspect("equal")
            axes.grid(color="#DDDDDD", linewidth=0.5)
            axes.set_axisbelow(True)
    handles = [
        Line2D([], [], color=color, lw=2, label=f"{axis} of a frame") for axis, color in zip("xyz", _AXES, strict=True)
    ]
    handles += [Line2D([], [], color=_ARM, lw=6, alpha=0.5, label="shapes that are tested")]
    handles += [
        Line2D([], [], color=_GRIPPER, marker="v", ms=6, lw=1.5, ls=":", label="gripper, to where fingers meet")
    ]
    handles += [Line2D([], [], color="black", marker="o", ms=4, lw=1, label="joints")]
    handles += [Line2D([], [], color=_BODY, lw=1.5, label="body box, deck (dashed)")]
    figure.legend(handles=handles, loc="outside lower center", ncols=7, frameon=False)
    figure.suptitle(f"{robot.name}: the tool's z has to point out of the gripper, down at stow")
    return figure


def plot_service(
    room: Room, grasps: Float[np.ndarray, "N 4"], served: np.ndarray, base_pose: Float[np.ndarray, "N 3"], title: str
) -> Figure:
    """The table from above: grasps that some base pose serves, with a line to that base, and those that none does."""
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    axes = figure.subplots()
    draw_room(axes, room)
    for grasp, pose in zip(grasps[served], base_pose[served], strict=True):
        axes.plot([grasp[0], pose[0]], [grasp[1], pose[1]], color="#7A93AC", lw=0.4, zorder=2)
    axes.plot(*base_pose[served][:, :2].T, "s", color=_BODY, ms=3, ls="", label="a base pose that serves it")
    for chosen, color, marker, label in ((served, _YES, "o", "served"), (~served, _NO, "x", "not served")):
        axes.plot(*grasps[chosen][:, :2].T, marker, color=color, ms=5, ls="", label=f"grasp, {label} ({chosen.sum()})")
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.grid(color="#DDDDDD", linewidth=0.5)
    axes.set_axisbelow(True)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    axes.set_title(title, fontsize=10)
    return figure


def _draw_body(axes: Axes, robot: Robot, across: int, up: int) -> None:
    center, half = np.asarray(robot.body_center), np.asarray(robot.body_half_size)
    box = rectangle((center[across], center[up], 0.0), (half[across], half[up]))
    axes.add_patch(Polygon(box, fc=(0.11, 0.23, 0.36, 0.10), ec=_BODY, lw=1.5))
    if (across, up) == (0, 1):
        deck = np.asarray(robot.deck)
        axes.add_patch(Polygon(rectangle((*deck[:2], 0.0), deck[2:] / 2), fc="none", ec=_BODY, lw=1.0, ls="--"))


def _draw_arm(axes: Axes, robot: Robot, frames: np.ndarray, across: int, up: int) -> None:
    pick = [across, up]
    for link, start, end, radius in zip(
        robot.capsule_link, robot.capsule_start, robot.capsule_end, robot.capsule_radius, strict=True
    ):
        ends = np.array([(frames[link] @ (*point, 1.0))[pick] for point in (start, end)])
        axes.add_patch(Polygon(_outline(ends, float(radius)), fc=_ARM, ec="none", alpha=0.35))
    origins = frames[:, :3, 3][:, pick]
    axes.plot(*origins.T, color="black", marker="o", ms=3, lw=0.8, zorder=4)
    for frame in frames[1:-1]:
        _draw_axis(axes, frame, 2, pick, 0.5 * _TOOL_M)
    for axis in range(3):
        _draw_axis(axes, frames[-1], axis, pick, _TOOL_M)
    origin, fingers = frames[-1, :3, 3], frames[-1, :3, 3] + GRASP_DEPTH_M * frames[-1, :3, 2]
    axes.plot(*np.stack([origin, fingers])[:, pick].T, color=_GRIPPER, lw=1.5, ls=":", zorder=5)
    axes.plot(*fingers[pick], color=_GRIPPER, marker="v", ms=6, zorder=6)
    axes.autoscale_view()


def _draw_axis(axes: Axes, frame: np.ndarray, axis: int, pick: list[int], length: float) -> None:
    start, end = frame[pick, 3], frame[pick, 3] + length * frame[pick, axis]
    axes.plot([start[0], end[0]], [start[1], end[1]], color=_AXES[axis], lw=2, zorder=5)


def _outline(ends: np.ndarray, radius: float) -> np.ndarray:
    """A capsule's outline in a plane: half a circle about either end."""
    along = ends[1] - ends[0]
    first = np.arctan2(along[1], along[0]) + np.pi / 2
    angles = np.linspace(0.0, np.pi, 16)
    caps = [
        end + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        for end, turn in zip(ends, (first + angles, first + np.pi + angles), strict=True)
    ]
    return np.concatenate(caps)
