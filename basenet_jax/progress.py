"""Progress of long work on stderr: a bar on a terminal, plain lines elsewhere. Stdout stays free."""

import datetime
import os
import sys
import time
from collections.abc import Callable
from typing import Protocol, TextIO

import rich.console
import rich.progress
import rich.table

Figures = dict[str, float]


class Reporter(Protocol):
    """What long work tells of itself."""

    def stage(self, message: str) -> None:
        """Says what begins now and gives no progress of its own, such as compiling."""
        ...

    def start(self, name: str, total: int, done: int = 0, *, unit: str = "intervals", work: float = 1.0) -> None:
        """Begins a countable piece of work.

        Args:
            name: of the work.
            total: how many steps it has.
            done: how many of them were done before.
            unit: what the rate counts, per second.
            work: how many units one step is.
        """
        ...

    def update(self, done: int, figures: Figures) -> None:
        """Says how many steps are done, with the figures that matter."""
        ...

    def note(self, message: str) -> None:
        """Says something that stays to be read."""
        ...

    def finish(self) -> None:
        """Ends the work begun last, done or not; harmless where none is."""
        ...


def make_reporter(stream: TextIO | None = None) -> Reporter:
    """The reporter that suits a stream, stderr unless given."""
    stream = stream or sys.stderr
    terminal = stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb"
    return TerminalReporter(stream) if terminal else PlainReporter(stream)


class _Pace:
    """Rate and time left of a piece of work.

    They are measured from the first update on: what comes before it includes compilation.
    """

    def __init__(self, name: str, total: int, done: int, unit: str, work: float, clock: Callable[[], float]):
        self.name, self.total, self.done = name, total, done
        self._unit, self._work, self._clock = unit, work, clock
        self._begin = clock()
        self._first: tuple[int, float] | None = None

    @property
    def elapsed(self) -> float:
        return self._clock() - self._begin

    def update(self, done: int) -> None:
        self.done = done
        self._first = self._first or (done, self._clock())

    def describe(self) -> list[str]:
        """Rate and time left, once they are known."""
        if self._first is None:
            return []
        steps, seconds = self.done - self._first[0], self._clock() - self._first[1]
        if steps <= 0 or seconds <= 0:
            return []
        left = (self.total - self.done) * seconds / steps
        return [f"{_amount(steps * self._work / seconds)} {self._unit}/s", f"{_duration(left)} left"]


class PlainReporter:
    """Plain lines: the first update of a piece of work, its last, and in between one at most every so often."""

    def __init__(
        self, stream: TextIO | None = None, every_s: float = 10.0, clock: Callable[[], float] = time.monotonic
    ):
        self._stream, self._every_s, self._clock = stream or sys.stderr, every_s, clock
        self._pace: _Pace | None = None
        self._printed_at: float | None = None
        self._held: str | None = None  # the newest line, where it isn't printed yet

    def stage(self, message: str) -> None:
        """See `Reporter`."""
        self._print(f"{self._pace.name}: {message}" if self._pace else message)

    def note(self, message: str) -> None:
        """See `Reporter`."""
        self._print(message)

    def start(self, name: str, total: int, done: int = 0, *, unit: str = "intervals", work: float = 1.0) -> None:
        """See `Reporter`."""
        self.finish()
        self._pace = _Pace(name, total, done, unit, work, self._clock)

    def update(self, done: int, figures: Figures) -> None:
        """See `Reporter`."""
        if self._pace is None:
            return
        self._pace.update(done)
        count = f"{self._pace.name}: {done}/{self._pace.total} ({100 * done // max(self._pace.total, 1)} %)"
        elapsed = f"{_duration(self._pace.elapsed)} elapsed"
        self._held = ", ".join([count, elapsed, *self._pace.describe(), *_texts(figures)])
        now = self._clock()
        if self._printed_at is None or now - self._printed_at >= self._every_s:
            self._print(self._held)
            self._printed_at, self._held = now, None

    def finish(self) -> None:
        """See `Reporter`."""
        if self._held is not None:
            self._print(self._held)
        self._pace, self._printed_at, self._held = None, None, None

    def _print(self, line: str) -> None:
        print(line, file=self._stream, flush=True)


class TerminalReporter:
    """A progress bar."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic):
        self._console = rich.console.Console(file=stream or sys.stderr)
        self._clock = clock
        self._pace: _Pace | None = None
        self._bar: rich.progress.Progress | None = None
        self._task = rich.progress.TaskID(0)

    def stage(self, message: str) -> None:
        """See `Reporter`."""
        if self._bar is not None:
            self._bar.update(self._task, status=message)
        else:
            self.note(message)

    def note(self, message: str) -> None:
        """See `Reporter`."""
        self._console.print(message, markup=False, highlight=False)

    def start(self, name: str, total: int, done: int = 0, *, unit: str = "intervals", work: float = 1.0) -> None:
        """See `Reporter`."""
        self.finish()
        self._pace = _Pace(name, total, done, unit, work, self._clock)
        self._bar = rich.progress.Progress(
            "{task.description}",
            rich.progress.BarColumn(bar_width=12),
            rich.progress.MofNCompleteColumn(),
            rich.progress.TimeElapsedColumn(rich.table.Column(no_wrap=True, min_width=7)),  # else figures squeeze it
            rich.progress.TextColumn("{task.fields[status]}", markup=False),
            console=self._console,
            redirect_stdout=False,
        )
        self._task = self._bar.add_task(name, total=total, completed=done, status="")
        self._bar.start()

    def update(self, done: int, figures: Figures) -> None:
        """See `Reporter`."""
        if self._bar is None or self._pace is None:
            return
        self._pace.update(done)
        self._bar.update(self._task, completed=done, status=", ".join([*self._pace.describe(), *_texts(figures)]))

    def finish(self) -> None:
        """See `Reporter`."""
        if self._bar is not None:
            self._bar.stop()
        self._bar = self._pace = None


def _texts(figures: Figures) -> list[str]:
    return [f"{name} {value:.4g}" for name, value in figures.items()]


def _duration(seconds: float) -> str:
    return str(datetime.timedelta(seconds=round(seconds)))


def _amount(value: float) -> str:
    """A number with three digits and a prefix, such as 12.5k."""
    for size, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:.3g}{prefix}"
    return f"{value:.3g}"
