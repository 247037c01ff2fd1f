"""Plans executed by a robot that parks with errors: what it can't pick from where it stands is left for later.

The robot drives to the plan's next stop, stands beside it by an error, looks, and picks what it can of what was planned
there. Once something is left over, the plan is worth no more: from then on the next stop is the one where it pays
most to drive at once from where the robot really stands (the rule of greedy-stops), until all is picked or given up.
"""

import dataclasses
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from basenet_jax import struct
from basenet_jax.config import PickConfig, UncertaintyConfig, WorldConfig
from basenet_jax.geometry import compose
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Pick, Rules, pick
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.task.prepared_world import PreparedWorld
from basenet_jax.task.reliability import actual_picks, base_spread, seen_grasps, seen_spread
from basenet_jax.world.boxes import Boxes
from basenet_jax.world.scene import Scene

MOST_TRIES = 3  # parkings for an object, before it is given up
_OUT_OF_REACH_M = 100.0  # where picks that nobody asks for are tried: they cost no search


@struct.dataclass
class Execution:
    """What executing plans comes to, in each of D draws."""

    grasped: Int[Array, "*batch D"]
    navigation: Float[Array, "*batch D"]  # N (s), of all drives
    picking: Float[Array, "*batch D"]  # G (s)
    parkings: Int[Array, "*batch D"]
    at_first: Bool[Array, "*batch D"]  # whether every pick was possible at the first parking for it


class Replanning(NamedTuple):
    """What the robot chooses its next stop by, once the plan is worth no more."""

    prepared: PreparedWorld  # K stops in the room
    pick_time: Float[Array, "*batch K M"]  # s; infinite where the stop doesn't serve the object
    worth: Float[Array, ""] | float  # s, of one object served; see greedy-stops


class _Planned(NamedTuple):
    """A plan by slot, and all stops that are ever driven to: K prepared ones, then those of the plan's M steps."""

    step: Int[Array, " M"]  # that picks the object; M: none does
    group: Int[Array, " M"]  # of the step: which stop of the plan it is at
    stops: Float[Array, "K+M 3"]
    pick_time: Float[Array, "K+M M"]  # s; infinite where the stop doesn't serve the object


class _State(NamedTuple):
    key: PRNGKeyArray  # D of them
    pose: Float[Array, "D 3"]  # where the base stands
    intended: Float[Array, "D 3"]  # where it should
    picked: Bool[Array, "D M"]
    tries: Int[Array, "D M"]  # parkings for an object in vain
    follows: Bool[Array, " D"]  # the plan
    done: Execution


@partial(jax.jit, static_argnames=("uncertainty", "world"))
def simulate_execution(
    robot: Robot,
    scene: Scene,
    plan: Plan,
    outcome: Outcome,
    replanning: Replanning,
    key: PRNGKeyArray,
    *,
    uncertainty: UncertaintyConfig,
    world: WorldConfig = WorldConfig(),
) -> Execution:
    """Executes plans with errors, in as many draws as the uncertainty says.

    The errors of a draw's t-th parking are the same whatever the plan (common random numbers). N counts all drives.
    Where no way leads out from where the base stands, too near to something, its drive takes as long as from where it
    should stand. An object is given up after three parkings for it, or where no way leads to a stop that serves it.

    Args:
        robot: the robot.
        scene: one scene or a batch, all in the room of the prepared stops.
        plan: of the same batch shape.
        outcome: of executing it without errors: what that doesn't grasp is left alone.
        replanning: of the room; pick times of the same batch shape.
        key: consumed; split into one for each scene.
        uncertainty: of parking and seeing; its seed isn't used.
        world: of drives and picks.
    """

    def run(own: tuple[Scene, Plan, Outcome, Array, Array]) -> Execution:
        scene, plan, outcome, times, key = own
        planned = _by_slot(plan, outcome, replanning.prepared, times)
        return _execute(robot, scene, planned, replanning, key, uncertainty, world)

    own = (scene, plan, outcome, replanning.pick_time)
    if scene.mask.ndim == 1:
        return run((*own, key))
    return jax.lax.map(run, (*own, jax.random.split(key, len(scene.mask))))


