"""How sure a pick is where the base parks with an error: the share of fixed draws in which it is feasible.

The same draws serve every pair of stop and object (common random numbers): two stops then differ by what they are, not
by luck. They are in order of size, the largest first, so that a pair that is going to fail does so at once.

There is a fine way, `pick` with all its rules, and a coarse one, whether some arm solution is left by
`estimate_pick_time` and the base stands clear. No pick is feasible where that says no, so it bounds the fine way from
above, at a fifth of its cost.
"""

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from basenet_jax import rounds, struct
from basenet_jax.compilation import Stored
from basenet_jax.config import PickConfig, UncertaintyConfig
from basenet_jax.geometry import compose
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import estimate_pick_time, pick
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import base_collides
from basenet_jax.world.grasps import Grasps, in_world
from basenet_jax.world.scene import Scene

PAIRS_AT_ONCE = 256  # of stop and object, looked at in one round
_DRAWS_AT_ONCE = 8  # of each of them
_ROUNDING = 1e-6  # of a number of draws


@struct.dataclass
class Errors:
    """What goes wrong in each of D parkings."""

    base: Float[Array, "*batch D 3"]  # x, y (m), heading (rad), in the frame of the pose where it should stand
    seen: Float[Array, "*batch D 3"]  # of an object: x, y (m), yaw (rad), in its own frame

    def __getitem__(self, index: slice) -> "Errors":
        """Some of the draws."""
        return Errors(self.base[..., index, :], self.seen[..., index, :])


@struct.dataclass
class Chance:
    """How sure picks are to be: a chance constraint on every pair of stop and object."""

    errors: Errors  # D draws
    allowed: Int[Array, ""]  # so many of them may fail
    uncertainty: UncertaintyConfig = struct.field(pytree_node=False)

    @classmethod
    def of(cls, uncertainty: UncertaintyConfig, level: float) -> "Chance":
        """That a pick is feasible in a share of the draws of at least the level."""
        allowed = math.floor((1.0 - level) * uncertainty.draws + _ROUNDING)
        return cls(draw_errors(jax.random.key(uncertainty.seed), uncertainty), jnp.array(allowed), uncertainty)

    @property
    def level(self) -> Float[Array, ""]:
        """The least reliability: that which is asked for, up to whole draws."""
        return 1.0 - self.allowed / len(self.errors.base)

    def holds(self, reliability: Float[Array, "*batch"]) -> Bool[Array, "*batch"]:
        """Whether picks are as reliable as that."""
        return reliability >= self.level - _ROUNDING

    def glance(self, draws: int) -> "Chance":
        """The same with the largest errors alone, so many: most of what isn't reliable fails in these already."""
        return dataclasses.replace(self, errors=self.errors[:draws])


class Tried(NamedTuple):
    """Pairs of stop and object after some of the draws."""

    failed: Int[Array, "K M"]  # draws without a feasible pick
    drawn: Int[Array, "K M"]  # draws looked at


def draw_errors(key: PRNGKeyArray, config: UncertaintyConfig) -> Errors:
    """The draws of a configuration, the base's largest errors (by their standard deviations) first.

    Args:
        key: consumed.
        config: standard deviations, and how many draws.
    """
    base_key, seen_key = jax.random.split(key)
    base = jax.random.normal(base_key, (config.draws, 3))
    base = base[jnp.argsort(-jnp.sum(base**2, axis=-1))]
    return Errors(base * base_spread(config), jax.random.normal(seen_key, (config.draws, 3)) * seen_spread(config))


def base_spread(config: UncertaintyConfig) -> Float[Array, "3"]:
    """Standard deviations of where the base stands: x, y (m), heading (rad)."""
    return jnp.array([config.sd_xy_m, config.sd_xy_m, config.sd_heading_rad])


def seen_spread(config: UncertaintyConfig) -> Float[Array, "3"]:
    """Standard deviations of where an object is seen: x, y (m), yaw (rad)."""
    return jnp.array([config.sd_object_m, config.sd_object_m, config.sd_object_rad])


