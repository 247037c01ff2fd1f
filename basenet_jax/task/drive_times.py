"""Drive times that somebody else says, such as a navigation stack's own planner: a table, tabulated or from a file."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from jaxtyping import Float
from msgspec import Meta, Struct
from numpy.typing import ArrayLike

from basenet_jax.atomic import write_atomically
from basenet_jax.documents.fields import DocumentError, convert, describe, field_error, shortest
from basenet_jax.documents.text_files import read_json, to_json

FORMAT = "basenet-drive-times/1"
MAX_POSES = 1024
_MAX_BYTES = 16 * 1024 * 1024
_MAX_S = 1e6
_ALLOWED_TIME = f"is a number from 0 to {_MAX_S:.0f} (s), or null where there is no way"

DriveFunction: TypeAlias = Callable[[np.ndarray, np.ndarray], ArrayLike]  # (poses [S, 3], poses [T, 3]) -> s [S, T]


class DriveTimesError(ValueError):
    """Drive times that mean nothing; the message says where, what was found and what is allowed."""


@dataclass(frozen=True, eq=False)
class DriveTimes:
    """How long drives between some poses take; there are no others.

    Args:
        poses: (x, y, heading) in W, up to 1,024.
        seconds: from each pose (row) to each (column); infinite where there is no way. Staying takes none.
        source: where they are from, for messages and plan files.

    Raises:
        DriveTimesError: a number isn't finite, negative or too large, or the shapes don't fit.
    """

    poses: Float[np.ndarray, "P 3"]
    seconds: Float[np.ndarray, "P P"]
    source: str = "drive_times"

    def __post_init__(self) -> None:
        poses, seconds = self._numbers(self.poses), self._numbers(self.seconds)
        if poses.ndim != 2 or poses.shape[1:] != (3,) or not 1 <= len(poses) <= MAX_POSES:
            raise self._error("poses", f"an array of shape {poses.shape}", f"is (P, 3), P from 1 to {MAX_POSES}")
        if not np.all(np.isfinite(poses)):
            raise self._error("poses", "a number that isn't finite", "are x, y (m) and heading (rad)")
        _check_seconds(seconds, (len(poses), len(poses)), self.source)
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "seconds", np.where(np.eye(len(poses), dtype=bool), 0.0, seconds))

    def _numbers(self, given: ArrayLike) -> np.ndarray:
        try:
            return np.asarray(given, float)
        except (TypeError, ValueError):
            raise DriveTimesError(f"{self.source}: found no array of numbers, allowed is one") from None

    def _error(self, field: str, found: str, allowed: str) -> DriveTimesError:
        return DriveTimesError(f"{self.source}: {field}: found {found}, allowed {allowed}")


def tabulate_drives(function: DriveFunction, poses: Float[ArrayLike, "P 3"]) -> DriveTimes:
    """What a function says of all drives between some poses; it is called once.

    Args:
        function: of NumPy's poses [S, 3] and poses [T, 3], (x, y, heading) in W; returns seconds [S, T], infinite where
            there is no way.
        poses: of the table.

    Raises:
        DriveTimesError: it returns another shape, or numbers that are no times.
    """
    poses = np.asarray(poses, float)
    seconds: Any = function(poses, poses)
    return DriveTimes(poses, seconds)


def _check_seconds(seconds: np.ndarray, shape: tuple[int, int], source: str) -> None:
    if seconds.shape != shape:
        raise DriveTimesError(f"{source}: seconds: found an array of shape {seconds.shape}, allowed is {shape}")
    wrong = np.isnan(seconds) | (seconds < 0) | ((seconds > _MAX_S) & np.isfinite(seconds))
    if np.any(wrong):
        row, column = np.argwhere(wrong)[0].tolist()
        found = f"{source}: seconds[{row}][{column}]: found {seconds[row, column]:g}"
        raise DriveTimesError(f"{found}, allowed are 0 to {_MAX_S:.0f}, or infinity where there is no way")


_Coordinate = Annotated[float, Meta(ge=-1000, le=1000)]


class _Fields(Struct, forbid_unknown_fields=True, kw_only=True):
    format: str = FORMAT
    poses: Annotated[list[tuple[_Coordinate, _Coordinate, _Coordinate]], Meta(min_length=1, max_length=MAX_POSES)]
    seconds: Annotated[list[list[Annotated[float, Meta(ge=0, le=_MAX_S)] | None]], Meta(max_length=MAX_POSES)]


_ALLOWED = {
    "format": f"is {FORMAT!r}",
    "poses": f"is a list of 1 to {MAX_POSES} poses",
    "poses[]": "is [x, y, heading], three numbers (m, m, rad)",
    "poses[][]": "is a number from -1000 to 1000 (m or rad)",
    "seconds": "is a list of rows, one for each pose",
    "seconds[]": "is a list of times, one for each pose",
    "seconds[][]": _ALLOWED_TIME,
}


def load_drive_times(path: str | os.PathLike[str]) -> DriveTimes:
    """Reads a file of drive times, `basenet-drive-times/1`.

    Raises:
        DriveTimesError: it can't be read, or isn't one; the message names the file, the field, what was found and what
            is allowed.
    """
    name = Path(path).name
    try:
        fields = convert(read_json(path, _MAX_BYTES), _Fields, format_name=FORMAT, allowed=_ALLOWED)
        count = len(fields.poses)
        if len(fields.seconds) != count:
            raise field_error("seconds", f"{len(fields.seconds)} rows", f"are {count}, one for each pose")
        for row, times in enumerate(fields.seconds):
            if len(times) != count:
                raise field_error(f"seconds[{row}]", f"{len(times)} times", f"are {count}, one for each pose")
            if times[row] not in (0, None):
                raise field_error(f"seconds[{row}][{row}]", describe(times[row]), "is 0: there the robot stays")
    except DocumentError as error:
        raise DriveTimesError(f"{path}: {error}") from None
    seconds = np.array([[np.inf if time is None else time for time in times] for times in fields.seconds])
    return DriveTimes(np.array(fields.poses), seconds, name)


def save_drive_times(path: str | os.PathLike[str], times: DriveTimes) -> None:
    """Writes such a file, whole or not at all.

    Raises:
        OSError: it can't be written.
    """
    seconds = [[time if np.isfinite(time) else None for time in row] for row in times.seconds.tolist()]
    write_atomically(path, to_json(_Fields(poses=[tuple(shortest(pose)) for pose in times.poses], seconds=seconds)))
