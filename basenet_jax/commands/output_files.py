"""Output files and folders that a user names: found wrong before hours of work, not after."""

import os
from pathlib import Path


def check_output_file(option: str, path: Path, suffixes: tuple[str, ...] = ()) -> None:
    """Whether a file can be written there, as far as can be told without writing.

    Raises:
        ValueError: it can't; the message names the option, what was found and what is allowed.
    """
    if suffixes and path.suffix.lower() not in suffixes:
        raise ValueError(f"{option}: found {path}, allowed are names ending in {', '.join(suffixes)}")
    check_name(option, path)
    if path.is_dir():
        raise ValueError(f"{option}: found {path}, which is a folder, allowed is a file")
    if not path.parent.is_dir():
        raise ValueError(f"{option}: found {path}, whose folder isn't there, allowed is a file in a folder that is")
    # A regular file is replaced by a new one, which takes the right to write to its folder.
    device = path.exists() and not path.is_file()
    if not os.access(path if device else path.resolve().parent, os.W_OK):
        raise ValueError(f"{option}: found {path}, which can't be written, allowed is a file that can")


def check_name(option: str, path: Path) -> None:
    """That the system takes a name, whether or not something is there: not one that is too long or leads in circles.

    Raises:
        ValueError: it doesn't; the message names the option, what was found and why.
    """
    try:
        path.stat()
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        found = f"{str(path)[:57]}..." if len(str(path)) > 60 else path
        raise ValueError(f"{option}: found {found}, which can't be used: {why}, allowed is another name") from None


def check_different(paths: dict[str, Path | None]) -> None:
    """That no output overwrites an input or another output.

    Args:
        paths: by option; None for an option that isn't given.

    Raises:
        ValueError: two are one file.
    """
    seen: dict[Path, str] = {}
    for option, path in paths.items():
        if path is not None:
            check_name(option, path)
        if path is None or (path.exists() and not path.is_file()):
            continue
        if other := seen.get(path.resolve()):
            raise ValueError(f"{option}: found {path}, which is {other} too, allowed is another file")
        seen[path.resolve()] = option
