"""The run directory: one training's configuration, records and results, in use by one process at a time.

config.json          the configuration, which `--config` reads; a resumed run must have the same
metrics.jsonl        one record per layer and evaluation interval
tensorboard/LAYER/   the same as TensorBoard events
checkpoints/LAYER/   see `checkpoint`
weights/             the trained networks
summary.json         the results, once there are any
"""

import hashlib
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import filelock
import msgspec

from basenet_jax.atomic import write_atomically
from basenet_jax.learning.event_file import EventFile

_METRICS = "metrics.jsonl"


class RunDirectoryError(ValueError):
    """A directory can't be used for this run; the message says why and what to do."""


def default_path(preset: str, seed: int) -> Path:
    """`runs/PRESET-SEED-TIME` in the working directory."""
    return Path("runs") / f"{preset}-{seed}-{time.strftime('%Y%m%d-%H%M%S')}"


class RunDirectory:
    """An open run directory, locked until closed; a context manager.

    Attributes:
        path: of the directory.
        weights: path of the folder for the trained networks; it exists.
        config_hash: SHA-256 of the configuration, to mark what was made with it.
    """

    def __init__(self, path: Path, config: Any, *, resume: bool = False):
        """Creates the directory of a new run, or opens that of one to resume.

        Args:
            path: of the directory.
            config: a dataclass, or anything that msgspec turns to JSON.
            resume: go on with the run that is there.

        Raises:
            RunDirectoryError: it is in use by another process; or it holds a run already; or, to resume, it holds
                none or one of another configuration; or it can't be written.
        """
        self.path = path
        self.weights = path / "weights"
        self._events: dict[str, EventFile] = {}
        self._purge_from: dict[str, int] = {}
        encoded = msgspec.json.format(msgspec.json.encode(config, order="sorted"), indent=2)
        self.config_hash = hashlib.sha256(encoded).hexdigest()
        if resume and not path.is_dir():
            raise RunDirectoryError(f"{path}: there is no such directory, so no run to resume")
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = filelock.FileLock(path / ".lock", timeout=0)
            self._lock.acquire()
        except filelock.Timeout as error:
            hint = "wait until it ends, or choose another --run-dir"
            raise RunDirectoryError(f"{path}: in use by another process: {hint}") from error
        except OSError as error:
            raise RunDirectoryError(f"{path}: can't be used: {error.strerror or error}") from error
        try:
            self._open_config(encoded, resume)
            self.weights.mkdir(exist_ok=True)
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise RunDirectoryError(f"{path}: can't be used: {error.strerror or error}") from error
            raise

    def _open_config(self, encoded: bytes, resume: bool) -> None:
        file = self.path / "config.json"
        if not resume:
            if any((self.path / name).exists() for name in (file.name, _METRICS, "checkpoints")):
                hint = "continue it with --resume, or choose another --run-dir"
                raise RunDirectoryError(f"{self.path}: holds a run already: {hint}")
            write_atomically(file, encoded + b"\n")
            return
        if not file.exists():
            raise RunDirectoryError(f"{self.path}: no run to resume: it has no {file.name}")
        try:
            stored = msgspec.json.decode(file.read_bytes())
        except msgspec.MsgspecError as error:
            raise RunDirectoryError(f"{file}: can't be read: {error}") from error
        if differences := list(_differences(stored, msgspec.json.decode(encoded))):
            hint = "resume with the configuration of the run, or choose another --run-dir"
            raise RunDirectoryError(f"{self.path}: the run's configuration differs: {'; '.join(differences)}: {hint}")

    def __enter__(self) -> "RunDirectory":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the files and lets other processes use the directory."""
        try:
            while self._events:
                self._events.popitem()[1].close()
        finally:
            self._lock.release()

    def checkpoints(self, layer: str) -> Path:
        """The folder for a layer's checkpoints."""
        return self.path / "checkpoints" / layer

    def log(self, layer: str, interval: int, metrics: dict[str, float]) -> None:
        """Appends a record to `metrics.jsonl` and to the layer's TensorBoard events, and waits for the disk.

        Args:
            layer: name of what is trained.
            interval: number of the evaluation interval.
            metrics: finite numbers; none is called `layer` or `interval`.

        Raises:
            OSError: they can't be written.
        """
        marks = {"layer": layer, "interval": interval}
        record = json.dumps({**marks, **metrics, **marks}, allow_nan=False)
        with (self.path / _METRICS).open("a", encoding="utf-8") as stream:
            stream.write(record + "\n")
            stream.flush()
            os.fsync(stream.fileno())
        if layer not in self._events:
            folder = self.path / "tensorboard" / layer
            self._events[layer] = EventFile(folder, purge_from=self._purge_from.get(layer))
        self._events[layer].write(interval, metrics)

    def forget_after(self, layer: str, interval: int) -> None:
        """Drops the layer's records after an interval, and any torn by a kill: the run goes on from there.

        Raises:
            OSError: `metrics.jsonl` can't be read or written.
        """
        self._purge_from[layer] = interval + 1
        file = self.path / _METRICS
        if file.exists():
            lines = file.read_bytes().splitlines(keepends=True)
            write_atomically(file, b"".join(line for line in lines if _stays(line, layer, interval)))

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Writes `summary.json`, whole or not at all.

        Raises:
            OSError: it can't be written.
        """
        write_atomically(self.path / "summary.json", msgspec.json.format(msgspec.json.encode(summary)) + b"\n")


def _stays(line: bytes, layer: str, interval: int) -> bool:
    try:
        record = json.loads(line)
        return line.endswith(b"\n") and (record["layer"] != layer or record["interval"] <= interval)
    except (ValueError, LookupError, TypeError):
        return False


def _differences(stored: Any, given: Any, path: str = "") -> Iterator[str]:
    """The fields in which two configurations differ, with both values."""
    if isinstance(stored, dict) and isinstance(given, dict):
        for name in sorted(stored.keys() | given.keys()):
            yield from _differences(stored.get(name), given.get(name), f"{path}.{name}" if path else name)
    elif stored != given:
        yield f"{path} is {json.dumps(stored)} there and {json.dumps(given)} here"
