"""The problem in five pictures, drawn into docs/pictures: reach, base poses, drives, shared stops, and time."""

import sys
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon

import basenet_jax as bn
from basenet_jax.compilation import enable_cache
from basenet_jax.config import GridConfig
from basenet_jax.planners.candidates import check_candidates, grid_poses
from basenet_jax.plots.arm_reach import arm_reach
from basenet_jax.plots.comparison import PlannedScene, plot_comparison
from basenet_jax.plots.drawing import BASE, CLASS_COLORS, PATH, REACH, rectangle, to_world
from basenet_jax.task.motion import Doing, plan_motion
from basenet_jax.task.navigation import navigation_path
from basenet_jax.world.boxes import Room
from basenet_jax.world.scene import Scene

DOTS_PER_INCH = 110
_GOOD, _BAD = "#009E73", "#B00020"
_JOINTS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#444444")


@dataclass(frozen=True)
class Options:
    """What is drawn and where."""

    out: Path = Path("docs/pictures")
    """Folder of the pictures."""
    seed: int = 3
    """Of the scene."""
    objects: int = 6
    """In the scene."""


def main(arguments: list[str] | None = None) -> None:
    """Draws all pictures."""
    options = tyro.cli(Options, args=arguments, prog="python -m benchmarks.problem_pictures", description=__doc__)
    enable_cache()
    robot = bn.load_robot()
    scene = bn.sample_scene(jax.random.key(options.seed), objects=options.objects)
    plan = bn.make_plan(scene, planner="basenet")
    arrays: Scene = jax.device_get(scene.arrays)
    figures = {
        "1-reach.png": reach(robot, arrays, np.asarray(plan.base_pose[0])),
        "2-base-poses.png": base_poses(robot, arrays),
        "3-drives.png": drives(robot, arrays, np.array([-0.6, -0.76, 0.0])),
        "4-stops.png": stops(robot, scene),
        "5-time.png": over_time(robot, scene, plan),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(options.out / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        print(f"problem_pictures: wrote {options.out / name}", file=sys.stderr)


def reach(robot: bn.Robot, scene: Scene, pose: np.ndarray) -> Figure:
    """Which objects can be picked from one base pose, and which can't and why."""
    figure, axes = _from_above(scene)
    _base(axes, robot, pose)
    mount = to_world(pose, np.asarray(robot.mount_position)[None, :2])[0]
    if within := arm_reach(robot, float(np.min(np.asarray(scene.first_grasp)[:, 2]))):
        axes.add_patch(Circle(tuple(mount), within[1], fc=REACH, alpha=0.12, ec="none", zorder=1.5))
    axes.plot(*mount, "o", color=BASE, ms=5, zorder=7)
    picks = jax.jit(bn.pick)(robot, np.tile(pose, (len(scene.mask), 1)), scene.grasps, scene.room)
    for slot, feasible in enumerate(np.asarray(picks.feasible)):
        x, y = scene.object_pose[slot][:2].tolist()
        if feasible:
            axes.plot(
                [mount[0], scene.first_grasp[slot][0]],
                [mount[1], scene.first_grasp[slot][1]],
                color=_GOOD,
                lw=1,
                zorder=2,
            )
            seconds = f"{float(picks.time[slot]):.1f} s"
            axes.annotate(seconds, (x + 0.13, y), va="center", color=_GOOD, weight="bold", zorder=8)
        else:
            axes.plot(x, y, "x", color=_BAD, ms=13, mew=2.5, zorder=8)
    reasons = {bn.Reason(int(each)).name.lower().replace("_", " ") for each in picks.reason if each}
    handles = [
        Line2D([], [], color=_GOOD, lw=1, label="pick, and how long it takes"),
        Line2D([], [], color=_BAD, marker="x", ms=9, mew=2.5, ls="", label=f"no pick: {', '.join(sorted(reasons))}"),
        Patch(facecolor=REACH, alpha=0.24, label="the arm's reach from above"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    axes.set_title("What can be picked from one base pose")
    return figure


def base_poses(robot: bn.Robot, scene: Scene, slot: int = 0) -> Figure:
    """Where the base can park for one object, and how long the pick takes from there, at the best heading."""
    poses = grid_poses(robot, scene.room, GridConfig(step_m=0.05))
    found = jax.device_get(check_candidates(robot, scene, poses))
    time = np.where(found.serves[:, slot], found.pick_time[:, slot], np.inf)
    best: dict[tuple[float, float], float] = {}
    for (x, y, _), seconds in zip(np.round(poses, 3).tolist(), time.tolist(), strict=True):
        best[x, y] = min(best.get((x, y), np.inf), seconds)
    places = np.array([[x, y, seconds] for (x, y), seconds in best.items() if np.isfinite(seconds)])
    figure, axes = _from_above(scene, only=slot)
    dots = axes.scatter(places[:, 0], places[:, 1], c=places[:, 2], s=9, marker="s", cmap="viridis_r", zorder=2)
    figure.colorbar(dots, ax=axes, label="pick time at the best heading (s)", shrink=0.7)
    axes.set_title("Base poses from which one object can be picked: many, and not equally good")
    return figure


def drives(robot: bn.Robot, scene: Scene, goal: np.ndarray) -> Figure:
    """How long the base drives from its start to everywhere, at the best heading, and one drive round the table."""
    start = np.asarray(scene.robot_start)
    x, y = np.meshgrid(np.arange(-2.6, 3.11, 0.05), np.arange(-1.8, 1.81, 0.05))
    headings = np.linspace(-np.pi, np.pi, 16, endpoint=False)
    goals = np.stack(np.broadcast_arrays(x[..., None], y[..., None], headings), axis=-1).astype(np.float32)
    time = np.min(jax.jit(bn.navigation_time)(robot, start, goals, scene.room), axis=-1)
    figure, axes = _from_above(scene)
    picture = axes.contourf(x, y, np.where(np.isfinite(time), time, np.nan), levels=16, cmap="viridis_r", zorder=0.5)
    figure.colorbar(picture, ax=axes, label="navigation time at the best heading (s)", shrink=0.8)
    _base(axes, robot, start)
    _base(axes, robot, goal)
    path = navigation_path(robot, start, goal, scene.room)
    axes.plot(*path.T, color="white", lw=2, ls=(0, (5, 2)), zorder=4)
    took = float(bn.navigation_time(robot, jnp.asarray(start), jnp.asarray(goal), scene.room))
    axes.set_title(f"A drive: turn, drive round the table, turn; this one takes {took:.1f} s")
    return figure


def stops(robot: bn.Robot, scene: bn.NamedScene) -> Figure:
    """A base pose for every object, beside stops that objects share."""
    planned = {}
    for name in ("basenet-paper", "basenet"):
        plan = bn.make_plan(scene, planner=name)
        planned[name] = PlannedScene(plan, bn.execute(scene, plan))
    return plot_comparison(robot, scene.arrays, planned, columns=2)


def over_time(robot: bn.Robot, scene: bn.NamedScene, plan: bn.Plan) -> Figure:
    """What the robot does when, and how fast its joints turn meanwhile."""
    motion = plan_motion(robot, scene.arrays, plan, bn.execute(scene, plan))
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    bars, axes = figure.subplots(2, 1, sharex=True, height_ratios=(1, 4))
    for key, part in enumerate(motion.parts):
        begin, length = motion.time[key], part.law.duration_s
        base = part.doing in (Doing.TURN, Doing.DRIVE)
        gripper = part.doing in (Doing.CLOSE, Doing.OPEN)
        bars.barh(
            0, length, left=begin, color=PATH if base else "#D55E00" if gripper else "#56B4E9", ec="white", lw=0.3
        )
        if not (base or gripper):
            time = np.linspace(0.0, length, 60)
            speed = np.outer(part.law.at(time).speed, motion.joints[key + 1] - motion.joints[key])
            for joint, color in enumerate(_JOINTS):
                axes.plot(begin + time, speed[:, joint], color=color, lw=1.0)
    bars.set_yticks([])
    kinds = ((PATH, "driving"), ("#56B4E9", "arm"), ("#D55E00", "gripper"))
    handles = [Patch(color=color, label=name) for color, name in kinds]
    bars.legend(handles=handles, ncols=3, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    axes.set_ylabel("joint speed (rad/s)")
    axes.set_xlabel("time (s)")
    axes.set_xlim(0.0, float(motion.time[-1]))
    joints = [Line2D([], [], color=color, label=name) for color, name in zip(_JOINTS, robot.joint_names, strict=True)]
    figure.legend(handles=joints, loc="outside right upper", frameon=False)
    return figure


def _from_above(scene: Scene, only: int | None = None) -> tuple[Figure, Axes]:
    """Table and objects."""
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    axes = figure.subplots()
    room: Room = scene.room
    axes.add_patch(Polygon(rectangle((0.0, 0.0, 0.0), room.table_half_size), fc="#EFE6D8", ec="#8A7A60", zorder=1))
    for slot in np.flatnonzero(scene.mask) if only is None else [only]:
        outline = rectangle(scene.object_pose[slot], scene.object_size[slot][:2] / 2)
        axes.add_patch(Polygon(outline, fc=CLASS_COLORS[int(scene.object_class[slot])], ec="black", lw=0.8, zorder=3))
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.autoscale_view()
    return figure, axes


def _base(axes: Axes, robot: bn.Robot, pose: np.ndarray) -> None:
    half = np.asarray(robot.footprint_half_size)
    axes.add_patch(Polygon(rectangle(pose, half), facecolor=(1, 1, 1, 0.5), edgecolor=BASE, lw=1.3, zorder=5))
    front = rectangle(pose, half)[[0, 3]]
    axes.plot(*front.T, color=BASE, lw=3, zorder=6)
    axes.autoscale_view()


if __name__ == "__main__":
    main()
