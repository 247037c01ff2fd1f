"""The pick cycle: whether an object can be picked from a base pose, how long it takes, and the arm's waypoints.

A batch goes through two stages. First every arm solution of every pick gets an estimated time (infinite where there
is none). Then the fastest not yet rejected solution of each undecided pick is refined and checked in full; picks that
fail go round again with their next solution, in chunks of undecided picks only, until all are decided.
"""

import enum
import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds, struct
from basenet_jax.config import PickConfig
from basenet_jax.robot.ik import damped_least_squares, residual
from basenet_jax.robot.kinematics import Vector
from basenet_jax.robot.model import Robot
from basenet_jax.robot.self_contact import hits_itself
from basenet_jax.robot.singularity import near_singular
from basenet_jax.task import arm_solutions
from basenet_jax.world.boxes import Boxes, Room
from basenet_jax.world.clearance import base_collides, capsules_touch
from basenet_jax.world.contacts import boxes_touched
from basenet_jax.world.grasps import Grasps

# (robot, base pose as x, y, heading, joints, table) -> whether the arm touches anything; the default is the kernels'.
ArmCheck = Callable[[Robot, Vector, Array, Room], Array]


class Reason(enum.IntEnum):
    """Why a step of a plan fails: the first rule at which no arm solution is left, or what stopped the drive."""

    NONE = 0
    BASE_COLLIDES = 1
    OUT_OF_REACH = 2
    NO_STRAIGHT_DESCENT = 3
    ARM_COLLIDES = 4
    OBJECT_IN_THE_WAY = 5
    ARM_HITS_ITSELF = 6
    NEAR_SINGULAR = 7
    UNREACHABLE = 8
    NOT_EXECUTED = 9


class Rules(NamedTuple):
    """Which of the rules hold that not every world has."""

    object_in_the_way: bool
    arm_hits_itself: bool
    near_singular: bool

    @classmethod
    def of(cls, config: PickConfig, room: Room) -> "Rules":
        """Those of a room."""
        switches = (getattr(config, name) for name in cls._fields)
        return cls(*(room.cluttered if switch == "by-room" else switch == "on" for switch in switches))


@struct.dataclass
class Pick:
    """Outcome of picks. Waypoints: pre-grasp, the heights in between from top to bottom, grasp."""

    feasible: Bool[Array, "*batch"]
    reason: Int[Array, "*batch"]  # a `Reason`
    time: Float[Array, "*batch"]  # s, of the whole cycle; 0 where infeasible
    joints: Float[Array, "*batch waypoints dof"]  # rad; home where infeasible
    grasp: Int[Array, "*batch"]  # which of the G grasps; -1 where infeasible


def pick(
    robot: Robot,
    base_pose: Float[Array, "*batch 3"],
    grasps: Grasps,
    room: Room,
    config: PickConfig = PickConfig(),
    arm_check: ArmCheck = capsules_touch,
    *,
    neighbours: Boxes | None = None,
    seeds: Float[Array, "seeds dof"] | None = None,
) -> Pick:
    """Whether and how fast objects are picked from base poses.

    Among the feasible arm solutions (all grasps, all branches, both ways to hold a symmetric gripper) the fastest is
    taken.

    Args:
        robot: the robot.
        base_pose: of the base, (x, y, heading) in W.
        grasps: of the objects in W, "*batch G"; see `Scene.grasps`, and `world.grasps.top_down`.
        room: one for the whole batch, or one per pick.
        config: heights, tolerances and durations of the cycle.
        arm_check: tests joint states for collision.
        neighbours: N other objects that still stand, for each of the batch; None: no object is in the way.
        seeds: joints that the search for solutions begins at where there is no closed form; by default a lattice's.
    """
    batch, base_pose, grasps = _flat(base_pose, grasps)
    if room.batched:
        room = _rows(room, room.boxes.low.ndim - 1, batch)
    rules = Rules.of(config, room)
    if neighbours is not None:
        neighbours = _rows(neighbours, neighbours.low.ndim - 1, batch) if rules.object_in_the_way else None
    collides = base_collides(robot, base_pose, room, config.base_clearance_m, config.touching_m)
    picks = arm_solutions.make_picks(base_pose, grasps)
    solutions = arm_solutions.solve(robot, picks, config, seeds)
    estimate = jnp.where(collides, jnp.inf, solutions.estimate)
    home = jnp.asarray(robot.home, estimate.dtype)[:, None, None]
    search = _Search(
        estimate=estimate,
        rule=jnp.where(collides, Reason.BASE_COLLIDES, Reason.OUT_OF_REACH),
        decided=~jnp.any(jnp.isfinite(estimate), axis=0),
        time=jnp.zeros_like(estimate[0]),
        joints=jnp.broadcast_to(home, (robot.dof, len(arm_solutions.heights(config)), len(base_pose))),
        grasp=jnp.full(len(base_pose), -1),
    )

    def attempt(index: Array, search: _Search) -> _Search:
        part, own_solutions = rounds.take((picks, solutions), index)
        own_room = rounds.take(room, index, axis=0) if room.batched else room
        others = None if neighbours is None else rounds.take(neighbours, index, axis=0)
        return _attempt(robot, part, own_solutions, own_room, others, config, arm_check, search)

    for chunk, rest in itertools.pairwise((*_chunks(len(base_pose), config), 0)):
        search = rounds.until_settled(lambda search: ~search.decided, attempt, search, chunk, leave=rest)
    return Pick(
        feasible=(search.rule == Reason.NONE).reshape(batch),
        reason=search.rule.reshape(batch),
        time=search.time.reshape(batch),
        joints=jnp.transpose(search.joints, (2, 1, 0)).reshape(*batch, -1, robot.dof),
        grasp=search.grasp.reshape(batch),
    )


