"""Stopwatches: compilation apart from running, a warm-up, medians with their spread, and the cores that were busy."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np


@dataclass(frozen=True)
class Timing:
    """Times of one function (s)."""

    compile_s: float | None  # tracing, lowering and compiling; None for what isn't compiled
    runs_s: tuple[float, ...]
    cpu_s: tuple[float, ...]  # of each run, all threads of this process together

    @property
    def cores(self) -> float:
        """How many cores were busy on average: 1 for a loop in Python, up to all for a compiled program."""
        return sum(self.cpu_s) / sum(self.runs_s)

    def summary(self) -> dict[str, Any]:
        """Median, quartiles and extremes of a run (s), the compile time (s) and the busy cores."""
        minimum, q1, median, q3, maximum = np.quantile(self.runs_s, [0, 0.25, 0.5, 0.75, 1]).tolist()
        spread = {"median": median, "q1": q1, "q3": q3, "min": minimum, "max": maximum}
        return {"run_s": spread, "compile_s": self.compile_s, "repeats": len(self.runs_s), "cores": self.cores}

    def rate(self, items: int) -> dict[str, float]:
        """Items per second when one run does so many: at the median run, and between the run's quartiles."""
        q1, median, q3 = np.quantile(self.runs_s, [0.25, 0.5, 0.75]).tolist()
        return {"median": items / median, "q1": items / q3, "q3": items / q1}


def measure(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], *, repeats: int) -> Timing:
    """Times a function under jit.

    Args:
        function: of arrays.
        calls: arguments, all of the same shapes; one run calls the function with each, one after another, and waits
            for each result before the next call.
        repeats: timed runs, after one that isn't.
    """
    start = time.perf_counter()
    compiled = jax.jit(function).lower(*calls[0]).compile()
    compile_s = time.perf_counter() - start

    def run() -> None:
        for arguments in calls:
            jax.block_until_ready(compiled(*arguments))

    return measure_plain(run, repeats=repeats, compile_s=compile_s)


def measure_plain(run: Callable[[], object], *, repeats: int, compile_s: float | None = None) -> Timing:
    """Times a function as it is, which returns when its work is done: what other packages offer.

    Args:
        run: without arguments.
        repeats: timed runs, after one that isn't.
        compile_s: time that went before (s), to be given beside the runs.
    """
    run()
    timed = [_stopwatch(run)[1:] for _ in range(repeats)]
    return Timing(compile_s, *zip(*timed, strict=True))


def measure_steps(step: Callable[[Any], tuple[Any, Any]], state: Any, *, repeats: int) -> tuple[Timing, Any]:
    """Times a training step `state -> (state, metrics)`, each run from where the last one stopped.

    The state is donated, as in training. Returns the last metrics too.
    """
    start = time.perf_counter()
    compiled = jax.jit(step, donate_argnums=0).lower(state).compile()
    compile_s = time.perf_counter() - start
    state, metrics = jax.block_until_ready(compiled(state))
    timed = []
    for _ in range(repeats):
        (state, metrics), *times = _stopwatch(lambda state=state: jax.block_until_ready(compiled(state)))
        timed.append(times)
    return Timing(compile_s, *zip(*timed, strict=True)), jax.device_get(metrics)


def speed(what: str, unit: str, items: int, timing: Timing, **facts: Any) -> dict[str, Any]:
    """A row of results: items per second, and the times behind it."""
    return {"what": what, **facts, "unit": unit, "items": items, "rate": timing.rate(items), **timing.summary()}


def compare(ours: dict[str, Any], theirs: dict[str, Any], **facts: Any) -> dict[str, Any]:
    """How many times the rate of one row another has, both of `speed`.

    The ratio per core divides each rate by the cores that it kept busy. It says what a method gains on one core, and
    other work on the machine hardly changes it.
    """
    rates = [row["rate"]["median"] for row in (ours, theirs)]
    per_core = [rate / row["cores"] for rate, row in zip(rates, (ours, theirs), strict=True)]
    return {
        "ours": ours["what"],
        "theirs": theirs["what"],
        **facts,
        "units": [ours["unit"], theirs["unit"]],
        "rates": rates,
        "cores": [ours["cores"], theirs["cores"]],
        "ratio": rates[0] / rates[1],
        "ratio_per_core": per_core[0] / per_core[1],
    }


def _stopwatch(run: Callable[[], Any]) -> tuple[Any, float, float]:
    """What a function returns, and its wall and CPU time (s)."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = run()
    return result, time.perf_counter() - wall, time.process_time() - cpu
