"""TensorBoard event files, written at once and by the calling thread.

tensorboardX's own `SummaryWriter` hands events to a thread; on a full disk that thread dies and its caller waits for
it for ever. Its parts underneath have no thread, and a full disk is an `OSError`.
"""

# pyright: reportAttributeAccessIssue=false
# (Protocol buffer classes are made at import time.)

import os
import time
import uuid
from pathlib import Path

from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event, SessionLog
from tensorboardX.summary import scalar


class EventFile:
    """A new event file in a folder."""

    def __init__(self, folder: Path, purge_from: int | None = None):
        """Creates the file.

        Args:
            folder: of one TensorBoard run; created where missing.
            purge_from: makes TensorBoard drop what earlier files of the folder hold from this step on.

        Raises:
            OSError: it can't be created.
        """
        folder.mkdir(parents=True, exist_ok=True)
        # Files are named by the second; the suffix keeps a quick restart from overwriting its predecessor's.
        self._writer = EventsWriter(os.fspath(folder / "events"), f".{uuid.uuid4().hex[:8]}")
        if purge_from is not None:
            self._write(Event(step=purge_from, session_log=SessionLog(status=SessionLog.START)))
        self._writer.flush()

    def write(self, step: int, values: dict[str, float]) -> None:
        """Appends scalars.

        Raises:
            OSError: they can't be written.
        """
        for name, value in values.items():
            self._write(Event(step=step, summary=scalar(name, value)))
        self._writer.flush()

    def close(self) -> None:
        """Closes the file."""
        self._writer.close()

    def _write(self, event: Event) -> None:
        event.wall_time = time.time()
        self._writer.write_event(event)