def estimate_pick_time(
    robot: Robot,
    base_pose: Float[Array, "*batch 3"],
    grasps: Grasps,
    config: PickConfig = PickConfig(),
) -> Float[Array, "*batch"]:
    """Duration (s) of the cycle by the fastest arm solution; infinite if there is none.

    `pick`'s duration but for rounding, unless clearance or the descent leave only a slower solution, or none; at a
    small part of its cost.

    Args:
        robot: the robot.
        base_pose: of the base, (x, y, heading) in W; isn't tested for collision.
        grasps: of the objects in W, "*batch G".
        config: heights, tolerances and durations of the cycle.
    """
    batch, base_pose, grasps = _flat(base_pose, grasps)
    picks = arm_solutions.make_picks(base_pose, grasps)
    return jnp.min(arm_solutions.solve(robot, picks, config).estimate, axis=0).reshape(batch)


def _rows(tree: Any, own: int, batch: tuple[int, ...]) -> Any:
    """A tree of arrays, whose batches end after `own` axes, broadcast to a batch, as rows."""

    def rows(x: Array) -> Array:
        return jnp.broadcast_to(x, (*batch, *x.shape[own:])).reshape(math.prod(batch), *x.shape[own:])

    return jax.tree.map(rows, tree)


def _flat(base_pose: Float[Array, "*batch 3"], grasps: Grasps) -> tuple[tuple[int, ...], Array, Grasps]:
    """Base poses and grasps broadcast to one batch, which comes first, as rows."""
    batch = jnp.broadcast_shapes(base_pose.shape[:-1], grasps.approach.shape[:-1])

    return batch, _rows(base_pose, base_pose.ndim - 1, batch), _rows(grasps, grasps.approach.ndim - 1, batch)


class _Search(NamedTuple):
    """The search through each pick's solutions (K solutions, B picks)."""

    estimate: Float[Array, "K B"]  # s; infinite once rejected
    rule: Int[Array, " B"]  # the rule reached farthest so far; NONE once found feasible
    decided: Bool[Array, " B"]
    time: Float[Array, " B"]
    joints: Float[Array, "dof waypoints B"]
    grasp: Int[Array, " B"]


