"""Training speed: REINFORCE for the grasp sequence, and Soft Actor-Critic for the base pose.

REINFORCE is measured with 1 to 10 objects in a scene, as in training, beside 10 in every scene (arrays have room for
10 in both); and the updates alone beside a whole interval with the baseline's t-test and the evaluation. An episode
is one that gives gradient: the baseline's greedy rollouts, the t-test's and the evaluation's are cost, not episodes.
SAC is measured as in training (fresh episodes with their picks, then updates), and its two parts apart. The networks
are the presets'. Time depends on the weights only through how long episodes go on: see `driven_to` and `success`.
"""

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from basenet_jax.learning.config import ReinforceConfig, SacConfig, TrainConfig
from basenet_jax.learning.reinforce import Reinforce, ReinforceState
from basenet_jax.learning.sac import Sac, SacState
from basenet_jax.learning.training import Training
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.world.scene import Scene
from benchmarks.harness import Options, Report, Timing, measure, measure_steps, parse, speed, speed_table
from benchmarks.trained import load_base_pose

NAME = "sequence_training"
UPDATES_PER_RUN = 5  # of REINFORCE, where updates are timed alone
ITERATIONS_PER_RUN = 20  # of SAC, likewise
STANDSTILL = 1e-12  # learning rate of SAC with given weights, whose fresh critics would spoil the policy


@dataclasses.dataclass(frozen=True)
class TrainingOptions(Options):
    """Options, and which base-pose policy to train with."""

    weights: Path | None = None
    """A run's weights/base_pose.weights. Default: an untrained policy of the same size."""
    intervals: bool = True
    """Also time whole intervals, which takes most of the time."""


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
    training = Training(_config(options))
    key = jax.random.key(options.seed)
    try:
        base_pose, source = load_base_pose(options.weights, training, key)
    except ValueError as error:
        raise SystemExit(f"{NAME}: {error}") from error
    results = _reinforce(training, base_pose, key, options)
    results += _sac(training.sac, base_pose if options.weights else None, key, options)
    table = speed_table("Training", results, "objects", "part", "driven_to", "success")
    return report.finish(results, table=table, weights=source)


def _config(options: TrainingOptions) -> TrainConfig:
    config = _tiny() if options.quick else TrainConfig()
    if options.weights is None:
        return config
    return dataclasses.replace(config, sac=dataclasses.replace(config.sac, learning_rate=STANDSTILL))


def _tiny() -> TrainConfig:
    sac = SacConfig(episodes_per_iteration=8, batch_size=8, replay_size=64, iterations_per_interval=2)
    reinforce = ReinforceConfig(
        objects=3, episodes_per_update=8, updates_per_interval=2, test_episodes=8, evaluation_scenes=8
    )
    return TrainConfig(sac=dataclasses.replace(sac, evaluation_problems=8), reinforce=reinforce)


def _reinforce(training: Training, base_pose: BasePosePolicy, key: Array, options: TrainingOptions) -> list[Any]:
    config, robot, world = training.config.reinforce, training.robot, training.config.world
    varied, fixed = (kind(robot, base_pose, config, world) for kind in (Reinforce, AllObjects))
    rows = []
    for learner, objects in ((varied, f"1 to {config.objects}"), (fixed, str(config.objects))):
        state = jax.jit(learner.init)(key)
        driven_to = _driven_to(learner, state, key)
        parts: dict[str, tuple[Callable[[ReinforceState], Any], int]] = {
            "updates": (_repeated(learner._update, UPDATES_PER_RUN), UPDATES_PER_RUN),
            "whole interval": (learner.interval, config.updates_per_interval),
        }
        for part, (step, updates) in parts.items():
            if part == "updates" or options.intervals:
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


def _sac(sac: Sac, base_pose: BasePosePolicy | None, key: Array, options: TrainingOptions) -> list[dict[str, Any]]:
    config = sac.config

    def start(key: Array) -> SacState:
        state = sac.init(key)
        return state if base_pose is None else _with_policy(state, base_pose)

    parts: dict[str, tuple[Callable[[SacState], Any], int]] = {
        "episodes and updates": (_repeated(sac._iterate, ITERATIONS_PER_RUN), ITERATIONS_PER_RUN),
        "whole interval": (sac.interval, config.iterations_per_interval),
    }
    rows = []
    for part, (step, iterations) in parts.items():
        if part != "whole interval" or options.intervals:
            timing, metrics = measure_steps(step, jax.jit(start)(key), repeats=_repeats(options, part))
            facts = {"part": part, "success": float(jnp.mean(metrics["exploration_success"]))}
            rows += [
                speed("SAC", "episodes/s", iterations * config.episodes_per_iteration, timing, **facts),
                speed("SAC", "updates/s", iterations * config.updates_per_iteration, timing, **facts),
            ]
    timing, success = _episodes_alone(sac, jax.jit(start)(key), key, options.repeats)
    facts = {"part": "episodes alone", "success": success}
    rows.append(speed("SAC", "episodes/s", config.episodes_per_iteration, timing, **facts))
    return [*rows, _updates_alone(sac, jax.jit(start)(key), key, options.repeats)]


def _episodes_alone(sac: Sac, state: SacState, key: Array, repeats: int) -> tuple[Timing, float]:
    """Drawing problems, the deterministic policy and the picks."""
    policy = jax.jit(sac.policy)(state)

    def play(policy: BasePosePolicy, key: Array) -> Any:
        start = jax.vmap(sac.env.reset)(jax.random.split(key, sac.config.episodes_per_iteration))
        return sac.env.park(start, policy(start.info["grasp"], start.info["robot_pose"]))

    timing = measure(play, [(policy, key)], repeats=repeats)
    return timing, float(jnp.mean(jax.jit(play)(policy, key).success))


def _updates_alone(sac: Sac, state: SacState, key: Array, repeats: int) -> dict[str, Any]:
    """Gradient steps on a replay buffer that one iteration has filled."""
    count = ITERATIONS_PER_RUN * sac.config.updates_per_iteration
    state, _ = jax.jit(_repeated(sac._iterate, 1))(state)

    def update(state: SacState) -> Any:
        return jax.lax.scan(sac._update, state, jax.random.split(key, count), unroll=4)

    timing, _ = measure_steps(update, state, repeats=repeats)
    return speed("SAC", "updates/s", count, timing, part="updates alone")


def _with_policy(state: SacState, policy: BasePosePolicy) -> SacState:
    """The state with a trained actor, and with so many observations behind its normalisation that it stays."""
    layers = zip(policy.kernels, policy.biases, strict=True)
    actor = {"params": {f"hidden_{i}": {"kernel": kernel, "bias": bias} for i, (kernel, bias) in enumerate(layers)}}
    normalizer: Any = state.normalizer
    seen = 1 << 20
    count = dataclasses.replace(normalizer.count, lo=jnp.full_like(normalizer.count.lo, seen))
    statistics = {"mean": policy.mean, "std": policy.std, "summed_variance": seen * policy.std**2}
    return dataclasses.replace(state, actor=actor, normalizer=normalizer.replace(count=count, **statistics))


def _repeated(step: Callable[[Any, None], tuple[Any, Any]], times: int) -> Callable[[Any], tuple[Any, Any]]:
    return lambda state: jax.lax.scan(step, state, length=times)


def _repeats(options: Options, part: str) -> int:
    """Whole intervals take long, and vary less."""
    return min(options.repeats, 3) if part == "whole interval" else options.repeats


if __name__ == "__main__":
    main()