def actual_picks(config: PickConfig, uncertainty: UncertaintyConfig) -> PickConfig:
    """How picks are judged where the base really stands: the same rules, but for the base's clearance."""
    return dataclasses.replace(config, base_clearance_m=uncertainty.base_clearance_m)


def seen_grasps(scene: Scene, slot: Int[Array, "*batch"], error: Float[Array, "*batch 3"]) -> Grasps:
    """The grasps in W of objects as they are seen, "*batch G".

    Args:
        scene: unbatched.
        slot: of the objects.
        error: x, y (m), yaw (rad) in the objects' frames.
    """
    pose = compose(scene.object_pose[slot], error)
    slot = jnp.broadcast_to(slot, pose.shape[:-1])
    return in_world(scene.object_grasps[slot], pose, scene.object_size[slot], scene.surface_height[slot])


def is_feasible(
    robot: Robot,
    base_pose: Float[Array, "*batch 3"],
    grasps: Grasps,
    room: Room,
    config: PickConfig,
    *,
    fine: bool = True,
) -> Bool[Array, "*batch"]:
    """Whether picks are feasible: by `pick`, or the coarse way, which may say so where they aren't."""
    if fine:
        return pick(robot, base_pose, grasps, room, config).feasible
    clear = ~base_collides(robot, base_pose, room, config.base_clearance_m, config.touching_m)
    return clear & jnp.isfinite(estimate_pick_time(robot, base_pose, grasps, config))


