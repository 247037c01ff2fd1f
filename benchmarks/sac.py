"""Training speed of the base pose: Soft Actor-Critic by batch size, as in training and in its parts.

An iteration of the training plays fresh episodes (a problem drawn, the policy's base pose, the pick in full) and then
makes gradient updates on what the replay buffer holds. The batch size is both the number of episodes played at once
and the number of transitions in an update; the presets use 512. A whole interval has the evaluation in it, too. With
an untrained policy nearly all picks fail, and a failed pick is checked in less time: see `success`, and `--weights`.
"""

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from basenet_jax.learning.config import SacConfig, TrainConfig
from basenet_jax.learning.sac import Sac, SacState
from basenet_jax.learning.training import Training
from basenet_jax.policies.base_pose import BasePosePolicy
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.scaling_picture import draw_scaling, rate_points
from benchmarks.timing import Timing, measure, measure_steps, speed
from benchmarks.trained import load_base_pose

NAME = "sac"
BATCHES, QUICK_BATCHES = (64, 512, 4_096), (64,)
ITERATIONS_PER_RUN = 20
STANDSTILL = 1e-12  # learning rate with given weights, whose fresh critics would spoil the policy
TOGETHER = "episodes and updates"

Row = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class SacOptions(Options):
    """Options, and which base-pose policy to train with."""

    weights: Path | None = None
    """A run's weights/base_pose.weights. Default: an untrained policy of the same size."""
    intervals: bool = True
    """Also time a whole interval of the presets; not with --quick, nor are episodes and updates timed alone."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(SacOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    key = jax.random.key(options.seed)
    try:
        base_pose, source = load_base_pose(options.weights, Training(TrainConfig()), key)
    except ValueError as error:
        raise SystemExit(f"{NAME}: {error}") from error
    given = base_pose if options.weights else None
    rate = SacConfig().learning_rate if given is None else STANDSTILL
    results = []
    for batch in QUICK_BATCHES if options.quick else BATCHES:
        config = SacConfig(episodes_per_iteration=batch, batch_size=batch, learning_rate=rate)
        results += _measure(_learner(config), given, key, options)
    if options.intervals and not options.quick:
        results += _interval(_learner(SacConfig(learning_rate=rate)), given, key, options)
    series = {
        f"{row['part']} ({row['unit']})": [each for each in results if _same_kind(each, row)]
        for row in results
        if row["part"] != "whole interval"
    }
    return report.finish(
        results,
        table=speed_table("Training of the base pose", results, "batch", "part", "success"),
        picture=draw_scaling(
            "Soft Actor-Critic for the base pose",
            {name: rate_points(rows, "batch") for name, rows in series.items()},
            size="batch",
            value="per second",
        ),
        weights=source,
    )


def _same_kind(row: Row, other: Row) -> bool:
    return (row["part"], row["unit"]) == (other["part"], other["unit"])


def _learner(config: SacConfig) -> Sac:
    return Training(TrainConfig(sac=config)).sac


def _measure(sac: Sac, base_pose: BasePosePolicy | None, key: Array, options: SacOptions) -> list[Row]:
    config, batch = sac.config, sac.config.batch_size
    step = _repeated(sac._iterate, ITERATIONS_PER_RUN)
    timing, metrics = measure_steps(step, _start(sac, base_pose, key), repeats=options.repeats)
    facts = {"batch": batch, "part": TOGETHER, "success": float(jnp.mean(metrics["exploration_success"]))}
    together = [
        speed("SAC", "episodes/s", ITERATIONS_PER_RUN * config.episodes_per_iteration, timing, **facts),
        speed("SAC", "updates/s", ITERATIONS_PER_RUN * config.updates_per_iteration, timing, **facts),
    ]
    if options.quick:
        return together
    alone, success = _episodes_alone(sac, _start(sac, base_pose, key), key, options.repeats)
    return [
        *together,
        speed("SAC", "episodes/s", batch, alone, batch=batch, part="episodes alone", success=success),
        _updates_alone(sac, _start(sac, base_pose, key), key, options.repeats),
    ]


def _interval(sac: Sac, base_pose: BasePosePolicy | None, key: Array, options: SacOptions) -> list[Row]:
    config = sac.config
    timing, metrics = measure_steps(sac.interval, _start(sac, base_pose, key), repeats=min(options.repeats, 3))
    success = float(jnp.mean(metrics["exploration_success"]))
    facts = {"batch": config.batch_size, "part": "whole interval", "success": success}
    iterations = config.iterations_per_interval
    return [
        speed("SAC", "episodes/s", iterations * config.episodes_per_iteration, timing, **facts),
        speed("SAC", "updates/s", iterations * config.updates_per_iteration, timing, **facts),
    ]


def _start(sac: Sac, base_pose: BasePosePolicy | None, key: Array) -> SacState:
    def start(key: Array) -> SacState:
        state = sac.init(key)
        return state if base_pose is None else _with_policy(state, base_pose)

    return jax.jit(start)(key)


def _episodes_alone(sac: Sac, state: SacState, key: Array, repeats: int) -> tuple[Timing, float]:
    """Drawing problems, the deterministic policy and the picks."""
    policy = jax.jit(sac.policy)(state)

    def play(policy: BasePosePolicy, key: Array) -> Any:
        start = jax.vmap(sac.env.reset)(jax.random.split(key, sac.config.episodes_per_iteration))
        return sac.env.park(start, policy(start.info["grasp"], start.info["robot_pose"]))

    timing = measure(play, [(policy, key)], repeats=repeats)
    return timing, float(jnp.mean(jax.jit(play)(policy, key).success))


def _updates_alone(sac: Sac, state: SacState, key: Array, repeats: int) -> dict[str, Any]:
    """Gradient steps on a full replay buffer: of zeros, which take as long as real episodes."""
    count = ITERATIONS_PER_RUN * sac.config.updates_per_iteration
    replay: Any = state.replay
    end = jnp.full_like(replay.insert_position, replay.data.shape[-2])
    state = dataclasses.replace(state, replay=replay.replace(insert_position=end))

    def update(state: SacState) -> Any:
        return jax.lax.scan(sac._update, state, jax.random.split(key, count), unroll=4)

    timing, _ = measure_steps(update, state, repeats=repeats)
    return speed("SAC", "updates/s", count, timing, batch=sac.config.batch_size, part="updates alone")


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


if __name__ == "__main__":
    main()
