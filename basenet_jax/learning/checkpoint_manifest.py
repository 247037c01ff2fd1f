"""The manifest of a checkpoint: the SHA-256 of each of its files, as `sha256sum` writes and checks them."""

import hashlib
from pathlib import Path

from basenet_jax.atomic import sync

MANIFEST = "manifest.sha256"


def write_manifest(folder: Path) -> None:
    """Lists every file under a folder in its manifest, and waits until all of it is on the disk.

    Raises:
        OSError: a file can't be read or written.
    """
    files = _files(folder)
    lines = [f"{_digest(path)}  {name}\n" for name, path in sorted(files.items())]
    (folder / MANIFEST).write_text("".join(lines), encoding="utf-8")
    for path in (*folder.rglob("*"), folder):
        sync(path)


def find_damage(folder: Path) -> str | None:
    """What is wrong with a folder by its manifest, as words to follow its name; None if nothing is."""
    try:
        lines = (folder / MANIFEST).read_text(encoding="utf-8").splitlines()
        files = _files(folder)
        listed = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
        # Unlisted files count as damage, else a manifest that lost lines would leave files unchecked.
        for name in sorted(listed.keys() | files.keys()):
            if name not in files:
                return f"is damaged ({name or 'a file'} is missing)"
            if name not in listed:
                return f"is damaged ({name} isn't in its manifest)"
            if _digest(files[name]) != listed[name]:
                return f"is damaged ({name} differs from its manifest)"
    except FileNotFoundError:
        return "is incomplete (it has no manifest)"
    except UnicodeDecodeError:
        return "is damaged (its manifest is no text)"
    except OSError as error:
        return f"can't be read ({error})"
    return None if files else "is incomplete (it is empty)"


def _files(folder: Path) -> dict[str, Path]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    files = {path.relative_to(folder).as_posix(): path for path in paths}
    files.pop(MANIFEST, None)
    return files


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
