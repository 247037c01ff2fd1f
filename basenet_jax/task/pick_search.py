"""The search through the arm solutions of picks: the fastest that isn't looked at yet, until each pick is decided.

A batch goes through two stages. First every arm solution of every pick gets an estimated time (infinite where there
is none). Then the fastest remaining solution of each undecided pick is refined and checked in full, in chunks of
undecided picks only.
"""

import enum
import functools
import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds
from basenet_jax.config import PickConfig
from basenet_jax.robot import ur
from basenet_jax.robot.ik import damped_least_squares, residual
from basenet_jax.robot.kinematics import Vector
from basenet_jax.robot.model import Robot
from basenet_jax.robot.self_contact import hits_itself
from basenet_jax.robot.singularity import near_singular
from basenet_jax.task import arm_solutions
from basenet_jax.world.boxes import Boxes, Room
from basenet_jax.world.clearance import base_collides
from basenet_jax.world.contacts import boxes_touched

# (robot, base pose as x, y, heading, joints, table) -> whether the arm touches anything; the default is the kernels'.
ArmCheck = Callable[[Robot, Vector, Array, Room], Array]


_SEVERAL = 8  # solutions of a pick looked at in one round, where only few picks are undecided
_MANY = 2 * ur.BRANCHES  # solutions of a pick: more than those of one grasp


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


class PickProblem(NamedTuple):
    """B picks with all their solutions, and what these are checked by."""

    robot: Robot
    picks: arm_solutions.Picks
    solutions: arm_solutions.Solutions
    collides: Bool[Array, " B"]  # the base
    room: Room
    neighbours: Boxes | None
    needed: Bool[Array, "B G T N"] | None  # the neighbours that must be gone for each grasp in any case
    config: PickConfig
    arm_check: ArmCheck

    @classmethod
    def make(
        cls, robot, batch, base_pose, grasps, room, neighbours, config, arm_check, *, seeds=None, needed=None
    ) -> "PickProblem":
        """Of base poses and grasps that are rows of a batch already."""
        if room.batched:
            room = as_rows(room, room.boxes.low.ndim - 1, batch)
        if neighbours is not None:
            neighbours = as_rows(neighbours, neighbours.low.ndim - 1, batch)
        collides = base_collides(robot, base_pose, room, config.base_clearance_m, config.touching_m)
        picks = arm_solutions.make_picks(base_pose, grasps)
        solutions = arm_solutions.solve(robot, picks, config, seeds)
        if needed is not None:
            needed = as_rows(needed, needed.ndim - 3, batch)
        return cls(robot, picks, solutions, collides, room, neighbours, needed, config, arm_check)

    def take(self, index: Int[Array, " at_once"]) -> "PickProblem":
        """Some of the picks."""
        picks, solutions, collides = rounds.take((self.picks, self.solutions, self.collides), index)
        room = rounds.take(self.room, index, axis=0) if self.room.batched else self.room
        around = rounds.take((self.neighbours, self.needed), index, axis=0)
        return PickProblem(self.robot, picks, solutions, collides, room, *around, self.config, self.arm_check)


