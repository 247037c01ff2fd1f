"""Files of the cache folder: checked when they are read, and only so many of a folder are kept.

The folder is the user's, and is trusted; a digest finds what a crash or a full disk has damaged.
"""

import contextlib
import hashlib
import os
from pathlib import Path

from basenet_jax.atomic import write_atomically

KEPT = 64  # of a folder, the latest used: each new version of the package leaves its own behind
_DIGEST = 32  # bytes, of SHA-256


def read_kept(path: Path) -> bytes | None:
    """What `keep` wrote; None where nothing is, or where it is damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, content = data[:_DIGEST], data[_DIGEST:]
    if hashlib.sha256(content).digest() != digest:
        return None
    with contextlib.suppress(OSError):  # another user's folder
        os.utime(path)  # used last: see `KEPT`
    return content


def keep(path: Path, content: bytes) -> None:
    """Writes a file; where there is no room or no right to, everything goes on without."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, hashlib.sha256(content).digest() + content)
        for old in sorted(path.parent.iterdir(), key=lambda each: each.stat().st_mtime, reverse=True)[KEPT:]:
            old.unlink(missing_ok=True)
    except OSError:
        return
