"""Stopping long work gently."""

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def stop_on_signals(stop: threading.Event) -> Iterator[None]:
    """While entered, the first SIGINT or SIGTERM sets an event; the second is a KeyboardInterrupt."""

    def handle(_number: int, _frame: object) -> None:  # prints nothing: it may have interrupted a print
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    previous = {}
    if threading.current_thread() is threading.main_thread():  # only there can handlers be set
        for number in (signal.SIGINT, signal.SIGTERM):
            # An ignored signal stays ignored: that is how `nohup` and shells protect background jobs.
            if (handler := signal.getsignal(number)) not in (signal.SIG_IGN, None):
                previous[number] = handler
                signal.signal(number, handle)
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
