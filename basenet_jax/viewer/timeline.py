"""The clock of a plan that is played."""

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager

FRAME_S = 0.05  # between two pictures


class Timeline:
    """A time between 0 and an end that stands still or goes on, faster than life by `speed`.

    Args:
        show: called with the time (s) in the thread that plays, every `FRAME_S` while it goes on.
        lock: held meanwhile, and by all who change the time.
    """

    def __init__(self, show: Callable[[float], None], lock: AbstractContextManager):
        self.time_s, self.end_s, self.speed = 0.0, 0.0, 8.0
        self._show, self._lock = show, lock
        self._going, self._closed = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="viewer-timeline", daemon=True)
        self._thread.start()

    @property
    def playing(self) -> bool:
        """Whether time goes on."""
        return self._going.is_set()

    def play(self) -> None:
        """Goes on, from the beginning if the end is reached."""
        if self.time_s >= self.end_s:
            self.time_s = 0.0
        if self.end_s > 0:
            self._going.set()

    def pause(self) -> None:
        """Stands still."""
        self._going.clear()

    def go_to(self, time_s: float) -> None:
        """Stands still at a time (s), or at the end if that is earlier."""
        self.pause()
        self.time_s = min(max(time_s, 0.0), self.end_s)

    def close(self) -> None:
        """Ends the thread."""
        self._closed.set()
        self._going.set()
        self._thread.join()

    def _run(self) -> None:
        while self._going.wait() and not self._closed.is_set():
            begin = time.perf_counter()
            with self._lock:
                if self.playing:
                    self._advance()
            self._closed.wait(max(0.0, FRAME_S - (time.perf_counter() - begin)))

    def _advance(self) -> None:
        self.time_s += FRAME_S * self.speed
        if self.time_s >= self.end_s:
            self.go_to(self.end_s)
        self._show(self.time_s)