def _chunks(count: int, config: PickConfig) -> tuple[int, ...]:
    """How many undecided picks of a batch are checked in one round, falling; each is taken while more are undecided
    than the next one holds.

    A round costs as much for the last few undecided picks as for a full chunk, and there are up to as many rounds as
    solutions. So small batches go in small chunks, and so do the last picks of large ones.
    """
    first = min(count, config.chunk, max(config.smallest_chunk, count // 16))
    return (first, config.smallest_chunk) if first >= 4 * config.smallest_chunk else (first,)


def _attempt(
    robot, picks, solutions, room, neighbours, config: PickConfig, arm_check: ArmCheck, search: _Search
) -> _Search:
    """Checks the fastest remaining solution of undecided picks."""
    choice = jnp.argmin(search.estimate, axis=0)
    rule, time, joints = _check(robot, picks, solutions, choice, room, neighbours, config, arm_check)
    feasible = rule == Reason.NONE
    estimate = search.estimate.at[choice, jnp.arange(len(choice))].set(jnp.inf)
    return _Search(
        estimate=estimate,
        rule=jnp.where(feasible, rule, jnp.maximum(rule, search.rule)),
        decided=feasible | ~jnp.any(jnp.isfinite(estimate), axis=0),
        time=jnp.where(feasible, time, 0.0),
        joints=jnp.where(feasible, joints, search.joints),
        grasp=jnp.where(feasible, arm_solutions.grasp_of(picks, solutions, choice), search.grasp),
    )


def _check(robot, picks, solutions, choice, room, neighbours, config: PickConfig, arm_check: ArmCheck):
    """Refines one solution of each pick; the first rule it breaks (NONE if none), its cycle's duration, its joints."""
    target, joints = arm_solutions.waypoints(robot, picks, solutions, choice, config)
    joints = damped_least_squares(robot, target, joints, config.refinements)
    position_error, orientation_error = residual(robot, target, joints)
    reached = (position_error <= config.position_tolerance_m) & (orientation_error <= config.orientation_tolerance_rad)
    steps = jnp.abs(joints[:, 1:] - joints[:, :-1])
    smooth = jnp.max(steps, axis=(0, 1)) <= config.max_descent_step_rad
    states, rules = _checked_states(robot, joints, config), Rules.of(config, room)
    rule = jnp.full(choice.shape, int(Reason.NONE))
    if rules.near_singular:
        singular = jnp.any(near_singular(robot, joints, config.least_singular_value), axis=0)
        rule = jnp.where(singular, Reason.NEAR_SINGULAR, rule)
    if rules.arm_hits_itself:
        rule = jnp.where(jnp.any(hits_itself(robot, states), axis=0), Reason.ARM_HITS_ITSELF, rule)
    if neighbours is not None:
        in_the_way = jnp.any(boxes_touched(robot, picks.base_pose, states, neighbours), axis=-1)
        rule = jnp.where(in_the_way, Reason.OBJECT_IN_THE_WAY, rule)
    touches = jnp.any(arm_check(robot, picks.base_pose, states, room), axis=0)
    rule = jnp.where(touches, Reason.ARM_COLLIDES, rule)
    rule = jnp.where(smooth & jnp.all(reached, axis=0), rule, Reason.NO_STRAIGHT_DESCENT)
    rule = jnp.where(reached[0] & reached[-1], rule, Reason.OUT_OF_REACH)
    duration = arm_solutions.cycle_duration(robot, tuple(joints[:, 0]), tuple(joints[:, -1]), config)
    return rule, duration, joints


def checked_fractions(config: PickConfig) -> np.ndarray:
    """Fractions of the moves home -> pre-grasp and pre-grasp -> stow at which the arm is checked."""
    return np.arange(1, config.swept_points + 1) / (config.swept_points + 1)


def _checked_states(
    robot: Robot, joints: Float[Array, "dof waypoints B"], config: PickConfig
) -> Float[Array, "dof states B"]:
    """The joint states of rule 4: all waypoints, then points inside the moves to pre-grasp and to stow.

    Each state is a weighted sum of home, stow and the waypoints, so one small matrix product makes them all.
    """
    waypoints, fractions = joints.shape[1], checked_fractions(config)[:, None]
    from_pregrasp = np.eye(waypoints)[:1]
    weights = np.concatenate([np.eye(waypoints), fractions * from_pregrasp, (1 - fractions) * from_pregrasp])
    zero, rest = np.zeros((waypoints, 1)), np.zeros_like(fractions)
    home, stow = np.concatenate([zero, 1 - fractions, rest]), np.concatenate([zero, rest, fractions])
    fixed = jnp.asarray(home * jnp.asarray(robot.home) + stow * jnp.asarray(robot.stow), joints.dtype)
    moving = jnp.einsum("sw,jwb->jsb", weights.astype(joints.dtype), joints, precision=jax.lax.Precision.HIGHEST)
    return moving + fixed.T[:, :, None]
