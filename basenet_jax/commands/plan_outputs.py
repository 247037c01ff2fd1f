"""What the plan command writes: the plan, its pictures, its film, and its export for a robot."""

import io
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from math import isfinite, radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from basenet_jax import api
from basenet_jax.atomic import write_atomically
from basenet_jax.commands.output_files import check_different, check_output_file
from basenet_jax.config import UncertaintyConfig
from basenet_jax.exports import check_export
from basenet_jax.progress import make_reporter
from basenet_jax.task.motion import plan_motion
from basenet_jax.task.motion_check import Overlap, find_overlaps, thing
from basenet_jax.task.plan_file import save_plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from basenet_jax.planners.protocol import PlannerSetup
    from basenet_jax.planners.timed import TimedPlan
    from basenet_jax.task.plan import Outcome, Plan
    from basenet_jax.world.scene import NamedScene


_SPEEDS = 0.1, 1000  # of films: slower ones are longer than memory


class OutputError(ValueError):
    """An output that can't be made or written; the message says which and why."""


@dataclass(frozen=True)
class Wanted:
    """What the command is asked for beside its tables on the terminal; as options, see `basenet_jax.plan.Arguments`."""

    scene: Path  # an input, not to be overwritten
    planner: str
    out: Path | None
    picture: Path | None
    video: Path | None
    video_speed: float
    export: Path | None
    export_format: tuple[str, ...]
    table_pose: tuple[float, float, float]
    map_frame: str

    @classmethod
    def by(cls, options: Any) -> "Wanted":
        """The fields of the same names of the command's options."""
        return cls(**{each.name: getattr(options, each.name) for each in fields(cls)})


def check_outputs(options: Wanted) -> None:
    """Whether all that is asked for can be written, as far as can be told before there is a plan.

    Raises:
        ValueError: it can't; the message names the option, what was found and what is allowed.
    """
    files = {"--out": options.out, "--picture": options.picture, "--video": options.video}
    check_different({"SCENE": options.scene, **files})
    suffixes = {"--out": (), "--picture": (".png", ".pdf", ".svg"), "--video": (".mp4", ".gif")}
    for option, path in files.items():
        if path:
            check_output_file(option, path, suffixes[option])
    if options.video:
        from basenet_jax.plots import check_video  # Matplotlib takes half a second to import

        check_video("--video", options.video)
    slowest, fastest = _SPEEDS
    if not slowest <= options.video_speed <= fastest:
        raise ValueError(f"--video-speed: found {options.video_speed}, allowed are {slowest} to {fastest}")
    if options.export:
        check_export("--export", options.export, options.export_format)
    if not all(isfinite(number) for number in options.table_pose):
        raise ValueError(f"--table-pose: found {options.table_pose}, allowed are finite numbers")


def write_outputs(
    options: Wanted,
    setup: "PlannerSetup",
    scene: "NamedScene",
    timed: "TimedPlan",
    outcome: "Outcome",
    uncertainty: UncertaintyConfig | None = None,
) -> list[str]:
    """Makes all that is asked for, then writes it.

    Args:
        options: what is wanted.
        setup: what was planned for.
        scene: what was planned.
        timed: its plan.
        outcome: of executing it.
        uncertainty: that its reliabilities are of, where it has some.

    Returns:
        Lines to print.

    Raises:
        OutputError: something can't be made or written.
    """
    picture = _draw(_plot(setup, scene, timed), options.picture) if options.picture else b""
    video = _film(options, setup, scene, timed, outcome) if options.video else b""
    said: list[str] = []
    path = options.out
    try:
        if path:
            save_plan(
                path,
                scene,
                timed.plan,
                outcome,
                planner=options.planner,
                planning_time_s=timed.planning_time_s,
                compile_time_s=timed.compile_time_s,
                world=setup.world,
                drive_times=setup.drive_times.source if setup.drive_times else None,
                uncertainty=uncertainty,
                least_reliability=None if setup.chance is None else round(float(setup.chance.level), 6),
            )
        if video:
            said += overlap_notes(scene, timed.plan, _overlaps(setup, scene, timed, outcome))
        for path, content in ((options.picture, picture), (options.video, video)):
            if path:
                write_atomically(path, content)
        path = options.export
        if path:
            said += _export(options, setup, path, scene, timed, outcome)
    except OSError as error:
        raise OutputError(f"{path}: can't be written: {error.strerror}") from error
    return list(dict.fromkeys(said))


