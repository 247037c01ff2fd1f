"""Which grasps a robot can serve at all: whether some base pose at the table lets it pick them."""

from functools import partial
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.config import WorldConfig
from basenet_jax.planners.candidates import within_reach
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason, pick
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_problem
from basenet_jax.world.grasps import top_down

_PAIRS_AT_ONCE = 512  # of grasp and base pose


def random_grasps(
    robot: Robot, room: Room, count: int, seed: int, world: WorldConfig = WorldConfig()
) -> Float[np.ndarray, "N 4"]:
    """Top-down grasps of the five object classes anywhere on the table: tool0's x, y, z, yaw in W."""
    keys = jax.random.split(jax.random.key(seed), count)
    draw = jax.jit(jax.vmap(lambda key: draw_problem(key, robot, room, config=world.scene)[0]))
    return np.asarray(draw(keys))


class Served:
    """What base poses come to for some grasps.

    Attributes:
        served: by grasp, whether a pose was found.
        base_pose: by grasp, one that serves it.
        pick_time: by grasp, the time of that pick (s).
        farthest: by grasp, the `Reason` reached farthest by a pose that doesn't serve it.
        pairs: how many pairs were tried.
        evaluations: how many were computed, with those that fill up batches, and
        evaluating_s: how long that took, compiling included where it was needed (s).
    """

    def __init__(self, count: int):
        self.served: Bool[np.ndarray, " N"] = np.zeros(count, bool)
        self.base_pose: Float[np.ndarray, "N 3"] = np.zeros((count, 3), np.float32)
        self.pick_time: Float[np.ndarray, " N"] = np.zeros(count, np.float32)
        self.farthest = np.full(count, int(Reason.OUT_OF_REACH))
        self.pairs = self.evaluations = 0
        self.evaluating_s = 0.0

    @property
    def share(self) -> float:
        """Of the grasps that some pose serves."""
        return float(np.mean(self.served))


def serve(
    robot: Robot,
    grasps: Float[np.ndarray, "N 4"],
    base_poses: Float[np.ndarray, "K 3"],
    room: Room,
    world: WorldConfig = WorldConfig(),
    *,
    seed: int = 0,
) -> Served:
    """Looks for a base pose for each grasp, in random order; grasps that have one are asked no further.

    Args:
        robot: the robot.
        grasps: tool0's x, y, z, yaw in W.
        base_poses: clear of the table, (x, y, heading) in W.
        table: the table.
        world: of the picks.
        seed: of the order.
    """
    found = Served(len(grasps))
    near = np.asarray(within_reach(robot, jnp.asarray(base_poses[None]), jnp.asarray(grasps[:, None, :3])))
    order = np.random.default_rng(seed).permuted(np.tile(np.arange(len(base_poses)), (len(grasps), 1)), axis=1)
    waiting = [[pose for pose in own if near[grasp, pose]] for grasp, own in enumerate(order)]
    while True:
        open_grasps = [grasp for grasp in np.flatnonzero(~found.served) if waiting[grasp]]
        if not open_grasps:
            return found
        share = -(-_PAIRS_AT_ONCE // len(open_grasps))
        pairs = [(grasp, pose) for grasp in open_grasps for pose in waiting[grasp][:share]][:_PAIRS_AT_ONCE]
        for grasp, _ in pairs:
            waiting[grasp].pop(0)
        grasp, pose = np.array(pairs).T
        found.pairs, found.evaluations = found.pairs + len(pairs), found.evaluations + _PAIRS_AT_ONCE
        filled = np.resize(np.arange(len(pairs)), _PAIRS_AT_ONCE)  # one shape, one program
        begin = perf_counter()
        picked = _pick(robot, base_poses[pose[filled]], grasps[grasp[filled]], room, world)
        reason, time = (np.asarray(x)[: len(pairs)] for x in picked)
        found.evaluating_s += perf_counter() - begin
        np.maximum.at(found.farthest, grasp, reason)
        good = reason == Reason.NONE
        found.served[grasp[good]], found.base_pose[grasp[good]] = True, base_poses[pose[good]]
        found.pick_time[grasp[good]] = time[good]


@partial(jax.jit, static_argnames="world")
def _pick(
    robot: Robot, base_pose: Float[Array, "P 3"], grasp: Float[Array, "P 4"], room: Room, world: WorldConfig
) -> tuple[Array, Array]:
    picks = pick(robot, jnp.asarray(base_pose), top_down(grasp), room, world.pick)
    return picks.reason, picks.time
