"""Where reachability maps are kept on disk, and how one is known to be of a robot and a configuration."""

import hashlib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from basenet_jax.compilation import cache_folder
from basenet_jax.robot.model import Robot


def fingerprint(robot: Robot, *made_with: Any) -> str:
    """SHA-256 of the numbers that a map depends on, the robot's in single precision; of some others too.

    Args:
        robot: the robot.
        made_with: what else it depends on, known by its `repr`.
    """
    digest = hashlib.sha256(repr((robot.prismatic, robot.closed_form, *made_with)).encode())
    for path, leaf in jax.tree_util.tree_leaves_with_path(robot):
        values = np.asarray(leaf, "<f4")
        digest.update(f"{jax.tree_util.keystr(path)} {values.shape}".encode() + values.tobytes())
    return digest.hexdigest()


def map_folder() -> Path | None:
    """Where maps are kept on disk, beside compiled programs; None where nothing is kept."""
    folder = cache_folder()
    return None if folder is None else folder / "reachability"


def keep(folder: Path | None, write: Callable[[Path], None]) -> None:
    """Writes into the folder, which is created when needed; where that can't be done it is said, and is no error.

    Args:
        folder: None: nothing is kept.
        write: is given the folder.
    """
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write(folder)
    except OSError as error:
        warnings.warn(
            f"{folder}: reachability maps can't be kept here ({error.strerror}), so every run builds them anew;"
            " set XDG_CACHE_HOME to another folder, or BASENET_JAX_CACHE=off",
            RuntimeWarning,
            stacklevel=2,
        )
