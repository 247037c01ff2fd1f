"""Pairs of base pose and grasp, drawn until there are enough of each kind."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from basenet_jax.config import WorldConfig
from basenet_jax.learning.config import SacConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason, pick
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_problem
from basenet_jax.world.grasps import top_down

RADIUS_M = 1.2  # base poses are drawn this near to the grasp
_DRAWN_AT_ONCE = 16_384


class Pairs(NamedTuple):
    """Base poses (B, 3) and grasps (B, 4) in W."""

    base_pose: np.ndarray
    grasp: np.ndarray


class Populations(NamedTuple):
    """Two kinds of pairs, and the shares in which they were drawn."""

    clear: Pairs  # the base is clear of the table (rule 1); feasible or not
    feasible: Pairs
    clear_share: float  # of all pairs drawn
    feasible_share: float  # of the clear pairs


def draw_populations(robot: Robot, seed: int, count: int, world: WorldConfig = WorldConfig()) -> Populations:
    """So many clear pairs and so many feasible ones.

    Grasps are the training's of the base-pose policy; base poses are uniform in the disc of `RADIUS_M` about the
    grasp, with any heading.
    """
    room = Room.from_config(world.table)

    @jax.jit
    def draw(key: Array) -> tuple[Array, Array, Array]:
        keys = jax.random.split(key, min(_DRAWN_AT_ONCE, 4 * count) + 1)
        share = SacConfig().own_class_share
        grasp, _ = jax.vmap(lambda key: draw_problem(key, robot, room, own_class_share=share, config=world.scene))(
            keys[1:]
        )
        base_pose = _around(keys[0], grasp)
        return base_pose, grasp, pick(robot, base_pose, top_down(grasp), room, world.pick).reason

    clear, feasible, drawn, rounds = [], [], 0, 0
    while sum(map(len, feasible)) < count or sum(map(len, clear)) < count:
        base_pose, grasp, reason = jax.device_get(draw(jax.random.fold_in(jax.random.key(seed), rounds)))
        both = np.concatenate([base_pose, grasp], axis=-1)
        clear.append(both[reason != Reason.BASE_COLLIDES])
        feasible.append(both[reason == Reason.NONE])
        drawn, rounds = drawn + len(both), rounds + 1
    all_clear, all_feasible = np.concatenate(clear), np.concatenate(feasible)
    return Populations(
        clear=Pairs(all_clear[:count, :3], all_clear[:count, 3:]),
        feasible=Pairs(all_feasible[:count, :3], all_feasible[:count, 3:]),
        clear_share=len(all_clear) / drawn,
        feasible_share=len(all_feasible) / len(all_clear),
    )


def _around(key: Array, grasp: Array) -> Array:
    uniform = jax.random.uniform(key, (len(grasp), 3))
    distance, bearing = RADIUS_M * jnp.sqrt(uniform[:, 0]), 2.0 * jnp.pi * uniform[:, 1]
    offset = distance[:, None] * jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
    heading = (2.0 * uniform[:, 2:] - 1.0) * jnp.pi
    return jnp.concatenate([grasp[:, :2] + offset, heading], axis=-1)
