"""Plans one scene: `python -m basenet_jax.plan scene.yaml --out plan.json`."""

import dataclasses
import io
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from basenet_jax.command_line import DrivesAndPicks, PlannerArguments, UncertaintyArguments, parse, world_of_file
from basenet_jax.config import WorldConfig
from basenet_jax.offscreen import RenderError, choose_backend

if TYPE_CHECKING:
    from basenet_jax.planners.protocol import PlannerSetup
    from basenet_jax.planners.timed import TimedPlan
    from basenet_jax.world.scene import NamedScene


@dataclass(frozen=True, kw_only=True)
class Arguments(PlannerArguments, UncertaintyArguments):
    """Plans where the robot parks and in which order it picks the objects of a scene, and prints the plan.

    Base poses are x, y (m) and heading (degrees) in the table frame: its origin is on the floor under the table's
    centre, x runs along the table's long side. N is navigation time, G grasping time, both in seconds. Exit codes:
    0 done, 2 bad input, 3 a plan was made but some objects can't be grasped (they are listed with the reason).
    """

    scene: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
    """Scene file, YAML or JSON."""
    out: Path | None = None
    """Where to write the plan, as JSON (m, rad, s). Default: it is only printed."""
    planner: str = "basenet"
    """pbg, pbg-gc, mbp, mbp-gc, dp, greedy-stops, refined, basenet-paper, basenet or basenet-sample."""
    robot: str | None = None
    """A packaged robot's name or the path of a robot file, instead of the robot that the scene names."""
    config: Path | None = None
    """YAML or JSON file of settings, such as a training's config.json, whose world is used. Options come before it."""
    world: DrivesAndPicks = field(default_factory=DrivesAndPicks)
    drives: Literal["by-room", "point", "docked"] | None = None
    """In short for --world.navigation.drives."""
    forward_only: bool = False
    """No drive goes in reverse; in short for --world.navigation.no-reverse."""
    drive_times: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File of drive times between stops, instead of the world's own drives (see the documentation of Nav2)."""
    picture: Path | None = None
    """Where to draw the plan: a name ending in .png, .pdf or .svg."""
    explain: bool = False
    """Also print from how many base poses of the grid each object can be picked, and what rules out the rest; and how
    sure each pick is where the robot parks with errors, those of --uncertainty or 2 cm and 1 degree."""
    export: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """New or empty folder for the plan as a robot's messages: base goals, arm trajectories, gripper commands."""
    export_format: tuple[Literal["yaml", "csv", "bag"], ...] = ("yaml", "csv", "bag")
    """yaml: the messages as text; csv: states over time; bag: of ROS 2 (needs the extra ros, but no ROS)."""
    table_pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """For the export: x, y (m) and yaw (degrees) of the table frame in the map that the robot navigates in; a room's
    own frame is the map's."""
    map_frame: str = "map"
    """For the export: the name of that map's frame."""
    video: Path | None = None
    """Where to film the plan: a name ending in .mp4 (needs the extra video) or .gif."""
    video_speed: float = 8.0
    """How many times faster than life the film is."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        world = world_of_file(given)
    except ValueError as error:
        return _fail(2, str(error))
    defaults = {"world": DrivesAndPicks(world.navigation, world.pick)}
    options = parse(Arguments, given, "python -m basenet_jax.plan", defaults)
    navigation = options.world.navigation
    navigation = dataclasses.replace(
        navigation,
        drives=options.drives or navigation.drives,
        reverse=navigation.reverse and not options.forward_only,
    )
    world = dataclasses.replace(world, navigation=navigation, pick=options.world.pick)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal may know fewer letters than the names of objects
    try:
        return _plan(options, world)
    except KeyboardInterrupt:
        return _fail(130, "interrupted")


def _plan(options: Arguments, world: WorldConfig) -> int:
    try:
        if options.video:
            choose_backend()  # before MuJoCo is imported
    except RenderError as error:
        return _fail(2, f"--video: {error}")
    # Here and not above: JAX and MuJoCo take seconds to import, which --help needn't wait for.
    import jax
    from rich.console import Console

    from basenet_jax.api import make_planner
    from basenet_jax.commands.plan_outputs import Wanted, check_outputs
    from basenet_jax.compilation import enable_cache
    from basenet_jax.exports import check_table_pose
    from basenet_jax.planners.protocol import PlanningError
    from basenet_jax.planners.timed import plan_timed
    from basenet_jax.task.drive_times import load_drive_times
    from basenet_jax.world.scene_file import load_scene

    enable_cache()
    try:
        check_outputs(Wanted.by(options))
        scene = load_scene(options.scene, robot=options.robot)
        check_table_pose(scene, options.table_pose)
        if scene.written_for:
            print(f"basenet_jax.plan: {options.scene} names the robot {scene.written_for}, not this", file=sys.stderr)
        times = load_drive_times(options.drive_times) if options.drive_times else None
        made_for = {"robot": scene.robot, "room": scene.arrays.room, "world": world, "grid": options.grid}
        made_for |= {"drive_times": times, "uncertainty": options.given_uncertainty()}
        made_for["reliability"] = options.reliability
        made = make_planner(options.planner, **made_for, **options.given_options())
    except ValueError as error:
        return _fail(2, str(error))
    try:
        with Console(stderr=True).status("planning (a machine's first time is mostly compiling)"):
            timed = plan_timed(made.planner, scene.arrays, jax.random.key(0))
    except PlanningError as error:
        return _fail(2, f"{options.scene}: {error}")
    return _report(options, scene, made.setup, timed)


def _report(options: Arguments, scene: "NamedScene", setup: "PlannerSetup", timed: "TimedPlan") -> int:
    """Has the plan judged, writes it and prints it; the exit code."""
    import jax

    from basenet_jax import api
    from basenet_jax.commands.plan_outputs import OutputError, Wanted, write_outputs
    from basenet_jax.commands.plan_report import (
        failures,
        nearly_singular,
        print_explanation,
        print_order,
        print_plan,
        unsure,
    )
    from basenet_jax.planners.explanation import count_reasons, what_waits
    from basenet_jax.task.reliability import Chance, with_reliability

    judged = api.execute(scene, timed.plan, world=setup.world, drive_times=setup.drive_times)
    chance = setup.chance or (Chance.of(options.errors, options.reliability) if options.explain else None)
    if chance is not None:
        about = (setup.robot, scene.arrays, timed.plan, judged, chance)
        judged = with_reliability(*about, setup.world.pick)
    plan, outcome = jax.device_get((timed.plan, judged))
    counts = count_reasons(setup, scene.arrays) if options.explain else None
    try:
        said = write_outputs(Wanted.by(options), setup, scene, timed, outcome, chance and chance.uncertainty)
    except OutputError as error:
        return _fail(2, str(error))
    print_plan(scene, plan, outcome)
    compiled = f"compiled before, in {timed.compile_time_s:.3g} s"
    print(f"planned by {options.planner} in {timed.planning_time_s:.3g} s ({compiled})")
    if counts is not None:
        print_order(scene, what_waits(setup, scene.arrays, plan))
        print_explanation(scene, counts)
    print(*said, sep="\n", end="\n" if said else "")
    for name, value in nearly_singular(scene, plan, outcome):
        print(f"note: {name} is picked near a singular pose of the arm (least singular value {value:.2g}, m and rad)")
    for name, share in unsure(scene, plan, outcome, setup) if setup.chance is not None else ():
        print(f"note: {name} can be picked in {100 * share:.0f} % of parkings only: nothing surer was found")
    failed = failures(scene, plan, outcome, setup)
    if not failed:
        return 0
    lines = "".join(f"\n  {name}: {reason}" for name, reason in failed)
    return _fail(3, f"{len(failed)} of {len(scene.names)} objects can't be grasped:{lines}")


def _fail(code: int, message: str) -> int:
    print(f"basenet_jax.plan: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
