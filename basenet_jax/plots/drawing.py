"""What pictures of plans are made of: table, objects, stops, drives, and the legend that explains them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch, Polygon
from matplotlib.path import Path
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from basenet_jax.config import NavigationConfig
from basenet_jax.plots.arm_reach import arm_reach
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import OwnDrives, make_drives
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.boxes import Room
from basenet_jax.world.scene import OBJECT_CLASSES, SIDE_BACK_M, Scene

# Okabe and Ito's palette, told apart with any colour vision: one colour for each class, the last for users' own.
CLASS_COLORS = ("#D55E00", "#56B4E9", "#F0E442", "#009E73", "#CC79A7", "#999999")
CLASS_NAMES = (*(kind.name.replace("_", " ") for kind in OBJECT_CLASSES), "own class")
BASE, PATH, PICK, FAILED, REACH = "#1B3A5C", "#7A93AC", "#8C8C8C", "#B00020", "#0072B2"
_BASE_FACE = (0.11, 0.23, 0.36, 0.16)
_REACH_ALPHA = 0.10
_STEEP_M = 0.02  # of a grasp's way, seen from above, below which only the gripper is drawn
_AROUND_M = 2.0  # that is shown of a map round what stands on it
_SURFACE: dict[str, Any] = {"fc": "#EFE6D8", "ec": "#8A7A60", "zorder": 1}
_SOLID: dict[str, Any] = {"fc": "#B9BCC0", "ec": "#6F7378", "zorder": 0.9}
_KEEP_OUT: dict[str, Any] = {"fc": "#F6E3DE", "ec": "#D08A78", "lw": 0.0, "hatch": "///", "zorder": 0.8}
_HALO = (patheffects.withStroke(linewidth=2.5, foreground="white"),)  # keeps numbers readable on lines


def draw_plan(
    axes: Axes,
    robot: Robot,
    scene: Scene,
    plan: Plan,
    outcome: Outcome,
    size: float = 9.0,
    *,
    navigation: NavigationConfig = NavigationConfig(),
) -> None:
    """Draws one plan from above, in metres in W.

    Args:
        axes: to draw on.
        robot: the robot.
        scene: one concrete scene.
        plan: of that scene.
        outcome: of executing it.
        size: of the numbers, in points.
    """
    draw_room(axes, scene.room)
    _draw_reach(axes, robot, scene, plan, outcome)
    _draw_objects(axes, scene, plan, outcome, size)
    _draw_stops(axes, robot, scene, plan, outcome, size, navigation)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.grid(color="#DDDDDD", linewidth=0.5, zorder=0)
    axes.set_axisbelow(True)


def draw_room(axes: Axes, room: Room) -> None:
    """The boxes of a concrete room from above, surfaces over what else stands there, and the floor's bounds.

    What only the base keeps out of, a map's thousands of rectangles too, is one shape; as much of it is shown as lies
    round the rest.
    """
    boxes = room.boxes
    solid = np.asarray(boxes.blocks_arm)
    for index in np.flatnonzero(solid):
        look = _SURFACE if boxes.bears_objects[index] else _SOLID
        axes.add_patch(Polygon(rectangle(boxes.pose[index], boxes.half_size[index]), **look))
    flat = [
        rectangle(boxes.pose[i], boxes.half_size[i]) for i in np.flatnonzero(np.asarray(boxes.blocks_base) & ~solid)
    ]
    if flat:
        whole = Path.make_compound_path(*(Path([*corners, corners[0]], closed=True) for corners in flat))
        axes.add_artist(PathPatch(whole, **_KEEP_OUT))  # unlike a patch that is added, it widens nothing
        around = np.concatenate([rectangle(boxes.pose[i], boxes.half_size[i]) for i in np.flatnonzero(solid)])
        axes.update_datalim([np.min(around, axis=0) - _AROUND_M, np.max(around, axis=0) + _AROUND_M])
    if np.all(np.isfinite(room.floor)):
        x_min, y_min, x_max, y_max = np.asarray(room.floor, float).tolist()
        axes.plot([x_min, x_max, x_max, x_min, x_min], [y_min, y_min, y_max, y_max, y_min], color="#8A8A8A", lw=1.0)


def legend_handles(scenes: Sequence[Scene], failures: bool) -> list[Any]:
    """One entry for every kind of thing drawn; classes only if present."""
    present = sorted({int(scene.object_class[slot]) for scene in scenes for slot in np.flatnonzero(scene.mask)})
    handles: list[Any] = [
        Patch(facecolor=CLASS_COLORS[i], edgecolor="black", lw=0.8, label=CLASS_NAMES[i])
        for i in (*(index for index in present if index >= 0), *(index for index in present if index < 0))
    ]
    handles += [
        Line2D([], [], color="black", lw=1.6, label="grasp (gripper axis)"),
        Line2D([], [], color="black", marker="$3$", ls="", ms=6, label="order of the picks"),
        Patch(facecolor=_BASE_FACE, edgecolor=BASE, label="base and the picks made there"),
        Line2D([], [], color=BASE, lw=3, label="front of the base"),
        Line2D([], [], color=BASE, marker="o", ls="", ms=4.5, label="arm mount"),
        Patch(facecolor=REACH, alpha=2 * _REACH_ALPHA, label="arm's reach on the table"),
        Line2D([], [], color=PICK, lw=0.8, label="pick"),
        Line2D([], [], color=PATH, lw=1.4, ls=(0, (5, 2)), label="drive"),
    ]
    if failures:
        handles.append(Line2D([], [], color=FAILED, marker="x", ls="", mew=2, ms=7, label="not grasped"))
    return handles


def rectangle(pose: ArrayLike, half: ArrayLike) -> np.ndarray:
    """The corners (4, 2) of a rectangle at a pose (x, y, heading)."""
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    return to_world(pose, signs * np.asarray(half))


def to_world(pose: ArrayLike, points: np.ndarray) -> np.ndarray:
    """Points (N, 2) of the frame at a pose, in the pose's parent."""
    pose = np.asarray(pose)
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return points @ np.array([[cosine, sine], [-sine, cosine]]) + pose[:2]


