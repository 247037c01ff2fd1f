"""Trains all layers and says what they are worth: `python -m basenet_jax.train --objects 10`."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from basenet_jax.command_line import base_config, parse, peek
from basenet_jax.config import WorldConfig
from basenet_jax.learning.config import ReinforceConfig, SacConfig, StopLearningConfig, TrainConfig

_SHARED = ("preset", "seed", "robot", "world", "sac", "reinforce", "stops", "evaluation_objects", "evaluation_scenes")


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
    """A packaged robot (panda_mobile, ridgeback_ur5e, ur10e_mobile, ur3e_mobile, ur5e_mobile), or a robot file."""
    devices: int | None = None
    """How many of this machine's devices share the work; the result is one device's up to rounding. Default: all."""
    layer: Literal["base-pose", "sequence", "stops", "all"] = "all"
    """What to train; sequence needs the base-pose weights of the run directory."""
    config: Path | None = None
    """YAML or JSON file of settings instead of the preset's, such as another run's config.json, which repeats that run.
    Only what differs need be there; options come before it. With --resume, by default that of the run."""
    evaluation_objects: tuple[int, ...] = (5, 10)
    """Numbers of objects in the random scenes of the last evaluation."""
    evaluation_scenes: int = 50
    """How many of each."""
    world: WorldConfig = field(default_factory=WorldConfig)
    sac: SacConfig = field(default_factory=SacConfig)
    """Of the base-pose layer: Soft Actor-Critic; one iteration is a batch of fresh episodes and some updates."""
    reinforce: ReinforceConfig = field(default_factory=ReinforceConfig)
    """Of the sequence layer: REINFORCE with a greedy-rollout baseline."""
    stops: StopLearningConfig = field(default_factory=StopLearningConfig)
    """Of the stops layer: imitation, then REINFORCE."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    from basenet_jax.learning.config import make_preset

    given = sys.argv[1:] if arguments is None else arguments
    try:
        base = base_config(given, make_preset, _file(given))
    except ValueError as error:
        return _fail(2, str(error))
    shared = {name: getattr(base, name) for name in _SHARED}
    defaults = shared | {"objects": base.reinforce.objects, "run_dir": None}
    options = parse(Arguments, given, "python -m basenet_jax.train", defaults)
    if not 1 <= options.objects <= 50:
        return _fail(2, f"--objects: found {options.objects}, allowed are 1 to 50")
    if options.resume and options.run_dir is None:
        return _fail(2, "--resume: needs the run to continue, as --run-dir DIR")
    try:
        return _train(options, base)
    except KeyboardInterrupt:
        return _fail(130, "interrupted before there was a run")


def _train(options: Arguments, base: TrainConfig) -> int:
    # Here and not above: JAX, Brax and MuJoCo take seconds to import, which --help needn't wait for.
    from basenet_jax.commands.output_files import check_name
    from basenet_jax.compilation import enable_cache
    from basenet_jax.devices import use_devices
    from basenet_jax.evaluation.summary import print_summary, summarise
    from basenet_jax.learning.checkpoint import CheckpointError
    from basenet_jax.learning.run_directory import RunDirectory, default_path
    from basenet_jax.learning.training import Training
    from basenet_jax.learning.training_loop import Interrupted, TrainingDiverged
    from basenet_jax.progress import make_reporter
    from basenet_jax.robot.reading import load_robot, packaged_robots, robot_digest

    enable_cache()
    try:
        robot = load_robot(options.robot)
    except ValueError as error:
        return _fail(2, str(error))
    digest = None if robot.name in packaged_robots() else robot_digest(robot)
    if base.robot_digest and (base.robot, base.robot_digest) != (robot.name, digest):
        hint = "without robot_digest in the configuration another one is trained for"
        return _fail(2, f"robot: found {robot.name}, which isn't the one that the configuration is for; {hint}")
    try:
        settings = {name: getattr(options, name) for name in _SHARED}
        config = TrainConfig(**settings | {"robot": robot.name, "robot_digest": digest})
    except ValueError as error:
        return _fail(2, str(error))
    try:
        training = Training(config, robot, use_devices(options.devices))
    except ValueError as error:
        return _fail(2, f"--{error}")
    path = options.run_dir or default_path(options.preset, options.seed)
    reporter = make_reporter()
    try:
        check_name("--run-dir", path)
        training.check(path, options.layer)
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


def _file(arguments: Sequence[str]) -> str | None:
    """The file of settings: the one that is named, else that of a run to resume."""
    named, run = peek(arguments, "--config"), peek(arguments, "--run-dir")
    if named is not None or run is None or "--resume" not in arguments:
        return named
    own = Path(run) / "config.json"
    return str(own) if own.is_file() else None


def _resume_command(options: Arguments, path: Path) -> str:
    """The other settings stand in the run's own file."""
    command = f"python -m basenet_jax.train --robot {shlex.quote(options.robot)} --layer {options.layer}"
    command += "" if options.devices is None else f" --devices {options.devices}"
    return f"{command} --run-dir {shlex.quote(str(path))} --resume"


def _fail(code: int, message: str) -> int:
    print(f"basenet_jax.train: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
