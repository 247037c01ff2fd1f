"""One thread for all work that takes long, where the newest wish replaces older ones of its kind."""

import threading
from collections.abc import Callable


class Worker:
    """Does jobs one after the other. A job that waits is dropped for a newer one of its kind, so none queue up.

    Args:
        report: told of whatever a job raises; the thread goes on.
    """

    def __init__(self, report: Callable[[Exception], None]):
        self._report = report
        self._waiting: dict[str, Callable[[], None]] = {}  # by kind, in the order in which the kinds were asked for
        self._changed = threading.Condition()
        self._busy, self._closed = False, False
        self._thread = threading.Thread(target=self._run, name="viewer-worker", daemon=True)
        self._thread.start()

    def submit(self, kind: str, job: Callable[[], None]) -> None:
        """Asks for a job to be done, instead of the one of its kind that still waits."""
        with self._changed:
            self._waiting[kind] = job
            self._changed.notify_all()

    def is_waiting(self, kind: str) -> bool:
        """Whether a job of a kind has not begun yet."""
        with self._changed:
            return kind in self._waiting

    def wait_idle(self, timeout_s: float) -> bool:
        """Waits until nothing is left to do; False after the timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._busy and not self._waiting, timeout_s)

    def close(self, timeout_s: float = 2.0) -> bool:
        """Drops what waits, and says whether the job under way ended in time (compiling can't be broken off)."""
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._changed.notify_all()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._closed)
                if self._closed:
                    return
                job = self._waiting.pop(next(iter(self._waiting)))
                self._busy = True
            try:
                job()
            except Exception as error:
                self._report(error)
