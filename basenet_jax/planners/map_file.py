"""Reachability maps in files, marked with what they were made for."""

import hashlib
import os

import jax
import jax.numpy as jnp
import numpy as np

from basenet_jax.config import GridConfig, PickConfig
from basenet_jax.planners.reachability import ReachabilityMap, map_shape
from basenet_jax.robot.model import Robot
from basenet_jax.weights_file import load_weights, save_weights

# The number goes up whenever maps are computed in another way.
FORMAT = "basenet-reachability/1"


def save_map(
    path: str | os.PathLike[str], reach_map: ReachabilityMap, robot: Robot, grid: GridConfig, config: PickConfig
) -> None:
    """Writes a map, whole or not at all, with the marks of its robot and configuration.

    Raises:
        OSError: the file can't be written.
    """
    arrays = {"height": np.asarray(reach_map.height, np.float32), "reachable": np.asarray(reach_map.reachable)}
    save_weights(path, arrays, {"format": FORMAT, "made_for": fingerprint(robot, grid, config)})


def load_map(
    path: str | os.PathLike[str], heights: np.ndarray, robot: Robot, grid: GridConfig, config: PickConfig
) -> ReachabilityMap:
    """Reads what `save_map` wrote.

    Args:
        path: of the file.
        heights: of the map that is wanted (m).
        robot: that it is wanted for.
        grid: likewise.
        config: likewise.

    Raises:
        ValueError: the file is missing, damaged, or holds a map of another format, robot, configuration or other
            heights; the message names the file and what is wrong.
    """
    heights = np.asarray(heights, np.float32)
    like = {
        "height": jax.ShapeDtypeStruct(heights.shape, jnp.float32),
        "reachable": jax.ShapeDtypeStruct((len(heights), *map_shape(robot, grid, config)), jnp.bool_),
    }
    arrays, metadata = load_weights(path, like)
    if metadata.get("format") != FORMAT:
        raise ValueError(f"{path}: format: found {metadata.get('format')!r}, needs {FORMAT!r}")
    if metadata.get("made_for") != fingerprint(robot, grid, config):
        raise ValueError(f"{path}: made_for: the map was made for another robot or configuration")
    found, reachable = (np.asarray(arrays[name]) for name in ("height", "reachable"))
    if not np.array_equal(found, heights):
        raise ValueError(f"{path}: height: found {found.tolist()}, needs {heights.tolist()}")
    return ReachabilityMap(reachable, heights, grid.step_m)


def fingerprint(robot: Robot, grid: GridConfig, config: PickConfig) -> str:
    """SHA-256 of the numbers that a map depends on, the robot's in single precision; of some others too."""
    digest = hashlib.sha256(repr((robot.prismatic, robot.closed_form, grid.step_m, grid.turns, config)).encode())
    for path, leaf in jax.tree_util.tree_leaves_with_path(robot):
        values = np.asarray(leaf, "<f4")
        digest.update(f"{jax.tree_util.keystr(path)} {values.shape}".encode() + values.tobytes())
    return digest.hexdigest()
