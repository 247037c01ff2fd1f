"""A training that takes milliseconds: a random walk with momentum, a key of each kind, a buffer and a counter."""

import argparse
import os
import signal
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from basenet_jax.learning.run_directory import RunDirectory
from basenet_jax.learning.training_loop import Interrupted, run_intervals
from basenet_jax.progress import PlainReporter


class Momentum(NamedTuple):
    mean: jax.Array
    steps: jax.Array


class State(NamedTuple):
    params: dict[str, jax.Array]
    optimiser: tuple[Momentum, None]
    key: jax.Array
    legacy_key: jax.Array
    replay: jax.Array
    interval: jax.Array
    temperature: jax.Array  # weakly typed
    half: jax.Array


def init(key: jax.Array, replay: int = 1000) -> State:
    start, key = jax.random.split(key)
    params = {"w": jax.random.normal(start, (4, 3)), "b": jnp.zeros(3)}
    return State(
        params=params,
        optimiser=(Momentum(jnp.zeros((4, 3)), jnp.int32(0)), None),
        key=key,
        legacy_key=jax.random.key_data(jax.random.fold_in(key, 1)),
        replay=jnp.zeros((replay, 3)),
        interval=jnp.int32(0),
        temperature=jnp.asarray(1.0),
        half=jnp.ones(3, jnp.bfloat16),
    )


@partial(jax.jit, donate_argnums=0)
def interval(state: State) -> tuple[State, dict[str, Any]]:
    key, walk, fill = jax.random.split(state.key, 3)
    momentum = state.optimiser[0]
    mean = 0.9 * momentum.mean + jax.random.normal(walk, (4, 3))
    return State(
        params={"w": state.params["w"] + 0.1 * mean, "b": state.params["b"] + state.temperature},
        optimiser=(Momentum(mean, momentum.steps + 1), None),
        key=key,
        legacy_key=jax.random.split(state.legacy_key)[0],
        replay=jax.random.normal(fill, state.replay.shape) + state.replay,
        interval=state.interval + 1,
        temperature=state.temperature * 0.9,
        half=state.half * 1.01,
    ), {"loss": jnp.mean(mean**2), "steps": state.interval * 10}


def train(run: RunDirectory, *, intervals: int, resume: bool = False, seed: int = 0, **options: Any) -> State:
    options = {"init": init, "interval": interval, "reporter": PlainReporter(), "name": "toy"} | options
    return run_intervals(intervals=intervals, run=run, key=jax.random.key(seed), resume=resume, **options)


def bits(tree: Any) -> list[tuple]:
    """A pytree of arrays to the bit: values, shapes, dtypes, weak types and generators of keys."""
    leaves = []
    for leaf in jax.tree.leaves(tree):
        key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        data = jax.random.key_data(leaf) if key else leaf
        leaves.append((jax.device_get(data).tobytes(), leaf.shape, str(leaf.dtype), getattr(leaf, "weak_type", False)))
    return leaves


def main() -> None:
    """Trains in a process of its own, which can be told to kill itself or never to end."""
    parser = argparse.ArgumentParser()
    parser.add_argument("directory", type=Path)
    parser.add_argument("--intervals", type=int)
    parser.add_argument("--replay", type=int, default=1000)
    parser.add_argument("--die", choices=["before", "after"], help="its third checkpoint gets its name")
    parser.add_argument("--long", action="store_true")
    arguments = parser.parse_args()
    if arguments.die:
        _die(arguments.die)
    resume = (arguments.directory / "config.json").exists()
    with RunDirectory(arguments.directory, {"seed": 0}, resume=resume) as run:
        options: dict[str, Any] = {"interval": _long_interval} if arguments.long else {}
        options["init"] = partial(init, replay=arguments.replay)
        try:
            train(run, intervals=arguments.intervals, resume=resume, **options)
        except Interrupted as error:
            print(error, flush=True)
            raise SystemExit(130) from None


@jax.jit
def _long_interval(state: State) -> tuple[State, dict[str, Any]]:
    """One interval of minutes."""
    values = jax.lax.fori_loop(0, 10_000_000, lambda _, x: jnp.sin(x), jnp.sum(state.params["w"]) + jnp.ones(1000))
    return state, {"loss": jnp.sum(values)}


def _die(when: str) -> None:
    rename, calls = os.rename, 0

    def lethal(source: Any, target: Any, **options: Any) -> None:
        nonlocal calls
        calls += Path(target).name.isdecimal()
        if calls == 3 and when == "before":
            os.kill(os.getpid(), signal.SIGKILL)
        rename(source, target, **options)
        if calls == 3:
            os.kill(os.getpid(), signal.SIGKILL)

    os.rename = lethal


if __name__ == "__main__":
    main()