def stops_of(plan: Plan, outcome: Outcome) -> dict[tuple[float, ...], list[int]]:
    """The numbers of the steps made at each different base pose, from 1."""
    stops: dict[tuple[float, ...], list[int]] = {}
    for step in np.flatnonzero(outcome.is_step & plan.served):
        stops.setdefault(tuple(np.round(plan.base_pose[step], 6).tolist()), []).append(int(step) + 1)
    return stops


def _tools(scene: Scene, plan: Plan, outcome: Outcome) -> Float[np.ndarray, "M 6"]:
    """tool0 in W at the grasp by which each object is picked, or else its first: x, y, z, roll, pitch, yaw."""
    index = np.zeros(len(scene.mask), int)
    picked = np.asarray(outcome.feasible)
    index[np.asarray(plan.object_index)[picked]] = np.asarray(outcome.grasp)[picked]
    return np.asarray(scene.grasps.pose, float)[np.arange(len(index)), index]


def _mount(robot: Robot, pose: ArrayLike) -> np.ndarray:
    return to_world(pose, np.asarray(robot.mount_position)[None, :2])[0]


def _draw_reach(axes: Axes, robot: Robot, scene: Scene, plan: Plan, outcome: Outcome) -> None:
    """From each stop, the part of the surfaces in reach at the lowest height that is grasped; overlaps are darker.

    What isn't grasped doesn't count: it may be lower than the arm reaches anywhere.
    """
    heights = _tools(scene, plan, outcome)[plan.object_index[outcome.feasible], 2]
    reach = arm_reach(robot, float(np.min(heights))) if len(heights) else None
    if reach is None:
        return
    _, farthest = reach
    boxes = scene.room.boxes
    tops = [rectangle(boxes.pose[i], boxes.half_size[i]) for i in np.flatnonzero(boxes.bears_objects)]
    surfaces = Path.make_compound_path(*(Polygon(top).get_path() for top in tops))
    for pose in stops_of(plan, outcome):
        x, y = _mount(robot, pose)
        disc = Circle((x, y), farthest, facecolor=REACH, alpha=_REACH_ALPHA, edgecolor="none", zorder=1.5)
        axes.add_artist(disc)
        disc.set_clip_path(surfaces, axes.transData)