class Checked(NamedTuple):
    """One solution of each of B picks, looked at in full."""

    rule: Int[Array, " B"]  # the first that it breaks; NONE if none
    time: Float[Array, " B"]  # s
    joints: Float[Array, "dof waypoints B"]
    grasp: Int[Array, " B"]
    touched: Bool[Array, "B N"]  # which neighbours are in the way
    alone: Bool[Array, " B"]  # whether it breaks no rule but that
    needed: Bool[Array, "B G T N"] | None  # of its pick, see `PickProblem`

    @property
    def feasible(self) -> Bool[Array, " B"]:
        """Whether it breaks none."""
        return self.rule == Reason.NONE

    def apart(self, parts: int) -> "Checked":
        """So many equal parts of the batch one after the other, along a new leading axis."""
        joints = self.joints.reshape(*self.joints.shape[:2], parts, -1)
        rest = jax.tree.map(lambda x: x.reshape(parts, len(x) // parts, *x.shape[1:]), self._replace(joints=self.rule))
        return rest._replace(joints=jnp.moveaxis(joints, 2, 0))


class Search(NamedTuple):
    """The search through each pick's solutions (K solutions, B picks)."""

    estimate: Float[Array, "K B"]  # s; infinite once looked at
    rule: Int[Array, " B"]  # the rule reached farthest so far; NONE once found feasible
    decided: Bool[Array, " B"]
    found: Any  # arrays whose last axis is B


# (what is found, solutions that were checked) -> what is found then, whether that decides, and which grasps and turns
# are of no use any more, "B G T"; None: any may be
Keep = Callable[[Any, Checked], tuple[Any, Array, Array | None]]


def search_solutions(problem: PickProblem, start: Any, keep: Keep) -> Search:
    """Looks at the solutions of all picks, the fastest first, until all are decided.

    Args:
        problem: of B picks.
        start: what is found before anything is looked at; arrays whose last axis is B.
        keep: what some solutions that were looked at change.
    """
    estimate = jnp.where(problem.collides, jnp.inf, problem.solutions.estimate)
    search = Search(
        estimate=estimate,
        rule=jnp.where(problem.collides, Reason.BASE_COLLIDES, Reason.OUT_OF_REACH),
        decided=~jnp.any(jnp.isfinite(estimate), axis=0),
        found=start,
    )

    def keep_next(search: Search, looked_at: tuple[Array, Checked]) -> tuple[Search, None]:
        """What a pick's next solution changes, unless it is decided already."""
        choice, checked = looked_at
        found, decides, useless = keep(search.found, checked)
        estimate = search.estimate.at[choice, jnp.arange(len(choice))].set(jnp.inf)
        if useless is not None:  # solutions are numbered grasp by grasp, the turn is last
            of_solution = jnp.transpose(useless, (1, 2, 0))[:, None]
            estimate = jnp.where(of_solution, jnp.inf, estimate.reshape(len(of_solution), -1, *of_solution.shape[2:]))
            estimate = estimate.reshape(search.estimate.shape)
        after = Search(
            estimate=estimate,
            rule=jnp.where(checked.feasible, checked.rule, jnp.maximum(checked.rule, search.rule)),
            decided=decides | ~jnp.any(jnp.isfinite(estimate), axis=0),
            found=found,
        )
        return jax.tree.map(lambda new, old: jnp.where(search.decided, old, new), after, search), None

    def attempt(at_once: int, index: Array, search: Search) -> Search:
        if at_once == 1:
            choice = jnp.argmin(search.estimate, axis=0)
            return keep_next(search, (choice, _check(problem.take(index), choice)))[0]
        choices = jax.lax.top_k(-search.estimate.T, at_once)[1].T  # the fastest first
        several = _check(problem.take(jnp.tile(index, at_once)), choices.ravel())
        return jax.lax.scan(keep_next, search, (choices, several.apart(at_once)))[0]

    levels = _levels(len(problem.collides), len(estimate), problem.config)
    for (chunk, at_once), (rest, _) in itertools.pairwise((*levels, (0, 0))):
        work = functools.partial(attempt, at_once)
        search = rounds.until_settled(lambda search: ~search.decided, work, search, chunk, leave=rest)
    return search


def _levels(count: int, solutions: int, config: PickConfig) -> tuple[tuple[int, int], ...]:
    """How many undecided picks of a batch are checked in one round, falling, and how many solutions of each; a level
    is taken while more are undecided than the next one holds.

    A round costs as much for the last few undecided picks as for a full chunk, and there are up to as many rounds as
    solutions. So small batches go in small chunks, and so do the last picks of large ones. Where picks have many
    solutions, the last few picks have several of them looked at in a round.
    """
    first = min(count, config.chunk, max(config.smallest_chunk, count // 16))
    levels = ((first, 1), (config.smallest_chunk, 1)) if first >= 4 * config.smallest_chunk else ((first, 1),)
    last = levels[-1][0] // _SEVERAL
    return (*levels, (last, _SEVERAL)) if last and solutions > _MANY else levels


def _check(problem: PickProblem, choice: Int[Array, " B"]) -> Checked:
    """Refines one solution of each pick, and tests it by all rules that hold."""
    robot, picks, solutions, config = problem.robot, problem.picks, problem.solutions, problem.config
    target, joints = arm_solutions.waypoints(robot, picks, solutions, choice, config)
    joints = damped_least_squares(robot, target, joints, config.refinements)
    position_error, orientation_error = residual(robot, target, joints)
    reached = (position_error <= config.position_tolerance_m) & (orientation_error <= config.orientation_tolerance_rad)
    steps = jnp.abs(joints[:, 1:] - joints[:, :-1])
    smooth = jnp.max(steps, axis=(0, 1)) <= config.max_descent_step_rad
    states, rules = _checked_states(robot, joints, config), Rules.of(config, problem.room)
    broken: list[tuple[Reason, Array]] = [  # in the order of the rules
        (Reason.OUT_OF_REACH, ~(reached[0] & reached[-1])),
        (Reason.NO_STRAIGHT_DESCENT, ~(smooth & jnp.all(reached, axis=0))),
        (Reason.ARM_COLLIDES, jnp.any(problem.arm_check(robot, picks.base_pose, states, problem.room), axis=0)),
    ]
    touched, possible = jnp.zeros((len(choice), 0), bool), ~functools.reduce(jnp.logical_or, (x for _, x in broken))
    if problem.neighbours is not None:
        touched = boxes_touched(robot, picks.base_pose, states, problem.neighbours, possible)
        broken.append((Reason.OBJECT_IN_THE_WAY, jnp.any(touched, axis=-1)))
    if rules.arm_hits_itself:
        broken.append((Reason.ARM_HITS_ITSELF, _of_possible(possible, states, lambda q: hits_itself(robot, q))))
    if rules.near_singular:
        least = config.least_singular_value
        broken.append((Reason.NEAR_SINGULAR, _of_possible(possible, joints, lambda q: near_singular(robot, q, least))))
    rule, alone = jnp.full(choice.shape, int(Reason.NONE)), jnp.ones(choice.shape, bool)
    for reason, holds in reversed(broken):
        rule = jnp.where(holds, reason, rule)
        alone &= ~holds | (reason == Reason.OBJECT_IN_THE_WAY)
    duration = arm_solutions.cycle_duration(robot, tuple(joints[:, 0]), tuple(joints[:, -1]), config)
    grasp = arm_solutions.grasp_of(picks, solutions, choice)
    return Checked(rule, duration, joints, grasp, touched, alone, problem.needed)


def _of_possible(
    possible: Bool[Array, " B"], states: Float[Array, "dof S B"], test: Callable[[Array], Array]
) -> Bool[Array, " B"]:
    """Whether a test holds for any state of those solutions that break no rule before; half of them do."""
    count = len(possible)

    def some(index: Int[Array, " Q"], holds: Array) -> Array:
        return holds.at[index].set(jnp.any(test(rounds.take(states, index)), axis=0), mode="drop")

    return rounds.over_chosen(possible, some, jnp.zeros(count, bool), max(1, count // 4))


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


def as_rows(tree: Any, own: int, batch: tuple[int, ...]) -> Any:
    """A tree of arrays, whose batches end after `own` axes, broadcast to a batch, as rows."""

    def rows(x: Array) -> Array:
        return jnp.broadcast_to(x, (*batch, *x.shape[own:])).reshape(math.prod(batch), *x.shape[own:])

    return jax.tree.map(rows, tree)
