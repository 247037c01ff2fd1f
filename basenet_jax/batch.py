"""The front door for many scenes: drawn together, planned together, judged together."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import PRNGKeyArray

from basenet_jax import api
from basenet_jax.api import DriveTable, RobotLike, ScenePlanner
from basenet_jax.config import WorldConfig
from basenet_jax.task.drive_times import DriveFunction
from basenet_jax.task.plan import Plan
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.scene import MAX_OBJECTS, Scene


def sample_scenes(key: PRNGKeyArray, *, count: int, objects: int = 10, world: WorldConfig = WorldConfig()) -> Scene:
    """A batch of random scenes with the same number of objects; robots have no part in them.

    Args:
        key: consumed; one part for each scene.
        count: how many scenes, at least 1.
        objects: in each of them, 1 to 50.
        world: of their table, and how scenes are drawn.

    Raises:
        ValueError: a number is out of range, or in some scene so many objects found no place (try another key).
    """
    if count < 1:
        raise ValueError(f"count: found {count}, allowed are 1 and more")
    if not 1 <= objects <= MAX_OBJECTS:
        raise ValueError(f"objects: found {objects}, allowed are 1 to {MAX_OBJECTS}")
    scenes, placed = _draw(jax.random.split(key, count), objects, world)
    if not bool(jnp.all(placed)):
        raise ValueError(f"objects: found {objects}, which found no place in some scene; draw others, or fewer")
    return scenes


def plan_batch(
    scenes: Scene,
    *,
    planner: str | ScenePlanner = "basenet",
    robot: RobotLike | None = None,
    world: WorldConfig | None = None,
    drive_times: DriveTable | DriveFunction | None = None,
    key: Array | None = None,
    **options: Any,
) -> Plan:
    """Plans many scenes in one call: the learned planners in one program, the others one scene after the other.

    Args:
        scenes: with one leading axis, the table repeated along it and the same for all.
        planner: as for `make_plan`.
        robot: likewise; by default `ur5e_mobile`.
        world: as for `make_plan`.
        drive_times: likewise, of the starts of all scenes.
        key: split into one for each scene; by default `jax.random.key(0)`.
        options: the planner's own, as for `make_planner`; of the learned ones `devices`, how many share the scenes, is
            by default all of this process.

    Returns:
        Plans with the same leading axis, which `execute` judges together with the scenes, given robot and world.

    Raises:
        ValueError: it is no batch, or their tables differ; there aren't so many devices; or see `make_plan`.
    """
    if scenes.mask.ndim != 2 or not len(scenes.mask):
        raise ValueError(
            f"scenes: found a mask of shape {scenes.mask.shape}, needs scenes x objects, at least one scene"
        )
    rooms = np.column_stack([np.asarray(x).reshape(len(scenes.mask), -1) for x in jax.tree.leaves(scenes.room)])
    if not np.all(rooms == rooms[0]):
        raise ValueError("scenes: found several tables; plan the scenes of each table in a call of their own")
    first = jax.tree.map(lambda x: x[0], scenes)
    starts = np.asarray(scenes.robot_start)
    return api.planner_of(first, planner, robot, world, drive_times, options, starts).plan_batch(scenes, key)


@partial(jax.jit, static_argnames=("objects", "world"))
def _draw(keys: Array, objects: int, world: WorldConfig) -> tuple[Scene, Array]:
    room = Room.from_config(world.table)
    return jax.vmap(lambda key: draw_scene(key, objects, room, slots=objects, config=world.scene))(keys)
