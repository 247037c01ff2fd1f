"""Reachability maps by grasp height, made once and kept: in memory, and in the user's cache folder."""

import re
import warnings
from collections.abc import Iterable
from pathlib import Path

import jax
import numpy as np
from jax import Array
from jaxtyping import Float

from basenet_jax.compilation import cache_folder
from basenet_jax.config import GridConfig, PickConfig
from basenet_jax.planners.map_file import load_map, save_map
from basenet_jax.planners.reachability import ReachabilityMap, build_map, map_shape
from basenet_jax.robot.model import Robot
from basenet_jax.world.scene import Scene

# Maps are made for heights rounded to this (m), a tenth of the tolerance of inverse kinematics.
HEIGHT_STEP = 1e-4


def map_folder() -> Path | None:
    """Where maps are kept on disk, beside compiled programs; None where nothing is kept."""
    folder = cache_folder()
    return None if folder is None else folder / "reachability"


class MapStore:
    """The maps of one robot.

    A file that is missing, damaged or made for something else is made anew and replaced.
    """

    def __init__(self, robot: Robot, grid: GridConfig, config: PickConfig, folder: Path | None):
        """Reads nothing yet.

        Args:
            robot: the robot.
            grid: its step and number of headings are the bins'.
            config: of inverse kinematics.
            folder: where to keep maps; it is created when needed. None: in memory alone.
        """
        self._robot, self._grid, self._config = robot, grid, config
        self._folder = folder
        self._shape = map_shape(robot, grid, config)
        self._layers: dict[int, np.ndarray] = {}  # by height in steps

    def for_scene(self, scene: Scene) -> ReachabilityMap:
        """A map with one layer for each slot of an unbatched scene, in their order; those of empty slots are empty."""
        mask, height = jax.device_get((scene.mask, _grasp_height(scene)))
        steps = [round(float(z) / HEIGHT_STEP) for z in height]
        self._make_available({step for step, is_object in zip(steps, mask, strict=True) if is_object})
        layers = np.zeros((len(mask), *self._shape), bool)
        for slot in np.flatnonzero(mask):
            layers[slot] = self._layers[steps[slot]]
        return ReachabilityMap(layers, np.array(steps, np.float32) * np.float32(HEIGHT_STEP), self._grid.step_m)

    def _make_available(self, steps: Iterable[int]) -> None:
        """Loads the layers of these heights, or builds all that can't be loaded in one sweep."""
        missing = [step for step in sorted(set(steps) - set(self._layers)) if not self._load(step)]
        if not missing:
            return
        built = build_map(self._robot, [step * HEIGHT_STEP for step in missing], self._grid, self._config)
        for step, layer in zip(missing, built.reachable, strict=True):
            self._layers[step] = layer
        self._save(missing)

    def _load(self, step: int) -> bool:
        """Whether the layer's file could be used; a cache's faults are no errors: the layer is then built again."""
        if self._folder is None:
            return False
        height = np.array([step * HEIGHT_STEP])
        try:
            loaded = load_map(self._path(self._folder, step), height, self._robot, self._grid, self._config)
        except ValueError:
            return False
        self._layers[step] = loaded.reachable[0]
        return True

    def _save(self, steps: list[int]) -> None:
        if self._folder is None:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            for step in steps:
                height = np.array([step * HEIGHT_STEP], np.float32)
                layer = ReachabilityMap(self._layers[step][None], height, self._grid.step_m)
                save_map(self._path(self._folder, step), layer, self._robot, self._grid, self._config)
        except OSError as error:
            warnings.warn(
                f"{self._folder}: reachability maps can't be kept here ({error.strerror}), so every run builds them"
                " anew; set XDG_CACHE_HOME to another folder, or BASENET_JAX_CACHE=off",
                RuntimeWarning,
                stacklevel=2,
            )

    def _path(self, folder: Path, step: int) -> Path:
        name = re.sub(r"\W", "_", self._robot.name)
        return folder / f"{name}-{self._grid.step_m:g}m-{self._grid.turns}-{step * HEIGHT_STEP:.4f}.map"


@jax.jit
def _grasp_height(scene: Scene) -> Float[Array, " M"]:
    return scene.grasps[:, 2]
