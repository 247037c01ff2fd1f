"""The pick cycle: whether an object can be picked from a base pose, how long it takes, and the arm's waypoints.

A batch goes through two stages. First every arm solution of every pick gets an estimated time (infinite where there
is none). Then the fastest not yet rejected solution of each undecided pick is refined and checked in full; picks that
fail go round again with their next solution, in chunks of undecided picks only, until all are decided.
"""

import enum
import itertools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds, struct
from basenet_jax.config import PickConfig
from basenet_jax.robot.ik import damped_least_squares, residual
from basenet_jax.robot.kinematics import Vector, components
from basenet_jax.robot.model import Robot
from basenet_jax.task import arm_solutions
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import base_collides, capsules_touch

# (robot, base pose as x, y, heading, joints, table) -> whether the arm touches anything; the default is the kernels'.
ArmCheck = Callable[[Robot, Vector, Array, Room], Array]


class Reason(enum.IntEnum):
    """Why a step of a plan fails: the first rule at which no arm solution is left, or what stopped the drive."""

    NONE = 0
    BASE_COLLIDES = 1
    OUT_OF_REACH = 2
    NO_STRAIGHT_DESCENT = 3
    ARM_COLLIDES = 4
    UNREACHABLE = 5
    NOT_EXECUTED = 6


@struct.dataclass
class Pick:
    """Outcome of picks. Waypoints: pre-grasp, the heights in between from top to bottom, grasp."""

    feasible: Bool[Array, "*batch"]
    reason: Int[Array, "*batch"]  # a `Reason`
    time: Float[Array, "*batch"]  # s, of the whole cycle; 0 where infeasible
    joints: Float[Array, "*batch waypoints dof"]  # rad; home where infeasible


def pick(
    robot: Robot,
    base_pose: Float[Array, "*batch 3"],
    grasp: Float[Array, "*batch 4"],
    room: Room,
    config: PickConfig = PickConfig(),
    arm_check: ArmCheck = capsules_touch,
    *,
    seeds: Float[Array, "seeds dof"] | None = None,
) -> Pick:
    """Whether and how fast objects are picked from base poses.

    Among the feasible arm solutions (all branches, and both grasp yaws for a symmetric gripper) the fastest is taken.

    Args:
        robot: the robot.
        base_pose: of the base, (x, y, heading) in W.
        grasp: of tool0, (x, y, z, yaw) in W; see `Scene.grasps`.
        room: one for the whole batch, or one per pick.
        config: heights, tolerances and durations of the cycle.
        arm_check: tests joint states for collision.
        seeds: joints that the search for solutions begins at where there is no closed form; by default a lattice's.
    """
    batch = jnp.broadcast_shapes(base_pose.shape[:-1], grasp.shape[:-1])
    base_pose = jnp.broadcast_to(base_pose, (*batch, 3)).reshape(-1, 3)
    grasp = jnp.broadcast_to(grasp, (*batch, 4)).reshape(-1, 4)
    if room.batched:
        unbatched = room.boxes.low.ndim - 1
        room = jax.tree.map(
            lambda x: jnp.broadcast_to(x, (*batch, *x.shape[unbatched:])).reshape(-1, *x.shape[unbatched:]), room
        )
    collides = base_collides(robot, base_pose, room, config.base_clearance_m, config.touching_m)
    picks = arm_solutions.Picks(components(base_pose), components(grasp))
    solutions = arm_solutions.solve(robot, picks, config, seeds)
    estimate = jnp.where(collides, jnp.inf, solutions.estimate)
    home = jnp.asarray(robot.home, estimate.dtype)[:, None, None]
    search = _Search(
        estimate=estimate,
        rule=jnp.where(collides, Reason.BASE_COLLIDES, Reason.OUT_OF_REACH),
        decided=~jnp.any(jnp.isfinite(estimate), axis=0),
        time=jnp.zeros_like(estimate[0]),
        joints=jnp.broadcast_to(home, (robot.dof, len(arm_solutions.heights(config)), len(grasp))),
    )

    def attempt(index: Array, search: _Search) -> _Search:
        part, own_solutions = rounds.take((picks, solutions), index)
        own_table = rounds.take(room, index, axis=0) if room.batched else room
        return _attempt(robot, part, own_solutions, own_table, config, arm_check, search)

    for chunk, rest in itertools.pairwise((*_chunks(len(grasp), config), 0)):
        search = rounds.until_settled(lambda search: ~search.decided, attempt, search, chunk, leave=rest)
    return Pick(
        feasible=(search.rule == Reason.NONE).reshape(batch),
        reason=search.rule.reshape(batch),
        time=search.time.reshape(batch),
        joints=jnp.transpose(search.joints, (2, 1, 0)).reshape(*batch, -1, robot.dof),
    )


