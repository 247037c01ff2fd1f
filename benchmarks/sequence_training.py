"""Training speed of the grasp sequence: REINFORCE, ours beside the same in eager PyTorch.

REINFORCE is measured with 1 to 10 objects in a scene, as in training, beside 10 in every scene (arrays have room for
10 in both); and the updates alone beside a whole interval with the baseline's t-test and the evaluation. An episode
is one that gives gradient: the baseline's greedy rollouts, the t-test's and the evaluation's are cost, not episodes.
The networks are the presets'. Time depends on the weights only through how long episodes go on: see `driven_to`.

PyTorch (`eager_sequence`) does an update as it is usually written: the same networks with the same parameters, the
same number of episodes at once, a Python loop over the steps, gradients through whole episodes. It gets its scenes
made beforehand, ours draws them within the update. Ours uses all cores, PyTorch one or all.
"""

import dataclasses
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from basenet_jax.learning.config import ReinforceConfig, TrainConfig
from basenet_jax.learning.reinforce import Reinforce, ReinforceState
from basenet_jax.learning.training import Training
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.world.scene import Scene
from benchmarks import environment
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.peers import installed
from benchmarks.timing import compare, measure_plain, measure_steps, speed
from benchmarks.trained import load_base_pose

NAME = "sequence_training"
UPDATES_PER_RUN = 5  # of REINFORCE, where updates are timed alone
UPDATES = "updates"


@dataclasses.dataclass(frozen=True)
class TrainingOptions(Options):
    """Options, and which base-pose policy to train with."""

    weights: Path | None = None
    """A run's weights/base_pose.weights. Default: an untrained policy of the same size."""
    intervals: bool = True
    """Also time whole intervals, which takes most of the time; not with --quick."""


class AllObjects(Reinforce):
    """The learner with all objects in every training scene."""

    def draw(self, key: Array, count: int, *, vary_count: bool, own_class_share: float) -> Scene:
        """Scenes with all objects, whatever is asked for."""
        del vary_count
        return super().draw(key, count, vary_count=False, own_class_share=own_class_share)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(TrainingOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    options = dataclasses.replace(options, intervals=options.intervals and not options.quick)
    reinforce = ReinforceConfig()
    training = Training(TrainConfig(reinforce=_quick(reinforce) if options.quick else reinforce))
    key = jax.random.key(options.seed)
    try:
        base_pose, source = load_base_pose(options.weights, training, key)
    except ValueError as error:
        raise SystemExit(f"{NAME}: {error}") from error
    ours, theirs = _reinforce(training, base_pose, key, options), []
    facts = {"weights": source, "peak_memory_of_ours_gib": environment.peak_memory_gib()}
    if installed("torch", asked_by=NAME):
        theirs = _eager(training, base_pose, key, options)
    results = [*ours, *theirs]
    updates = [row for row in ours if row["part"] == UPDATES]
    return report.finish(
        results,
        table=speed_table("Training of the grasp sequence", results, "objects", "part", "driven_to"),
        comparisons=[
            compare(row, other, at=f"{row['objects']} objects")
            for row in updates
            for other in theirs
            if row["objects"] == other["objects"]
        ],
        **facts,
    )


def _quick(config: ReinforceConfig) -> ReinforceConfig:
    return dataclasses.replace(
        config, objects=3, episodes_per_update=64, updates_per_interval=2, test_episodes=8, evaluation_scenes=8
    )


def _learners(training: Training, base_pose: BasePosePolicy, options: TrainingOptions) -> dict[str, Reinforce]:
    """By how many objects a scene has; with --quick as in training alone."""
    config, robot, world = training.config.reinforce, training.robot, training.config.world
    learners = {f"1 to {config.objects}": Reinforce(robot, base_pose, config, world)}
    if not options.quick:
        learners[str(config.objects)] = AllObjects(robot, base_pose, config, world)
    return learners


def _reinforce(training: Training, base_pose: BasePosePolicy, key: Array, options: TrainingOptions) -> list[Any]:
    config, rows = training.config.reinforce, []
    for objects, learner in _learners(training, base_pose, options).items():
        state = jax.jit(learner.init)(key)
        driven_to = _driven_to(learner, state, key)
        parts: dict[str, tuple[Callable[[ReinforceState], Any], int]] = {
            UPDATES: (_repeated(learner._update, UPDATES_PER_RUN), UPDATES_PER_RUN),
            "whole interval": (learner.interval, config.updates_per_interval),
        }
        for part, (step, updates) in parts.items():
            if part == UPDATES or options.intervals:
                # Donated, so each part begins with a copy.
                timing, _ = measure_steps(step, jax.tree.map(jnp.copy, state), repeats=_repeats(options, part))
                facts = {"objects": objects, "part": part, "driven_to": driven_to}
                rows.append(speed("REINFORCE", "episodes/s", updates * config.episodes_per_update, timing, **facts))
    return rows


def _driven_to(learner: Reinforce, state: ReinforceState, key: Array) -> float:
    """Share of objects that sampled episodes drive to; near 0 episodes would all end at once."""

    def share(params: Any, key: Array) -> Array:
        scenes = learner.draw(key, learner.config.episodes_per_update, vary_count=True, own_class_share=0.0)
        steps = learner.play(params, scenes, key, greedy=False)
        return jnp.sum(steps.executed) / jnp.sum(steps.active)

    return float(jax.jit(share)(state.params, key))


def _eager(training: Training, base_pose: BasePosePolicy, key: Array, options: TrainingOptions) -> list[Any]:
    """An update of PyTorch's for each of ours, from the same parameters; small tensors may be faster on one thread."""
    import torch  # pyright: ignore[reportMissingImports] (it need not be installed)

    from benchmarks.eager_sequence import EagerReinforce, as_tensors

    torch.manual_seed(options.seed)
    config, rows = training.config.reinforce, []
    for objects, learner in _learners(training, base_pose, options).items():
        params = jax.device_get(jax.jit(learner.init)(key).params)
        eager = EagerReinforce(training.robot, base_pose, params, config, training.config.world)
        scenes = as_tensors(_draw(learner, key))
        for threads in {1, 1 if options.quick else os.cpu_count() or 1}:
            torch.set_num_threads(threads)
            timing = measure_plain(lambda eager=eager, scenes=scenes: eager.update(scenes), repeats=options.repeats)
            what = f"eager PyTorch, {threads} thread{'s' if threads > 1 else ''}"
            facts = {"objects": objects, "part": UPDATES, "torch": torch.__version__}
            rows.append(speed(what, "episodes/s", config.episodes_per_update, timing, **facts))
    return rows


def _draw(learner: Reinforce, key: Array) -> Scene:
    def draw(key: Array) -> Scene:
        count, share = learner.config.episodes_per_update, learner.config.own_class_share
        return learner.draw(key, count, vary_count=True, own_class_share=share)

    return jax.jit(draw)(key)


def _repeated(step: Callable[[Any, None], tuple[Any, Any]], times: int) -> Callable[[Any], tuple[Any, Any]]:
    return lambda state: jax.lax.scan(step, state, length=times)


def _repeats(options: Options, part: str) -> int:
    """Whole intervals take long, and vary less."""
    return min(options.repeats, 3) if part == "whole interval" else options.repeats


if __name__ == "__main__":
    main()
