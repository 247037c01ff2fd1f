"""The loop around a learner: interval after interval, each checked, recorded and saved, until done or interrupted."""

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import jax

from basenet_jax.learning import checkpoint
from basenet_jax.learning.checkpoint import CheckpointError
from basenet_jax.learning.run_directory import RunDirectory
from basenet_jax.progress import Reporter
from basenet_jax.signals import stop_on_signals

State = TypeVar("State")

_POLL_S = 0.005  # how often a running interval is looked at; in between, signals are attended to


class TrainingDiverged(Exception):  # noqa: N818  (an outcome, not a fault of the program)
    """A metric is infinite or no number. Nothing of that interval is recorded or saved."""

    def __init__(self, layer: str, interval: int, metric: str, value: float, saved: Path | None):
        self.layer, self.interval, self.metric = layer, interval, metric
        good = f"the last good state is {saved}" if saved else "nothing was saved before"
        super().__init__(f"{layer}: training diverged: {metric} is {value} in interval {interval}; {good}")


class Interrupted(Exception):  # noqa: N818  (an outcome, not a fault of the program)
    """A person or the system stopped the run; `saved` is the interval whose state was saved last, 0 if none was."""

    def __init__(self, layer: str, saved: int, intervals: int, run: Path):
        self.layer, self.saved, self.run = layer, saved, run
        state = f"saved up to interval {saved} of {intervals}" if saved else "before its first checkpoint"
        super().__init__(f"{layer}: interrupted, {state}; resume with --run-dir {run} --resume")


@dataclass
class _Course:
    """What a training has reached."""

    name: str
    intervals: int
    run: RunDirectory
    every: int
    keep: int
    saved: int = 0

    @property
    def newest(self) -> Path | None:
        return self.run.checkpoints(self.name) / f"{self.saved:06d}" if self.saved else None

    def check(self, done: int, metrics: dict[str, float]) -> None:
        for metric, value in metrics.items():
            if not math.isfinite(value):
                raise TrainingDiverged(self.name, done, metric, value, self.newest)

    def record(self, done: int, metrics: dict[str, float]) -> None:
        try:
            self.run.log(self.name, done, metrics)
        except OSError as error:
            raise CheckpointError(f"{self.run.path}: metrics can't be written: {error.strerror or error}") from error

    def save(self, done: int, state: Any, stopping: bool) -> None:
        if done % self.every and done < self.intervals and not stopping:
            return
        metadata = {"layer": self.name, "interval": done, "config": self.run.config_hash}
        checkpoint.save(self.run.checkpoints(self.name), done, state, metadata, self.keep)
        self.saved = done

    def restore(self, like: Any, reporter: Reporter) -> Any:
        """The newest state, or None to begin at the beginning; the records after it are dropped."""
        restored = checkpoint.restore_latest(self.run.checkpoints(self.name), like)
        if restored is not None:
            for note in restored.notes:
                reporter.note(f"{self.name}: {note}")
            if restored.metadata.get("config") != self.run.config_hash:
                raise CheckpointError(f"{self.run.checkpoints(self.name)}: made with another configuration")
            self.saved = restored.step
            reporter.note(f"{self.name}: resuming after interval {self.saved} of {self.intervals}")
        self.run.forget_after(self.name, self.saved)
        return None if restored is None else restored.state


def run_intervals(
    *,
    name: str,
    init: Callable[[jax.Array], State],
    interval: Callable[[State], tuple[State, dict[str, Any]]],
    intervals: int,
    run: RunDirectory,
    reporter: Reporter,
    key: jax.Array,
    resume: bool = False,
    checkpoint_every: int = 1,
    checkpoints_kept: int = 2,
    unit: str = "intervals",
    work: float = 1.0,
    figures: Sequence[str] | None = None,
) -> State:
    """Trains one layer to its last interval, from the beginning or from its newest usable checkpoint.

    A run that was killed and resumed ends with the very state of one that never was. SIGINT and SIGTERM let the
    interval under way end and save its state; a second one stops at once and leaves the state saved last.

    Args:
        name: of the layer, for its records and checkpoints.
        init: makes the first state from a key; it is jitted here and must be pure.
        interval: runs one evaluation interval; jitted; may take over (donate) the buffers of the state given. Its
            metrics are scalars.
        intervals: how many there are.
        run: the open run directory.
        reporter: hears of the progress.
        key: PRNG key, consumed.
        resume: whether to look for checkpoints. If not, there should be none.
        checkpoint_every: a checkpoint after every so many intervals, and after the last.
        checkpoints_kept: how many stay.
        unit: of the rate that is shown.
        work: units in one interval.
        figures: the metrics to show, all unless given.

    Returns:
        The state after the last interval.

    Raises:
        CheckpointError: no checkpoint can be used, or the disk is full or can't be written.
        Interrupted: by a signal.
        TrainingDiverged: a metric is not finite.
    """
    course = _Course(name, intervals, run, checkpoint_every, checkpoints_kept)
    stop = threading.Event()
    try:
        with stop_on_signals(stop):
            state = course.restore(jax.eval_shape(init, key), reporter) if resume else None
            reporter.start(name, intervals, course.saved, unit=unit, work=work)
            if state is None:
                reporter.stage("compiling and running the initialisation ...")
                state = jax.jit(init)(key)
            if course.saved < intervals:
                reporter.stage("compiling and running the first interval ...")
            if stop.is_set():
                raise KeyboardInterrupt
            return _advance(course, interval, state, stop, reporter, figures)
    except KeyboardInterrupt:
        raise Interrupted(name, course.saved, intervals, run.path) from None
    finally:
        reporter.finish()


def _advance(
    course: _Course,
    interval: Callable[[State], tuple[State, dict[str, Any]]],
    state: State,
    stop: threading.Event,
    reporter: Reporter,
    figures: Sequence[str] | None,
) -> State:
    """Runs the intervals that remain; a KeyboardInterrupt once a stop is wished for and the state is saved."""
    for done in range(course.saved + 1, course.intervals + 1):
        state, metrics = interval(state)  # the state before is gone: its buffers may have been taken
        metrics = _wait(metrics, stop, reporter)
        course.check(done, metrics)
        course.record(done, metrics)
        reporter.update(done, {name: metrics[name] for name in figures or metrics if name in metrics})
        stopping = stop.is_set()  # read once: whatever is stopped is saved
        course.save(done, state, stopping)
        if stopping:
            raise KeyboardInterrupt
    return state


def _wait(metrics: dict[str, Any], stop: threading.Event, reporter: Reporter) -> dict[str, float]:
    """Waits for an interval in short naps: between them signals are attended to, blocked in JAX they are not."""
    told = False
    for leaf in jax.tree.leaves(metrics):
        while not getattr(leaf, "is_ready", lambda: True)():
            if stop.is_set() and not told:
                reporter.note("stopping after this interval; interrupt once more to stop at once")
                told = True
            time.sleep(_POLL_S)
    return {name: float(value) for name, value in jax.device_get(metrics).items()}