def estimate_pick_time(
    robot: Robot,
    base_pose: Float[Array, "*batch 3"],
    grasp: Float[Array, "*batch 4"],
    config: PickConfig = PickConfig(),
) -> Float[Array, "*batch"]:
    """Duration (s) of the cycle by the fastest arm solution; infinite if there is none.

    `pick`'s duration but for rounding, unless clearance or the descent leave only a slower solution, or none; at a
    small part of its cost.

    Args:
        robot: the robot.
        base_pose: of the base, (x, y, heading) in W; isn't tested for collision.
        grasp: of tool0, (x, y, z, yaw) in W.
        config: heights, tolerances and durations of the cycle.
    """
    batch = jnp.broadcast_shapes(base_pose.shape[:-1], grasp.shape[:-1])
    base_pose = jnp.broadcast_to(base_pose, (*batch, 3)).reshape(-1, 3)
    grasp = jnp.broadcast_to(grasp, (*batch, 4)).reshape(-1, 4)
    picks = arm_solutions.Picks(components(base_pose), components(grasp))
    return jnp.min(arm_solutions.solve(robot, picks, config).estimate, axis=0).reshape(batch)


class _Search(NamedTuple):
    """The search through each pick's solutions (K solutions, B picks)."""

    estimate: Float[Array, "K B"]  # s; infinite once rejected
    rule: Int[Array, " B"]  # the rule reached farthest so far; NONE once found feasible
    decided: Bool[Array, " B"]
    time: Float[Array, " B"]
    joints: Float[Array, "dof waypoints B"]


def _chunks(count: int, config: PickConfig) -> tuple[int, ...]:
    """How many undecided picks of a batch are checked in one round, falling; each is taken while more are undecided
    than the next one holds.

    A round costs as much for the last few undecided picks as for a full chunk, and there are up to as many rounds as
    solutions. So small batches go in small chunks, and so do the last picks of large ones.
    """
    first = min(count, config.chunk, max(config.smallest_chunk, count // 16))
    return (first, config.smallest_chunk) if first >= 4 * config.smallest_chunk else (first,)


def _attempt(robot, picks, solutions, room, config: PickConfig, arm_check: ArmCheck, search: _Search) -> _Search:
    """Checks the fastest remaining solution of undecided picks."""
    choice = jnp.argmin(search.estimate, axis=0)
    rule, time, joints = _check(robot, picks, solutions, choice, room, config, arm_check)
    feasible = rule == Reason.NONE
    estimate = search.estimate.at[choice, jnp.arange(len(choice))].set(jnp.inf)
    return _Search(
        estimate=estimate,
        rule=jnp.where(feasible, rule, jnp.maximum(rule, search.rule)),
        decided=feasible | ~jnp.any(jnp.isfinite(estimate), axis=0),
        time=jnp.where(feasible, time, 0.0),
        joints=jnp.where(feasible, joints, search.joints),
    )


def _check(robot, picks, solutions, choice, room, config: PickConfig, arm_check: ArmCheck):
    """Refines one solution of each pick; the first rule it breaks (NONE if none), its cycle's duration, its joints."""
    target, joints = arm_solutions.waypoints(robot, picks, solutions, choice, config)
    joints = damped_least_squares(robot, target, joints, config.refinements)
    position_error, orientation_error = residual(robot, target, joints)
    reached = (position_error <= config.position_tolerance_m) & (orientation_error <= config.orientation_tolerance_rad)
    steps = jnp.abs(joints[:, 1:] - joints[:, :-1])
    smooth = jnp.max(steps, axis=(0, 1)) <= config.max_descent_step_rad
    touches = jnp.any(arm_check(robot, picks.base_pose, _checked_states(robot, joints, config), room), axis=0)
    rule = jnp.where(touches, Reason.ARM_COLLIDES, Reason.NONE)
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
