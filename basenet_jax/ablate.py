"""The paper's ablations, several seeds at once: `python -m basenet_jax.ablate --out ablation`."""

import dataclasses
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from basenet_jax.command_line import base_config, parse, peek
from basenet_jax.config import WorldConfig
from basenet_jax.learning.config import AblationConfig, Preset, ReinforceConfig, SacConfig

if TYPE_CHECKING:
    from basenet_jax.learning.ablation import Ablation
    from basenet_jax.learning.run_directory import RunDirectory

_SHARED = ("preset", "seed", "seeds", "world", "sac", "reinforce")


@dataclass(frozen=True)
class Arguments:
    """Trains the paper's choices and what it compares them with, and draws both.

    base-frame: base poses predicted in the object's frame or in the table's. baseline: REINFORCE with the
    greedy-rollout baseline or without any. attention: graph attention or a plain sum over the other objects. All seeds
    of a variant are trained side by side in one program. Into --out come ablation.md and ablation.json with the mean,
    least and most over the seeds, curves as pictures, and where the learned policies park for 1,000 random objects. An
    interrupted ablation is continued with --resume.
    """

    out: Path
    """Folder for the results and everything needed to resume."""
    studies: tuple[Literal["base-frame", "baseline", "attention"], ...] = ("base-frame", "baseline", "attention")
    """What to ablate."""
    seeds: int = 5
    """Trained side by side, 1 to 32."""
    preset: Literal["quick", "default", "paper"] = "quick"
    """How long and how faithfully to train. On two CPU cores quick takes about half an hour for all studies."""
    objects: int = 10
    """Number of objects, 1 to 50: the sequence policies train on scenes with 1 to this many."""
    seed: int = 0
    """Of everything random."""
    weights: Path | None = None
    """Weights file with the base-pose policy under the sequence's studies. Default: the packaged one."""
    resume: bool = False
    """Continue what is in --out."""
    config: Path | None = None
    """YAML or JSON file of settings instead of the preset's, such as another ablation's config.json. Only what differs
    need be there; options come before it."""
    world: WorldConfig = field(default_factory=WorldConfig)
    sac: SacConfig = field(default_factory=SacConfig)
    """Of the base-pose learner: Soft Actor-Critic; the study sets its frame."""
    reinforce: ReinforceConfig = field(default_factory=ReinforceConfig)
    """Of the sequence learner: REINFORCE; the studies set attention and baseline."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        base = base_config(given, _from_preset, peek(given, "--config"), "quick")
    except ValueError as error:
        return _fail(2, str(error))
    defaults = {name: getattr(base, name) for name in _SHARED} | {"objects": base.reinforce.objects}
    options = parse(Arguments, given, "python -m basenet_jax.ablate", defaults)
    for name, value, most in (("objects", options.objects, 50), ("seeds", options.seeds, 32)):
        if not 1 <= value <= most:
            return _fail(2, f"--{name}: found {value}, allowed are 1 to {most}")
    if not options.studies:
        return _fail(2, "--studies: found none, at least one of base-frame, baseline and attention is needed")
    try:
        return _ablate(options, base, given)
    except KeyboardInterrupt:  # outside training, which says more
        return _fail(130, f"interrupted; --resume continues what {options.out} holds")


def _ablate(options: Arguments, base: AblationConfig, given: list[str]) -> int:
    # Here and not above: JAX, Brax and MuJoCo take seconds to import, which --help needn't wait for.
    import jax

    from basenet_jax.compilation import enable_cache
    from basenet_jax.evaluation.provenance import command, weights_fingerprint
    from basenet_jax.learning.ablation import Ablation
    from basenet_jax.learning.checkpoint import CheckpointError
    from basenet_jax.learning.run_directory import RunDirectory
    from basenet_jax.learning.training_loop import Interrupted, TrainingDiverged
    from basenet_jax.policies.trained import load_policies
    from basenet_jax.progress import make_reporter
    from basenet_jax.robot.reading import load_robot

    enable_cache()
    reporter = make_reporter()
    try:
        base_pose = load_policies(options.weights).base_pose
        settings = {name: getattr(options, name) for name in _SHARED}
        digest = weights_fingerprint(options.weights)["sha256"]
        config = dataclasses.replace(base, **settings, base_pose_weights=digest)
        ablation = Ablation(config, jax.device_put(load_robot(config.robot)), base_pose)
        with RunDirectory(options.out, config, resume=options.resume) as run:
            states = ablation.train(options.studies, run, reporter, resume=options.resume)
            reporter.stage("evaluating ...")
            print(_write(options, ablation, run, states, command("basenet_jax.ablate", given)))
    except Interrupted as interrupted:
        return _fail(130, f"{interrupted.layer}: interrupted; to resume, add --resume to the same command")
    except (CheckpointError, TrainingDiverged) as error:
        return _fail(1, str(error))
    except ValueError as error:
        return _fail(2, str(error))
    except OSError as error:
        return _fail(1, f"{options.out}: can't be written: {error.strerror}")
    return 0


def _from_preset(preset: Preset, *, objects: int, seed: int) -> AblationConfig:
    from basenet_jax.learning.config import make_ablation

    return make_ablation(preset, objects=objects, seed=seed, seeds=5, base_pose_weights="")


def _write(options: Arguments, ablation: "Ablation", run: "RunDirectory", states: dict[str, Any], command: str) -> str:
    """Writes figures and pictures; returns the figures as text."""
    import json

    from basenet_jax.atomic import write_atomically
    from basenet_jax.evaluation.ablation import FIGURES, as_markdown, base_poses, final_figures, read_curves
    from basenet_jax.evaluation.provenance import commit, hardware, versions
    from basenet_jax.plots.ablation import plot_base_poses, plot_curves

    curves = read_curves(run.path / "metrics.jsonl", options.studies)
    for study, variants in curves.items():
        plot_curves(variants, FIGURES[study]).savefig(options.out / f"{study}.png", dpi=150)
    poses = base_poses(ablation, states, options.seed + 1) if "base-frame" in options.studies else {}
    if poses:
        table = ablation.config.world.table
        clouds = {name: (each.pose, each.success, each.share) for name, each in poses.items()}
        picture = plot_base_poses(clouds, (table.length_m / 2, table.width_m / 2))
        picture.savefig(options.out / "base-poses.png", dpi=150)
    final = final_figures(curves)
    about = {"command": command, "versions": versions(), "hardware": hardware(), "commit": commit()}
    shares = {name: each.success_of_seeds for name, each in poses.items()}
    content = about | {"seeds": options.seeds, "studies": final, "base_pose_success": shares}
    write_atomically(options.out / "ablation.json", json.dumps(content, indent=2, allow_nan=False).encode() + b"\n")
    text = as_markdown(final, poses, command)
    write_atomically(options.out / "ablation.md", text.encode())
    return text


def _fail(code: int, message: str) -> int:
    print(f"basenet_jax.ablate: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