def _draw_objects(axes: Axes, scene: Scene, plan: Plan, outcome: Outcome, size: float) -> None:
    """Rectangles by class, their grasps with the way of those that don't come from above, and the steps' numbers."""
    tools = _tools(scene, plan, outcome)
    for slot in np.flatnonzero(scene.mask):
        pose, extent = scene.object_pose[slot], scene.object_size[slot]
        color = CLASS_COLORS[int(scene.object_class[slot])]
        axes.add_patch(Polygon(rectangle(pose, extent[:2] / 2), fc=color, ec="black", lw=0.8, zorder=3))
        place, axes_of_tool = tools[slot, :2], Rotation.from_euler("ZYX", tools[slot, :2:-1]).as_matrix()[:2]
        span, way = 0.05 * axes_of_tool[:, 1], SIDE_BACK_M * axes_of_tool[:, 2]
        axes.plot(*np.stack([place - span, place + span], axis=1), color="black", lw=1.6, zorder=4)
        if np.hypot(*way) > _STEEP_M:
            axes.plot(*np.stack([place, place + way], axis=1), color="black", lw=0.8, zorder=4)
        for step in np.flatnonzero(plan.object_index == slot):
            failed = not outcome.feasible[step]
            if failed:
                axes.plot(pose[0], pose[1], "x", color=FAILED, mew=2, ms=size, zorder=7)
            above = float(pose[1]) + 0.5 * float(np.hypot(extent[0], extent[1]))
            label = axes.annotate(str(step + 1), (float(pose[0]), above), ha="center", va="bottom", zorder=7)
            label.set(fontsize=size - 1, weight="bold", color=FAILED if failed else "black", path_effects=_HALO)


def _draw_stops(
    axes: Axes, robot: Robot, scene: Scene, plan: Plan, outcome: Outcome, size: float, navigation: NavigationConfig
) -> None:
    """The start, every different base pose with the steps made there, the driven path, and the picks."""
    _draw_base(axes, robot, scene.robot_start, hollow=True)
    _write(axes, scene.robot_start, "start", size)
    before, drives = scene.robot_start, make_drives(robot, scene.room, navigation)
    tools = _tools(scene, plan, outcome)
    for step in np.flatnonzero(outcome.is_step & plan.served):
        pose = plan.base_pose[step]
        if float(outcome.navigation_time[step]) > 0:
            path = _path(robot, drives, np.asarray(before), np.asarray(pose))
            axes.plot(path[:, 0], path[:, 1], color=PATH, lw=1.4, ls=(0, (5, 2)), zorder=2)
            before = pose
        grasp, mount = tools[plan.object_index[step]], _mount(robot, pose)
        if outcome.feasible[step]:
            axes.plot([mount[0], grasp[0]], [mount[1], grasp[1]], color=PICK, lw=0.8, zorder=2)
    stops = stops_of(plan, outcome)
    for (pose, numbers), place in zip(stops.items(), _apart([pose[:2] for pose in stops]), strict=True):
        _draw_base(axes, robot, np.array(pose))
        _write(axes, place, short_list(numbers), size)


def _path(robot: Robot, drives: OwnDrives, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Points (m) of a drive; its ends where only somebody else's drive times say that there is one."""
    try:
        legs = drives.manoeuvre(robot, start, goal).legs
    except ValueError:
        return np.array([start, goal])[:, :2]
    return np.array([start, *(leg.after for leg in legs)])[:, :2]


def short_list(numbers: Sequence[int]) -> str:
    """Increasing numbers as text, with runs of three and more shortened: 1, 2, 5-8."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


def _apart(places: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    """Places (m) for labels, each as near to where it belongs as those before it leave room, above or below."""
    wide, high = 0.4, 0.16  # m that a label takes
    taken: list[tuple[float, float]] = []
    for x, y in places:
        tries = [(x, y + sign * lines * high) for lines in range(len(places) + 1) for sign in (1, -1)]
        free = (spot for spot in tries if all(abs(x - u) >= wide or abs(spot[1] - v) >= 0.99 * high for u, v in taken))
        taken.append(next(free, tries[0]))
    return taken


def _write(axes: Axes, place: ArrayLike, label: str, size: float) -> None:
    x, y = np.asarray(place, float)[:2]
    text = axes.annotate(label, (float(x), float(y)), ha="center", va="center", weight="bold", zorder=8)
    text.set(fontsize=size, color=BASE, path_effects=_HALO)


def _draw_base(axes: Axes, robot: Robot, pose: ArrayLike, hollow: bool = False) -> None:
    half = np.asarray(robot.footprint_half_size)
    face = "none" if hollow else _BASE_FACE
    axes.add_patch(Polygon(rectangle(pose, half), facecolor=face, edgecolor=BASE, lw=1.1, zorder=5))
    front = to_world(pose, np.array([[half[0], -0.6 * half[1]], [half[0], 0.6 * half[1]]]))
    axes.plot(front[:, 0], front[:, 1], color=BASE, lw=3, solid_capstyle="butt", zorder=6)
    axes.plot(*_mount(robot, pose), "o", color=BASE, ms=4.5, zorder=6)