def _execute(
    robot: Robot,
    scene: Scene,
    planned: _Planned,
    replanning: Replanning,
    key: PRNGKeyArray,
    uncertainty: UncertaintyConfig,
    world: WorldConfig,
) -> Execution:
    draws, slots = uncertainty.draws, len(scene.mask)
    wanted = scene.mask & (planned.step < slots)
    actual = actual_picks(world.pick, uncertainty)

    def left(state: _State) -> Array:
        return wanted & ~state.picked & (state.tries < MOST_TRIES)

    def park(state: _State) -> _State:
        keys = jax.vmap(lambda key: jax.random.split(key, 3))(state.key)
        drives = _drives(robot, replanning.prepared, planned, state)
        stop, targets, drive = _next_stop(planned, left(state), state.follows, drives, replanning.worth)
        arrives = jnp.isfinite(drive)
        stands = compose(planned.stops[stop], _normal(keys[:, 1], (3,)) * base_spread(uncertainty))
        seen = _normal(keys[:, 2], (slots, 3)) * seen_spread(uncertainty)
        asked = targets & arrives[:, None]
        picks = _pick_in_order(robot, scene, stands, seen, asked, scene.mask & ~state.picked, planned.step, actual)
        got = asked & picks.feasible
        fails = jnp.any(targets & ~got, axis=1)
        done = Execution(
            grasped=state.done.grasped + jnp.sum(got, axis=1),
            navigation=state.done.navigation + jnp.where(arrives, drive, 0.0),
            picking=state.done.picking + jnp.sum(jnp.where(got, picks.time, 0.0), axis=1),
            parkings=state.done.parkings + arrives,
            at_first=state.done.at_first & ~fails,
        )
        tries = state.tries + jnp.where(arrives[:, None], 1, MOST_TRIES) * (targets & ~got)
        return _State(keys[:, 0], stands, planned.stops[stop], state.picked | got, tries, state.follows & ~fails, done)

    none, zero = jnp.zeros(draws, jnp.int32), jnp.zeros(draws, scene.robot_start.dtype)
    begin, yes = jnp.broadcast_to(scene.robot_start, (draws, 3)), jnp.ones(draws, bool)
    nothing, untried = jnp.zeros((draws, slots), bool), jnp.zeros((draws, slots), jnp.int32)
    done = Execution(none, zero, zero, none, yes)
    start = _State(jax.random.split(key, draws), begin, begin, nothing, untried, yes, done)
    return jax.lax.while_loop(lambda state: jnp.any(left(state)), park, start).done


def _by_slot(plan: Plan, outcome: Outcome, prepared: PreparedWorld, pick_time: Float[Array, "K M"]) -> _Planned:
    slots = pick_time.shape[1]
    slot = jnp.where(outcome.feasible, plan.object_index, slots)
    moves = jnp.any(plan.base_pose[1:] != plan.base_pose[:-1], axis=-1)
    group = jnp.concatenate([jnp.zeros(1, jnp.int32), jnp.cumsum(moves)])
    # A stop of the plan serves what is planned there, whichever of its steps it is taken from.
    own = (
        jnp.full((slots, slots), jnp.inf)
        .at[:, slot]
        .set(jnp.where(group[:, None] == group, outcome.pick_time, jnp.inf), mode="drop")
    )
    return _Planned(
        step=jnp.full(slots, slots).at[slot].set(jnp.arange(slots), mode="drop"),
        group=group,
        stops=jnp.concatenate([prepared.poses, plan.base_pose]),
        pick_time=jnp.concatenate([pick_time, own.astype(pick_time.dtype)]),
    )


def _drives(robot: Robot, prepared: PreparedWorld, planned: _Planned, state: _State) -> Float[Array, "D K+M"]:
    """Times (s) of drives to all stops from where the bases stand, or should where no way leads out from there."""
    goals = planned.stops[len(prepared.poses) :]

    def times(pose: Array) -> Array:
        each = prepared.drives.each(robot, *jnp.broadcast_arrays(pose[:, None], goals))
        return jnp.concatenate([prepared.first_drives(robot, pose), each], axis=1)

    found = times(state.pose)
    stuck = ~jnp.any(jnp.isfinite(found), axis=1, keepdims=True)
    return jax.lax.cond(
        jnp.any(stuck),
        lambda: jnp.where(stuck, times(jnp.where(stuck, state.intended, state.pose)), found),
        lambda: found,
    )


