"""Maps of grasps of any orientation in files: made once for a robot, and kept."""

import os
import re
from functools import cached_property
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from basenet_jax.config import PickConfig
from basenet_jax.planners.grasp_map import GraspMap, Shape
from basenet_jax.planners.grasp_map_build import build_grasp_map, map_shape, ways
from basenet_jax.planners.map_files import fingerprint, keep
from basenet_jax.robot.model import Robot
from basenet_jax.weights_file import load_weights, save_weights

# Of map files; the number goes up whenever maps are computed in another way.
FORMAT = "basenet-grasp-map/1"


def save_grasp_map(path: str | os.PathLike[str], grasp_map: GraspMap, robot: Robot, config: PickConfig) -> None:
    """Writes a map, whole or not at all, with the marks of its robot and configuration.

    Raises:
        OSError: the file can't be written.
    """
    arrays = {"bits": grasp_map.bits, "axis": grasp_map.axis}
    save_weights(path, arrays, {"format": FORMAT, "made_for": fingerprint(robot, grasp_map.shape, config)})


def load_grasp_map(
    path: str | os.PathLike[str], robot: Robot, config: PickConfig, shape: Shape | None = None
) -> GraspMap:
    """Reads what `save_grasp_map` wrote.

    Args:
        path: of the file.
        robot: that the map is wanted for.
        config: likewise.
        shape: of the map; by default `map_shape`'s.

    Raises:
        ValueError: the file is missing, damaged, or holds a map of another format, robot or configuration; the message
            names the file and what is wrong.
    """
    shape = map_shape(robot) if shape is None else shape
    like = {
        "bits": jax.ShapeDtypeStruct((-(-shape.total // 8),), jnp.uint8),
        "axis": jax.ShapeDtypeStruct((2,), jnp.float32),
    }
    arrays, metadata = load_weights(path, like)
    if metadata.get("format") != FORMAT:
        raise ValueError(f"{path}: format: found {metadata.get('format')!r}, needs {FORMAT!r}")
    if metadata.get("made_for") != fingerprint(robot, shape, config):
        raise ValueError(f"{path}: made_for: the map was made for another robot or configuration")
    bits, axis = (np.asarray(arrays[name]) for name in ("bits", "axis"))
    return GraspMap(bits=bits, axis=axis, shape=shape, ways=ways(shape, config))


class KeptGraspMap:
    """The map of one robot. A file that is missing, damaged or made for something else is made anew and replaced."""

    def __init__(self, robot: Robot, config: PickConfig, folder: Path | None, shape: Shape | None = None):
        """Reads nothing yet.

        Args:
            robot: the robot.
            config: of inverse kinematics.
            folder: where to keep the map; it is created when needed. None: in memory alone.
            shape: of the map; by default `map_shape`'s.
        """
        self._robot, self._config, self._folder = robot, config, folder
        self._shape = map_shape(robot) if shape is None else shape

    @cached_property
    def map(self) -> GraspMap:
        """Loaded, or built and kept."""
        name = re.sub(r"\W", "_", self._robot.name) + "-any-grasp.map"
        if self._folder is not None:
            try:
                return load_grasp_map(self._folder / name, self._robot, self._config, self._shape)
            except ValueError:  # a cache's faults are no errors
                pass
        built = build_grasp_map(self._robot, self._config, self._shape)
        keep(self._folder, lambda folder: save_grasp_map(folder / name, built, self._robot, self._config))
        return built
