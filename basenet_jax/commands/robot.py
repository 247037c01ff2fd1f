"""Looks at robots: `python -m basenet_jax.robot check my_arm.yaml --out folder`; `init my_arm.urdf`, `list`."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from basenet_jax.commands.robot_report import Findings
    from basenet_jax.robot.model import Robot


@dataclass(frozen=True)
class Check:
    """Says in a minute what is wrong or right with a robot file.

    Reads the file and its model; compares forward kinematics and Jacobian with MuJoCo's; solves inverse kinematics
    for random poses in reach; and looks for base poses that serve random top-down grasps on the default table. Where
    less than half is served, it tries other tool frames, mount heights, joint limits and shapes, and names what helps.
    Lengths in m, times in s. Exit codes: 0 the robot can pick, 2 the file is refused, 3 it is read but can't be used
    as it is, or serves less than a tenth.
    """

    robot: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """A robot file, or a packaged robot's name."""
    package: tuple[str, ...] = ()
    """Description packages that lie elsewhere, NAME=DIR each, for package://NAME/... in the model."""
    out: Path | None = None
    """Folder for two pictures, NAME-frames.png and NAME-reach.png; made if it isn't there."""
    grasps: int = 128
    """How many random grasps."""
    seed: int = 0
    """Of everything random."""


@dataclass(frozen=True)
class Init:
    """Writes a first robot file for a URDF or MJCF, what is guessed marked.

    Finds the arm's joints and frames, takes limits and speeds as the model has them, and searches for a posture with
    the tool straight down over a deck, clear of body and table, on a base that is guessed. Correct what is marked, then
    `check` it. Exit codes: 0 it is written, 2 there is no such model, arm or posture, or a file is there already.
    """

    model: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL")]
    """A URDF or MJCF."""
    out: Path | None = None
    """The robot file, in the model's folder or in one above it. Default: robot.yaml beside the model."""
    arm_base: str | None = None
    """The frame that the arm stands on. Default: the one before its first joint."""
    tool: str | None = None
    """The tool's frame, which says which arm is meant. Default: the likeliest."""
    package: tuple[str, ...] = ()
    """Description packages that lie elsewhere, NAME=DIR each, for package://NAME/... in the model."""


@dataclass(frozen=True)
class List:
    """Names the robots that come with the package."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    commands = (
        Annotated[Check, tyro.conf.subcommand("check")]
        | Annotated[Init, tyro.conf.subcommand("init")]
        | Annotated[List, tyro.conf.subcommand("list")]
    )
    options = tyro.cli(commands, args=arguments, prog="python -m basenet_jax.robot")
    if isinstance(options, List):
        from basenet_jax.robot.reading import packaged_robots

        print("\n".join(packaged_robots()))
        return 0
    if isinstance(options, Init):
        return _init(options)
    if not 1 <= options.grasps <= 10_000:
        return _fail(2, f"--grasps: found {options.grasps}, allowed are 1 to 10000")
    try:
        return _check(options)
    except KeyboardInterrupt:
        return _fail(130, "interrupted")


def _init(options: Init) -> int:
    from basenet_jax.atomic import write_atomically
    from basenet_jax.compilation import enable_cache
    from basenet_jax.robot.first_file import write_first_file

    enable_cache()
    out = options.out or options.model.parent / "robot.yaml"
    if out.exists():
        return _fail(2, f"--out: {out} is there already")
    try:
        packages = _packages(options.package)
        text, chain = write_first_file(
            options.model, out, arm_base=options.arm_base, tool=options.tool, packages=packages
        )
        write_atomically(out, text.encode())
    except ValueError as error:
        return _fail(2, f"{options.model}: {error}")
    except OSError as error:
        return _fail(2, f"--out: {out} can't be written: {error.strerror}")
    print(f"wrote {out}: {len(chain.joints)} joints from {chain.arm_base} to {chain.tool}; correct what is guessed")
    if chain.others:
        print(f"other tool frames (--tool): {', '.join(chain.others[:10])}")
    print(f"then: python -m basenet_jax.robot check {out} --out check")
    return 0


def _check(options: Check) -> int:
    # Here and not above: JAX and MuJoCo take seconds to import, which --help needn't wait for.
    from basenet_jax.commands.robot_report import report
    from basenet_jax.compilation import enable_cache
    from basenet_jax.robot.reading import find_source

    enable_cache()
    try:
        source = find_source(options.robot, _packages(options.package))
        if options.out:
            options.out.mkdir(parents=True, exist_ok=True)
    except ValueError as error:
        return _fail(2, str(error))
    except OSError as error:
        return _fail(2, f"--out: {options.out} can't be a folder to write to: {error.strerror}")
    findings = report(source, options.grasps, options.seed)
    try:
        if options.out:
            _draw(source.robot, findings, options.out)
    except OSError as error:
        return _fail(2, f"--out: {options.out} can't be written: {error.strerror}")
    if findings.faults:
        return _fail(3, "\n  ".join([f"{source.robot.name}:", *findings.faults]))
    return 0


def _packages(given: tuple[str, ...]) -> dict[str, Path]:
    """Folders by packages' names.

    Raises:
        ValueError: one isn't NAME=DIR, or no folder.
    """
    packages = {}
    for each in given:
        name, _, folder = each.partition("=")
        if not name or not folder or not Path(folder).is_dir():
            raise ValueError(f"--package: found {each!r}, allowed are NAME=DIR, a package's name and its folder")
        packages[name] = Path(folder).resolve()
    return packages


def _draw(robot: "Robot", findings: "Findings", folder: Path) -> None:
    from basenet_jax.plots.robot import plot_robot, plot_service
    from basenet_jax.world.boxes import Room

    served = findings.served
    title = f"{robot.name}: {100 * served.share:.1f} % of {len(findings.grasps)} random top-down grasps are served"
    reach = plot_service(Room.from_config(), findings.grasps, served.served, served.base_pose, title)
    for name, figure in (("frames", plot_robot(robot)), ("reach", reach)):
        path = folder / f"{robot.name}-{name}.png"
        figure.savefig(path, dpi=110)
        print(f"wrote {path}")


def _fail(code: int, message: str) -> int:
    print(f"basenet_jax.robot: {message}", file=sys.stderr)
    return code
