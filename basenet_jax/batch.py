"""The front door for many scenes: drawn together, planned together, judged together."""

import os
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import PRNGKeyArray

from basenet_jax import api
from basenet_jax.devices import use_devices
from basenet_jax.planners import protocol
from basenet_jax.robot.reading import DEFAULT_ROBOT
from basenet_jax.task.plan import Plan
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.scene import MAX_OBJECTS, NamedScene, Scene, Table


def sample_scenes(key: PRNGKeyArray, *, count: int, objects: int = 10) -> Scene:
    """A batch of random scenes with the same number of objects.

    Args:
        key: consumed; one part for each scene.
        count: how many scenes, at least 1.
        objects: in each of them, 1 to 50.

    Raises:
        ValueError: a number is out of range, or in some scene so many objects found no place (try another key).
    """
    if count < 1:
        raise ValueError(f"count: found {count}, allowed are 1 and more")
    if not 1 <= objects <= MAX_OBJECTS:
        raise ValueError(f"objects: found {objects}, allowed are 1 to {MAX_OBJECTS}")
    scenes, placed = _draw(jax.random.split(key, count), objects)
    if not bool(jnp.all(placed)):
        raise ValueError(f"objects: found {objects}, which found no place in some scene; draw others, or fewer")
    return scenes


def plan_batch(
    scenes: Scene,
    *,
    planner: str = "basenet",
    robot: str = DEFAULT_ROBOT,
    weights: str | os.PathLike[str] | None = None,
    budget_s: float = 0.0,
    samples: int = 256,
    key: Array | None = None,
    devices: int | None = None,
) -> Plan:
    """Plans many scenes in one call: the learned planners in one program, the others one scene after the other.

    Args:
        scenes: with one leading axis, the table repeated along it and the same for all.
        planner: as for `make_plan`.
        robot: a packaged one's name, or a robot file.
        weights: as for `make_plan`.
        budget_s: likewise, for each scene.
        samples: likewise.
        key: split into one for each scene; by default `jax.random.key(0)`.
        devices: so many share the scenes of the learned planners; by default all of this process.

    Returns:
        Plans with the same leading axis, which `execute` judges together with the scenes, given the robot.

    Raises:
        ValueError: it is no batch, or their tables differ; there aren't so many devices; or see `make_plan`.
    """
    if scenes.mask.ndim != 2 or not len(scenes.mask):
        raise ValueError(
            f"scenes: found a mask of shape {scenes.mask.shape}, needs scenes x objects, at least one scene"
        )
    tables = np.column_stack([np.asarray(x).reshape(len(scenes.mask), -1) for x in jax.tree.leaves(scenes.table)])
    if not np.all(tables == tables[0]):
        raise ValueError("scenes: found several tables; plan the scenes of each table in a call of their own")
    first = NamedScene(jax.tree.map(lambda x: x[0], scenes), names=(), robot=robot)
    shared = use_devices(jax.local_device_count() if devices is None else devices)
    _, made = api.planner_for(first, planner, weights, budget_s, samples, shared)
    return protocol.plan_batch(made, scenes, jax.random.key(0) if key is None else key)


@partial(jax.jit, static_argnames="objects")
def _draw(keys: Array, objects: int) -> tuple[Scene, Array]:
    return jax.vmap(lambda key: draw_scene(key, objects, Table.from_config(), slots=objects))(keys)
