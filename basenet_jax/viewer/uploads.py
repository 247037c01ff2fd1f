"""Scene and plan files that come from a page and go to it, by way of the loaders that the commands use."""

import tempfile
from pathlib import Path

from basenet_jax.config import WorldConfig
from basenet_jax.task.plan import Plan
from basenet_jax.task.plan_file import load_plan, save_plan
from basenet_jax.viewer.editing import pad
from basenet_jax.viewer.planned import Planned
from basenet_jax.world.occupancy_map import OccupancyMap
from basenet_jax.world.scene import NamedScene
from basenet_jax.world.scene_file import load_scene, save_scene

_SHOWN = 60  # letters of a file's name in messages


def read_scene(name: str, content: bytes, robot: str | None = None, before: NamedScene | None = None) -> NamedScene:
    """The scene of an uploaded file, padded. It can name packaged robots and the map that is shown, no file to read.

    Args:
        name: of the file; JSON if it ends in `.json`, else YAML.
        content: its bytes.
        robot: of the command line, to use instead of the one that the file names.
        before: the scene that is shown, whose map the file may name.

    Raises:
        ValueError: it holds no valid scene; the message is the loader's.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("scene.json" if name.lower().endswith(".json") else "scene.yaml")
        path.write_bytes(content)
        try:
            return pad(load_scene(path, robot=robot, maps=_maps(before)))
        except ValueError as error:
            raise _named(error, path, name) from None


def read_plan(name: str, content: bytes, scene: NamedScene, world: WorldConfig = WorldConfig()) -> Plan:
    """The plan of an uploaded file.

    Raises:
        ValueError: it holds no plan of this scene, or one of another world; the message is the loader's.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.json"
        path.write_bytes(content)
        try:
            return load_plan(path, scene, world)
        except ValueError as error:
            raise _named(error, path, name) from None


def scene_file(scene: NamedScene) -> bytes:
    """A scene as the content of a YAML file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        save_scene(path, scene, maps=_maps(scene))
        return path.read_bytes()


def plan_file(planned: Planned) -> bytes:
    """A plan as the content of a JSON file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.json"
        save_plan(
            path,
            planned.scene,
            planned.plan,
            planned.outcome,
            planner=planned.maker,
            planning_time_s=planned.planning_s or 0.0,
            compile_time_s=0.0,
            world=planned.world,
        )
        return path.read_bytes()


def _maps(scene: NamedScene | None) -> dict[str, OccupancyMap]:
    """The map of a scene, by the name that its file gives it."""
    if scene is None or scene.map is None or scene.furniture is None or not isinstance(scene.furniture.map, str):
        return {}
    return {scene.furniture.map: scene.map}


def _named(error: ValueError, path: Path, name: str) -> ValueError:
    """The same error, with the file called what its owner calls it."""
    return ValueError(str(error).replace(str(path), name[:_SHOWN]))