def _next_stop(
    planned: _Planned,
    left: Bool[Array, "D M"],
    follows: Bool[Array, " D"],
    drives: Float[Array, "D K+M"],
    worth: Float[Array, ""] | float,
) -> tuple[Int[Array, " D"], Bool[Array, "D M"], Float[Array, " D"]]:
    """Where to park next, what is to be picked there, and the drive (s); infinite where nothing is left or can be had.

    Without a way to any stop, all that is left is said to be picked where no drive leads.
    """
    slots = left.shape[1]
    serves = jnp.isfinite(planned.pick_time)
    excess = planned.pick_time - jnp.min(planned.pick_time, axis=0)
    gain = jnp.where(serves, worth - excess, 0.0)
    useful = jnp.any(left[:, None] & serves, axis=2)
    cost = jnp.where(useful, drives - left.astype(gain.dtype) @ gain.T, jnp.inf)
    paying = jnp.argmin(cost, axis=1)
    first = jnp.min(jnp.where(left, planned.step, slots), axis=1)
    own = len(planned.stops) - slots + jnp.minimum(first, slots - 1)
    stop = jnp.where(follows, own, paying)
    drive = jnp.take_along_axis(drives, stop[:, None], axis=1)[:, 0]
    can = jnp.take_along_axis(useful, stop[:, None], axis=1)[:, 0] & jnp.isfinite(drive)
    # A plan's stops are told apart by their groups: it may come back to a pose.
    group = planned.group[jnp.minimum(planned.step, slots - 1)]
    here = jnp.where(follows[:, None], group == planned.group[jnp.minimum(first, slots - 1)][:, None], serves[stop])
    return stop, left & (here | ~can[:, None]), jnp.where(can, drive, jnp.inf)


def _pick_in_order(
    robot: Robot,
    scene: Scene,
    base_pose: Float[Array, "D 3"],
    seen: Float[Array, "D M 3"],
    asked: Bool[Array, "D M"],
    standing: Bool[Array, "D M"],
    rank: Int[Array, " M"],
    config: PickConfig,
) -> Pick:
    """The picks of all objects that are asked for, each among those that are left by the ones before it."""
    slots = jnp.arange(len(rank))
    grasps = seen_grasps(scene, slots, seen)
    poses = jnp.where(asked[..., None], base_pose[:, None], base_pose[:, None] + _OUT_OF_REACH_M)

    def among(neighbours: Boxes | None) -> Pick:
        return pick(robot, poses, grasps, scene.room, config, neighbours=neighbours)

    if not Rules.of(config, scene.room).object_in_the_way:
        return among(None)
    shape = (len(base_pose), len(rank), len(rank))

    def of_each(x: Array, own: int) -> Array:
        """For each of the objects that are picked, all as neighbours."""
        every = jnp.broadcast_to(x, (len(base_pose), *x.shape[x.ndim - 1 - own :]))
        return jnp.broadcast_to(every[:, None], (*shape, *x.shape[x.ndim - own :]))

    boxes = scene.object_boxes
    boxes = dataclasses.replace(
        jax.tree.map(lambda x: of_each(x, x.ndim - 1), boxes), pose=of_each(compose(scene.object_pose, seen), 1)
    )
    earlier = (rank < rank[:, None]) | (slots == slots[:, None])

    def among_left(got: Array) -> Pick:
        gone = (slots == slots[:, None]) | (got[:, None] & earlier)
        return among(dataclasses.replace(boxes, blocks_arm=standing[:, None] & ~gone))

    def again(state: tuple[Array, Pick]) -> tuple[Array, Pick]:
        got = asked & state[1].feasible
        return got, among_left(got)

    # As the judge does: first as if all before had succeeded, again as long as that wasn't so.
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(among_left, asked))
    start = (~asked, dataclasses.replace(nothing, feasible=asked))
    return jax.lax.while_loop(lambda state: jnp.any(state[0] != (asked & state[1].feasible)), again, start)[1]


def _normal(keys: Array, shape: tuple[int, ...]) -> Float[Array, "D ..."]:
    return jax.vmap(lambda key: jax.random.normal(key, shape))(keys)