def overlap_notes(scene: "NamedScene", plan: "Plan", overlaps: Sequence[Overlap]) -> list[str]:
    """Lines on what base or arm would touch on their way.

    Args:
        scene: of the plan.
        plan: on the host.
        overlaps: of its motion.
    """
    notes = []
    for each in overlaps:
        what = "the base's drive" if each.driving else "the arm's moves"
        name, depth = scene.names[int(plan.object_index[each.step])], f"{100 * each.depth_m:.1f} cm"
        notes.append(f"note: {what} for {name} would go {depth} into {thing(each, scene.box_names)}")
    if any(each.driving for each in overlaps):
        notes.append("note: drives of a point don't look at the base's corners; --drives docked plans free ones")
    return notes


def _overlaps(setup: "PlannerSetup", scene: "NamedScene", timed: "TimedPlan", outcome: "Outcome") -> list[Overlap]:
    given = setup.drive_times is not None
    motion = plan_motion(setup.robot, scene.arrays, timed.plan, outcome, setup.world, given_times=given)
    return find_overlaps(setup.robot, setup.room, motion)


def _plot(setup: "PlannerSetup", scene: "NamedScene", timed: "TimedPlan") -> "Figure":
    return api.plot_plan(scene, timed.plan, world=setup.world, drive_times=setup.drive_times)


def _draw(figure: "Figure", path: Path) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix.lower()[1:], dpi=150, bbox_inches="tight")
    return buffer.getvalue()


def _film(options: Wanted, setup: "PlannerSetup", scene: "NamedScene", timed: "TimedPlan", outcome: "Outcome") -> bytes:
    from basenet_jax.plots import RenderError, encode_video, render_video

    assert options.video
    suffix = options.video.suffix.lower()
    # A GIF of 960 x 640 pixels and 30 frames a second would take tens of MB.
    size = {"width": 480, "height": 320, "frames_per_s": 10.0} if suffix == ".gif" else {}
    how = {"speed": options.video_speed, "config": setup.world, "given_times": setup.drive_times is not None}
    try:
        video = render_video(setup.robot, scene.arrays, timed.plan, outcome, **how, **size)
    except ValueError as error:
        raise OutputError(f"--video: {error}") from error
    reporter = make_reporter()

    def frames() -> Iterator[np.ndarray]:
        reporter.start("film", video.frame_count, unit="frames")
        for done, frame in enumerate(video.frames, start=1):
            yield frame
            reporter.update(done, {})

    try:
        return encode_video(suffix, frames(), video.frames_per_s)
    except RenderError as error:
        raise OutputError(f"--video: {error}") from error
    finally:
        reporter.finish()


def _export(
    options: Wanted,
    setup: "PlannerSetup",
    folder: Path,
    scene: "NamedScene",
    timed: "TimedPlan",
    outcome: "Outcome",
) -> list[str]:
    if not outcome.grasped:
        return [f"nothing is exported to {folder}: no object can be grasped"]
    x, y, yaw = options.table_pose
    done = api.export_plan(
        scene,
        timed.plan,
        folder,
        table_pose=(x, y, radians(yaw)),
        map_frame=options.map_frame,
        formats=options.export_format,
        world=setup.world,
        drive_times=setup.drive_times,
    )
    if done.left_out:
        names = ", ".join(f"{name} ({reason})" for name, reason in done.left_out.items())
        print(f"basenet_jax.plan: the export leaves out {names}", file=sys.stderr)
    files = ", ".join(path.name for path in done.files)
    said = f"exported to {folder}: {files}; the robot takes {done.duration_s:.1f} s"
    return [said, *overlap_notes(scene, jax.device_get(timed.plan), done.overlaps)]