def reliability(
    robot: Robot,
    scene: Scene,
    base_pose: Float[Array, "P 3"],
    slot: Int[Array, " P"],
    errors: Errors,
    config: PickConfig,
    *,
    fine: bool = True,
) -> Float[Array, " P"]:
    """The share of all draws in which an object can be picked from where the base parks, neighbours left out.

    Args:
        robot: the robot.
        scene: unbatched.
        base_pose: where it should park, (x, y, heading) in W.
        slot: of the objects.
        errors: the same for all pairs.
        config: of picks from where it stands, see `actual_picks`.
        fine: by `pick`, or the coarse way.
    """

    def share(pair: tuple[Array, Array]) -> Array:
        pose, slot = pair[0][:, None], pair[1][:, None]
        grasps, stands = seen_grasps(scene, slot, errors.seen), compose(pose, errors.base)
        return jnp.mean(is_feasible(robot, stands, grasps, scene.room, config, fine=fine), axis=-1)

    return rounds.in_chunks(share, (base_pose, slot), max(1, PAIRS_AT_ONCE * _DRAWS_AT_ONCE // len(errors.base)))


def plan_reliability(
    robot: Robot, scene: Scene, plan: Plan, errors: Errors, config: PickConfig, *, fine: bool = True
) -> Float[Array, "*batch M"]:
    """The reliability of each step of plans; 0 for steps without a base pose.

    Args:
        robot: the robot.
        scene: one scene or a batch with one leading axis, all in one room or each in its own.
        plan: of the same batch shape.
        errors: the same for all steps.
        config: of picks from where the base stands, see `actual_picks`.
        fine: by `pick`, or the coarse way.
    """

    def of_one(pair: tuple[Scene, Plan]) -> Array:
        scene, plan = pair
        slot = jnp.maximum(plan.object_index, 0)
        share = reliability(robot, scene, plan.base_pose, slot, errors, config, fine=fine)
        return jnp.where(plan.served, share, 0.0)

    return of_one((scene, plan)) if scene.mask.ndim == 1 else jax.lax.map(of_one, (scene, plan))


compiled_plan_reliability = Stored(plan_reliability, static=("config", "fine"))


def with_reliability(
    robot: Robot, scene: Scene, plan: Plan, outcome: Outcome, chance: Chance, config: PickConfig
) -> Outcome:
    """The outcome with how sure each step is, the fine way; see `plan_reliability`.

    Args:
        robot: of the outcome.
        scene: one, or a batch with one leading axis.
        plan: of the scene.
        outcome: of executing it.
        chance: with the errors.
        config: of the picks that were planned.
    """
    actual = actual_picks(config, chance.uncertainty)
    share = compiled_plan_reliability(robot, scene, plan, chance.errors, config=actual)
    return dataclasses.replace(outcome, reliability=share)


def try_pairs(
    robot: Robot,
    scene: Scene,
    base_pose: Float[Array, "K 3"],
    chosen: Bool[Array, "K M"],
    errors: Errors,
    config: PickConfig,
    *,
    allowed: Int[Array, ""] | int,
    at_least: Int[Array, "K M"] | int = 0,
    fine: bool = True,
    pairs_at_once: int = PAIRS_AT_ONCE,
) -> Tried:
    """Looks at all pairs of stop and object, at each only until it has failed too often.

    That is more often than allowed, if some stop serves the object so often, else more often than the object's best
    stop. So every pair that is reliable enough, or the most reliable of its object, is looked at in all draws.

    Args:
        robot: the robot.
        scene: unbatched.
        base_pose: of the stops, (x, y, heading) in W.
        chosen: the pairs to look at.
        errors: the same for all pairs.
        config: of picks from where the base stands, see `actual_picks`.
        allowed: so many draws may fail.
        at_least: so many do, as is known beforehand; by the coarse way, say.
        fine: by `pick`, or the coarse way.
        pairs_at_once: in one round.
    """
    slots, draws = chosen.shape[1], len(errors.base)
    step = min(_DRAWS_AT_ONCE, draws)

    def is_open(tried: Tried) -> Array:
        tried = jax.tree.map(lambda x: x.reshape(chosen.shape), tried)
        most = jnp.maximum(allowed, _fewest_failures(tried, chosen, draws))
        return (chosen & (tried.drawn < draws) & (jnp.maximum(tried.failed, at_least) <= most)).ravel()

    def look(pair: Array, tried: Tried) -> Tried:
        pose, slot = jnp.divmod(jnp.minimum(pair, chosen.size - 1), slots)
        draw = tried.drawn[:, None] + jnp.arange(step)
        own = jax.tree.map(lambda x: x.at[draw].get(mode="clip"), errors)
        grasps = seen_grasps(scene, slot[:, None], own.seen)
        stands = compose(base_pose[pose][:, None], own.base)
        feasible = is_feasible(robot, stands, grasps, scene.room, config, fine=fine)
        failed = jnp.sum(~feasible & (draw < draws), axis=1)
        return Tried(tried.failed + failed, jnp.minimum(tried.drawn + step, draws))

    nothing = jnp.zeros(chosen.size, jnp.int32)
    tried = rounds.until_settled(is_open, look, Tried(nothing, nothing), min(pairs_at_once, chosen.size), axis=0)
    return jax.tree.map(lambda x: x.reshape(chosen.shape), tried)


def reliable_pairs(
    tried: Tried, chosen: Bool[Array, "K M"], allowed: Int[Array, ""] | int, draws: int
) -> Bool[Array, "K M"]:
    """The pairs that fail no more often than allowed; of an object that has none, those that fail least often.

    Args:
        tried: what came of them.
        chosen: those that were looked at.
        allowed: so many of the draws may fail.
        draws: how many there are.
    """
    most = jnp.maximum(allowed, _fewest_failures(tried, chosen, draws))
    return chosen & (tried.drawn == draws) & (tried.failed <= most)


def _fewest_failures(tried: Tried, chosen: Bool[Array, "K M"], draws: int) -> Int[Array, " M"]:
    """Of each object, in the pairs that were looked at in all draws; D where there is none."""
    done = chosen & (tried.drawn == draws)
    return jnp.min(jnp.where(done, tried.failed, draws), axis=0, initial=draws)
