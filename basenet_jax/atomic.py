"""Writing files and folders whole or not at all."""

import contextlib
import os
import shutil
import uuid
from collections.abc import Callable
from pathlib import Path


def write_atomically(path: str | os.PathLike[str], data: bytes) -> None:
    """Writes a file so that at any moment, even after a crash, its old or its new content is there whole.

    The folder is not created. A symbolic link is followed. What is no regular file (`/dev/null`, a pipe) can't be
    replaced and is written to directly.

    Raises:
        OSError: it can't be written; what was there before still is, and no temporary file stays behind.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        with target.open("wb") as stream:
            stream.write(data)
        return
    target = target.resolve()
    temporary = _beside(target)
    try:
        with temporary.open("xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    sync(target.parent)


def write_folder_atomically(path: str | os.PathLike[str], fill: Callable[[Path], object]) -> None:
    """Makes a folder that is there with all that belongs in it, or not at all.

    Args:
        path: of the folder, which is either not there or empty; the one above must be there.
        fill: writes what belongs in it into the folder that it is given.

    Raises:
        OSError: it can't be written, or isn't empty; no temporary folder stays behind, as when `fill` raises.
    """
    target = Path(path).resolve()
    temporary = _beside(target)
    try:
        temporary.mkdir()
        fill(temporary)
        for each in temporary.rglob("*"):
            sync(each)
        sync(temporary)
        if target.exists():
            target.rmdir()  # not everywhere can a folder be renamed to the name of another
        temporary.rename(target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    sync(target.parent)


def _beside(target: Path) -> Path:
    """A name for a temporary file or folder that nobody else uses."""
    return target.with_name(f".{target.name}.{uuid.uuid4().hex[:12]}.tmp")


def sync(path: str | os.PathLike[str]) -> None:
    """Waits until a file's content, or a folder's list of names, is on the disk.

    Raises:
        OSError: it can't be opened or written.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
