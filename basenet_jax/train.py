"""Trains all layers and says what they are worth: `python -m basenet_jax.train --objects 10`."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro


@dataclass(frozen=True)
class Arguments:
    """Trains the paper's two layers, base-pose policy and grasp-sequence policy, then the stop policy, and evaluates.

    Planner basenet-paper uses the first two, basenet and basenet-sample the third, which needs no other layer. Times
    are in seconds. On two CPU cores the quick preset takes about 5 minutes, the default one about 20. An
    interrupted run (Ctrl-C, or a kill at any moment) is continued with --run-dir DIR --resume and ends with the very
    weights of an uninterrupted one.
    """

    objects: int = 10
    """Number of objects, 1 to 50: training draws scenes with 1 to this many."""
    preset: Literal["quick", "default", "paper"] = "default"
    """How long and how faithfully to train."""
    seed: int = 0
    """Of everything random: one seed gives one result on one machine."""
    run_dir: Path | None = None
    """Where to write. Default: runs/PRESET-SEED-TIME."""
    resume: bool = False
    """Continue the run in --run-dir."""
    robot: str = "ur5e_mobile"
    """A packaged robot (panda_mobile, ur10e_mobile, ur3e_mobile, ur5e_mobile), or the path of a robot file."""
    devices: int | None = None
    """How many of this machine's devices share the work; the result is one device's up to rounding. Default: all."""
    layer: Literal["base-pose", "sequence", "stops", "all"] = "all"
    """What to train; sequence needs the base-pose weights of the run directory."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    options = tyro.cli(Arguments, args=arguments, prog="python -m basenet_jax.train")
    if not 1 <= options.objects <= 50:
        return _fail(2, f"--objects: found {options.objects}, allowed are 1 to 50")
    if options.resume and options.run_dir is None:
        return _fail(2, "--resume: needs the run to continue, as --run-dir DIR")
    try:
        return _train(options)
    except KeyboardInterrupt:
        return _fail(130, "interrupted before there was a run")


def _train(options: Arguments) -> int:
    # Here and not above: JAX, Brax and MuJoCo take seconds to import, which --help needn't wait for.
    from basenet_jax.compilation import enable_cache
    from basenet_jax.devices import use_devices
    from basenet_jax.evaluation.summary import print_summary, summarise
    from basenet_jax.learning.checkpoint import CheckpointError
    from basenet_jax.learning.config import make_preset
    from basenet_jax.learning.progress import make_reporter
    from basenet_jax.learning.run_directory import RunDirectory, default_path
    from basenet_jax.learning.training import Training
    from basenet_jax.learning.training_loop import Interrupted, TrainingDiverged
    from basenet_jax.robot.reading import load_robot, packaged_robots, robot_digest

    enable_cache()
    try:
        robot = load_robot(options.robot)
    except ValueError as error:
        return _fail(2, str(error))
    digest = None if robot.name in packaged_robots() else robot_digest(robot)
    config = make_preset(
        options.preset, objects=options.objects, seed=options.seed, robot=robot.name, robot_digest=digest
    )
    try:
        training = Training(config, robot, use_devices(options.devices))
    except ValueError as error:
        return _fail(2, f"--{error}")
    path = options.run_dir or default_path(options.preset, options.seed)
    reporter = make_reporter()
    try:
        with RunDirectory(path, config, resume=options.resume) as run:
            reporter.note(f"run directory: {path}")
            weights = training.train(run, reporter, layer=options.layer, resume=options.resume)
            reporter.stage("evaluating ...")
            summary = summarise(training, weights)
            run.write_summary(summary)
            print_summary(summary)
    except Interrupted as interrupted:
        return _fail(130, f"{interrupted.layer}: interrupted; to resume:\n{_resume_command(options, path)}")
    except KeyboardInterrupt:  # between layers, or while evaluating
        return _fail(130, f"interrupted; to resume:\n{_resume_command(options, path)}")
    except (CheckpointError, TrainingDiverged) as error:
        return _fail(1, str(error))
    except ValueError as error:
        return _fail(2, str(error))
    return 0


def _resume_command(options: Arguments, path: Path) -> str:
    command = f"python -m basenet_jax.train --objects {options.objects} --preset {options.preset}"
    command += f" --seed {options.seed} --robot {shlex.quote(options.robot)} --layer {options.layer}"
    command += "" if options.devices is None else f" --devices {options.devices}"
    return f"{command} --run-dir {shlex.quote(str(path))} --resume"


def _fail(code: int, message: str) -> int:
    print(f"basenet_jax.train: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
