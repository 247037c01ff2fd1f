"""The pick cycle: whether an object can be picked from a base pose, how long it takes, and the arm's waypoints."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.config import PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task import arm_solutions
from basenet_jax.task.pick_search import ArmCheck, Checked, PickProblem, Reason, Rules, as_rows, search_solutions
from basenet_jax.world.boxes import Boxes, Room
from basenet_jax.world.clearance import capsules_touch
from basenet_jax.world.grasps import Grasps


@struct.dataclass
class Pick:
    """Outcome of picks. Waypoints: pre-grasp, the heights in between from top to bottom, grasp."""

    feasible: Bool[Array, "*batch"]
    reason: Int[Array, "*batch"]  # a `Reason`
    time: Float[Array, "*batch"]  # s, of the whole cycle; 0 where infeasible
    joints: Float[Array, "*batch waypoints dof"]  # rad; home where infeasible
    grasp: Int[Array, "*batch"]  # which of the G grasps; -1 where infeasible


@struct.dataclass
class Ways:
    """A ways to pick each object: the fastest, and slower ones that need less to be gone first."""

    time: Float[Array, "*batch A"]  # s, of the whole cycle; infinite: no such way
    blockers: Bool[Array, "*batch A N"]  # which other objects must be gone
    reason: Int[Array, "*batch"]  # a `Reason`: why there is no way at all


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
    if neighbours is not None and not Rules.of(config, room).object_in_the_way:
        neighbours = None
    batch, base_pose, grasps = _flat(base_pose, grasps)
    problem = PickProblem.make(robot, batch, base_pose, grasps, room, neighbours, config, arm_check, seeds=seeds)
    home = jnp.asarray(robot.home, base_pose.dtype)[:, None, None]
    start = _Found(
        time=jnp.zeros(len(base_pose), problem.solutions.estimate.dtype),
        joints=jnp.broadcast_to(home, (robot.dof, len(arm_solutions.heights(config)), len(base_pose))),
        grasp=jnp.full(len(base_pose), -1),
    )

    def keep(found: _Found, checked: Checked) -> tuple[_Found, Array, None]:
        """The first that is feasible is the fastest."""
        new = _Found(checked.time, checked.joints, checked.grasp)
        found = jax.tree.map(lambda new, old: jnp.where(checked.feasible, new, old), new, found)
        return found, checked.feasible, None

    search = search_solutions(problem, start, keep)
    found = search.found
    return Pick(
        feasible=(search.rule == Reason.NONE).reshape(batch),
        reason=search.rule.reshape(batch),
        time=found.time.reshape(batch),
        joints=jnp.transpose(found.joints, (2, 1, 0)).reshape(*batch, -1, robot.dof),
        grasp=found.grasp.reshape(batch),
    )


def ways_to_pick(
    robot: Robot,
    base_pose: Float[Array, "*batch 3"],
    grasps: Grasps,
    room: Room,
    neighbours: Boxes,
    config: PickConfig = PickConfig(),
    arm_check: ArmCheck = capsules_touch,
    *,
    ways: int,
    needed: Bool[Array, "*batch G T N"] | None = None,
) -> Ways:
    """In how many ways objects can be picked from base poses, by what must be gone first.

    Of all arm solutions, the fastest first, those are kept that need something less to be gone than each before; once
    one needs nothing gone, no slower one is of use. The last place is for the solution that needs fewest.

    Args:
        robot: the robot.
        base_pose: of the base, (x, y, heading) in W.
        grasps: as for `pick`.
        room: likewise.
        neighbours: the other objects, N for each of the batch, as if all of them still stood.
        config: heights, tolerances and durations of the cycle.
        arm_check: tests joint states for collision.
        ways: A, how many are kept at most.
        needed: which must be gone for each grasp in any case, see `gripper_blockers`: spares looking in vain.
    """
    batch, base_pose, grasps = _flat(base_pose, grasps)
    problem = PickProblem.make(robot, batch, base_pose, grasps, room, neighbours, config, arm_check, needed=needed)
    none = jnp.full((ways, len(base_pose)), jnp.inf, problem.solutions.estimate.dtype)
    start = _Kept(none, jnp.zeros((ways, neighbours.low.shape[-1], len(base_pose)), bool))

    def keep(kept: _Kept, checked: Checked) -> tuple[_Kept, Array, Array | None]:
        there, touched = jnp.isfinite(kept.time), checked.touched.T
        in_vain = jnp.any(there & jnp.all(~kept.blockers | touched, axis=1), axis=0)
        fewer = jnp.sum(touched, axis=0) < jnp.sum(kept.blockers[-1], axis=0)
        place = jnp.minimum(jnp.sum(there, axis=0), ways - 1)
        taken = checked.alone & ~in_vain & (~there[-1] | fewer)
        here = taken & (jnp.arange(ways)[:, None] == place)
        new = _Kept(jnp.where(here, checked.time, kept.time), jnp.where(here[:, None], touched, kept.blockers))
        useless = None
        if checked.needed is not None:  # what is kept already needs no more than a grasp does in any case
            enough = jnp.all(~new.blockers[:, :, None, None] | jnp.moveaxis(checked.needed, (0, 3), (3, 0)), axis=1)
            useless = jnp.transpose(jnp.any(enough & jnp.isfinite(new.time)[:, None, None], axis=0), (2, 0, 1))
        return new, taken & ~jnp.any(touched, axis=0), useless

    search = search_solutions(problem, start, keep)
    kept, some = search.found, jnp.isfinite(search.found.time[0])
    return Ways(
        time=kept.time.T.reshape(*batch, ways),
        blockers=jnp.transpose(kept.blockers, (2, 0, 1)).reshape(*batch, *kept.blockers.shape[:2]),
        reason=jnp.where(some, Reason.NONE, search.rule).reshape(batch),
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


def _flat(base_pose: Float[Array, "*batch 3"], grasps: Grasps) -> tuple[tuple[int, ...], Array, Grasps]:
    """Base poses and grasps broadcast to one batch, which comes first, as rows."""
    batch = jnp.broadcast_shapes(base_pose.shape[:-1], grasps.approach.shape[:-1])

    return batch, as_rows(base_pose, base_pose.ndim - 1, batch), as_rows(grasps, grasps.approach.ndim - 1, batch)


class _Found(NamedTuple):
    """The fastest feasible solution of each of B picks."""

    time: Float[Array, " B"]
    joints: Float[Array, "dof waypoints B"]
    grasp: Int[Array, " B"]


class _Kept(NamedTuple):
    """The ways of each of B picks."""

    time: Float[Array, "A B"]
    blockers: Bool[Array, "A N B"]
