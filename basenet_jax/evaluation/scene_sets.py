"""The scenes that planners are compared on, in sets of equally many objects."""

import dataclasses
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp

from basenet_jax.config import WorldConfig
from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.world.scene import BY_SLOT, NamedScene, Scene
from basenet_jax.world.scene_file import load_scene

SUFFIXES = (".yaml", ".yml", ".json")


@dataclass(frozen=True)
class SceneSet:
    """B scenes of the same number of objects."""

    labels: tuple[str, ...]  # which scene is which: a number, or a file's name
    scenes: Scene  # a batch of B, every slot with an object

    @property
    def objects(self) -> int:
        """Number of objects in each scene."""
        return self.scenes.mask.shape[-1]

    def __len__(self) -> int:
        return len(self.labels)

    def in_one_room(self) -> bool:
        """Whether all scenes are in the same room."""
        return all(bool(jnp.all(x == x[0])) for x in jax.tree.leaves(self.scenes.room))

    def scene(self, index: int) -> Scene:
        """One scene, unbatched."""
        return jax.tree.map(lambda x: x[index], self.scenes)


def random_set(objects: int, count: int, *, seed: int, world: WorldConfig = WorldConfig()) -> SceneSet:
    """Random scenes; those of one number of objects don't depend on which other numbers are evaluated.

    Raises:
        ValueError: so many objects don't fit on the table.
    """
    key = jax.random.fold_in(jax.random.key(seed), objects)
    return SceneSet(tuple(map(str, range(count))), random_scenes(key, objects, count, world))


def load_sets(folder: Path, robot: str | None = None) -> tuple[str, list[SceneSet]]:
    """All scene files directly in a folder, by increasing number of objects, and the robot to plan for.

    Args:
        folder: of the files.
        robot: to use instead of the one that the files name, as for `load_scene`.

    Raises:
        ValueError: there are none, one is refused (a `SceneFileError`), or they are for different robots.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: found no folder of this name")
    paths = sorted(path for path in folder.iterdir() if path.suffix in SUFFIXES)
    if not paths:
        raise ValueError(f"{folder}: found no scene files, which end in {', '.join(SUFFIXES)}")
    named = [load_scene(path, robot=robot) for path in paths]
    robots = sorted({scene.robot for scene in named})
    if len(robots) > 1:
        raise ValueError(f"{folder}: found scenes for {', '.join(robots)}; an evaluation has one robot")
    groups: dict[int, list[tuple[str, Scene]]] = defaultdict(list)
    for path, scene in zip(paths, named, strict=True):
        groups[len(scene.names)].append((path.name, _without_empty_slots(scene)))
    return robots[0], [_stack(groups[objects]) for objects in sorted(groups)]


def _stack(group: Sequence[tuple[str, Scene]]) -> SceneSet:
    labels, scenes = zip(*group, strict=True)
    return SceneSet(labels, jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes))


def _without_empty_slots(scene: NamedScene) -> Scene:
    count, arrays = len(scene.names), scene.arrays
    own = {name: getattr(arrays, name) for name in BY_SLOT}
    return dataclasses.replace(arrays, **jax.tree.map(lambda x: x[:count], own))
