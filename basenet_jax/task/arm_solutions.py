"""All arm solutions of picks: the closed form's branches, or damped least squares from a lattice of seeds.

Solutions are numbered grasp by grasp, so that `number % turns` tells whether the gripper is turned by pi. A chunk of
picks is struct of arrays: every component has the batch's shape.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds
from basenet_jax.config import PickConfig
from basenet_jax.robot import seven, ur
from basenet_jax.robot.closed_form import ClosedForm
from basenet_jax.robot.ik import damped_least_squares, residual
from basenet_jax.robot.kinematics import Frame, Vector, components, scale, subtract
from basenet_jax.robot.kinematics import turn as turn_about_z
from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import joint_move_duration, synchronised_duration
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.grasps import Grasps

Joints = tuple[Array, ...]
_SHARES = 9  # of the step between two angles of a seventh joint, tried about the best one


class Picks(NamedTuple):
    """A batch of B picks by one of G grasps each, the batch in the last axis."""

    base_pose: Vector  # (x, y, heading) in W
    tool: tuple[Array, ...]  # "G B": x, y, z, roll, pitch, yaw of tool0 in W at the grasps
    approach: Float[Array, "G B"]  # m; 0: the world's
    symmetric: Bool[Array, "G B"]
    there: Bool[Array, "G B"]

    @property
    def grasps(self) -> int:
        """G."""
        return len(self.approach)

    def by(self, grasp: Int[Array, " B"]) -> "Picks":
        """The picks by one grasp each, without the axis of G."""
        own = jax.tree.map(lambda x: jnp.take_along_axis(x, grasp[None], axis=0)[0], self[1:])
        return Picks(self.base_pose, *own)


def make_picks(base_pose: Float[Array, "B 3"], grasps: Grasps) -> Picks:
    """The picks of B objects from as many base poses.

    Args:
        base_pose: (x, y, heading) in W.
        grasps: in W, "B G" of them.
    """
    tool = components(jnp.swapaxes(grasps.pose, 0, 1))
    return Picks(components(base_pose), tool, *(x.T for x in (grasps.approach, grasps.symmetric, grasps.there)))


class Solutions(NamedTuple):
    """K solutions of each of B picks: for each grasp the same number, those of the first grasp first."""

    estimate: Float[Array, "K B"]  # s, of the whole cycle before refinement; infinite where there is no solution
    pregrasp: Float[Array, "dof K B"] | None = None  # None for robots with a closed form
    sharpest: Int[Array, "G B"] | None = None  # of seven joints: which solution of each grasp was looked at closer,
    aside: Float[Array, "G B"] | None = None  # and how far (rad) its last joint is beside its angle


def solve(robot: Robot, picks: Picks, config: PickConfig, seeds: Float[Array, "seeds dof"] | None = None) -> Solutions:
    """Estimates every solution of every pick; where there is no closed form, from seeds, by default a `lattice`."""
    if robot.closed_form is not None:
        return _by_grasp(picks, lambda own: _solve_closed_form(robot, own, config))
    joints = lattice(robot, config.lattice_seeds) if seeds is None else seeds
    return _by_grasp(picks, lambda own: _solve_from_seeds(robot, own, config, joints))


def reached(robot: Robot, picks: Picks, config: PickConfig) -> Bool[Array, " B"]:
    """Whether the arm alone reaches each pick's one grasp as it is, the gripper not turned.

    A solution of the grasp is within the joint limits and misses it by no more than the tolerance. Nothing comes before
    or after: no pre-grasp, no descent, no clearance.

    Args:
        robot: one with a closed form.
        picks: by one grasp each, without the axis of G, as of `Picks.by`.
        config: the tolerance, and how many angles of a seventh joint are tried.
    """
    target = tool_target(robot, picks, 0.0, 0.0)

    def attempt(branch: Array, found: Array) -> Array:
        solution = _branch(robot, target, branch, 0.0, config)
        _, inside = _nearest_equivalents(robot, solution.joints, tuple(robot.home))
        return found | (inside & (solution.shortfall <= config.position_tolerance_m))

    return jax.lax.fori_loop(0, branches(robot, config), attempt, jnp.zeros(picks.approach.shape, bool))


def _by_grasp(picks: Picks, solve_own: Callable[[Picks], Solutions]) -> Solutions:
    """The solutions of one grasp after the other: a grasp's arrays fit a CPU core's cache, those of all don't."""
    if picks.grasps == 1:  # a loop of one round still costs a third of the time
        return solve_own(Picks(picks.base_pose, *jax.tree.map(lambda x: x[0], picks[1:])))
    solutions = jax.lax.map(lambda own: solve_own(Picks(picks.base_pose, *own)), picks[1:])
    pregrasp, estimate = solutions.pregrasp, solutions.estimate.reshape(-1, solutions.estimate.shape[-1])
    if pregrasp is not None:
        pregrasp = jnp.moveaxis(pregrasp, 0, 1).reshape(pregrasp.shape[1], *estimate.shape)
    sharp = jax.tree.map(lambda x: x[:, 0], solutions[2:])
    return Solutions(estimate, pregrasp, *sharp)


def _aside(picks: Picks, solutions: Solutions, choice: Int[Array, " B"]) -> Float[Array, " B"]:
    """How far (rad) the last of seven joints is beside its angle in some solutions."""
    own = len(solutions.estimate) // picks.grasps
    assert solutions.sharpest is not None
    assert solutions.aside is not None
    own_grasp = choice // own, jnp.arange(len(choice))
    sharpest, aside = solutions.sharpest[own_grasp], solutions.aside[own_grasp]
    return jnp.where(choice % own == sharpest, aside, 0.0)


def waypoints(
    robot: Robot, picks: Picks, solutions: Solutions, choice: Int[Array, " B"], config: PickConfig
) -> tuple[Frame, Float[Array, "dof waypoints B"]]:
    """Targets and first joints of the waypoints of one solution of each pick, for the solver to refine."""
    own = picks.by(grasp_of(picks, solutions, choice))
    target = tool_target(robot, own, _back(own, heights(config)[:, None], config), (choice % turns(config)) * jnp.pi)
    if solutions.pregrasp is None:
        aside = 0.0 if solutions.aside is None else _aside(picks, solutions, choice)
        branch = choice // turns(config) % branches(robot, config)
        joints = _branch(robot, target, branch, aside, config).joints
        shape = (len(heights(config)), len(choice))
        return target, _follow(robot, tuple(jnp.broadcast_to(q, shape) for q in joints))
    start = jnp.take_along_axis(solutions.pregrasp, choice[None, None], axis=1)[:, 0]
    return target, _descend(robot, target, start, config)


def grasp_of(picks: Picks, solutions: Solutions, choice: Int[Array, " B"]) -> Int[Array, " B"]:
    """Which of the G grasps a solution is of."""
    return choice * picks.grasps // len(solutions.estimate)


def heights(config: PickConfig) -> np.ndarray:
    """How far (m) the waypoints are back from the grasp, from pre-grasp to grasp, by the world's approach."""
    return np.array([config.pregrasp_height_m, *config.descent_heights_m, 0.0])


def _back(picks: Picks, height: ArrayLike, config: PickConfig) -> Array:
    """How far (m) back from the grasp a height of the world's approach is by each grasp's own."""
    own = picks.approach * (1.0 / (config.pregrasp_height_m or 1.0))
    return jnp.where(own > 0, own, 1.0) * height


def turns(config: PickConfig) -> int:
    """Number of ways to hold the gripper at a grasp."""
    return 2 if config.gripper_symmetric else 1


def tool_target(robot: Robot, picks: Picks, back: ArrayLike, turn: ArrayLike) -> Frame:
    """The tool frame in the arm's base frame, `back` (m) from the grasp, the gripper turned by `turn` (rad).

    T_a_t = T_b_a^-1 T_W_b^-1 T_W_t, with R_W_t = Rz(yaw) Ry(pitch) Rx(roll) Rz(turn), and back along the tool's z.
    """
    (base_x, base_y, heading), (x, y, z, roll, pitch, yaw) = picks.base_pose, picks.tool
    sine, cosine = sin_cos(heading)
    along, across = x - base_x, y - base_y
    in_base = (cosine * along + sine * across, cosine * across - sine * along, z)
    grasp = turn_about_z(Frame(*axes(roll, pitch, yaw - heading), in_base), jnp.asarray(turn))
    rows = tuple(tuple(row) for row in robot.mount_rotation)
    origin = subtract(grasp.origin, scale(jnp.asarray(back), grasp.z))
    offset = tuple(p - robot.mount_position[k] for k, p in enumerate(origin))

    def in_arm(v: Vector) -> Vector:
        return tuple(v[0] * rows[0][k] + v[1] * rows[1][k] + v[2] * rows[2][k] for k in range(3))

    return Frame(in_arm(grasp.x), in_arm(grasp.y), in_arm(grasp.z), in_arm(offset))


def axes(roll: Array, pitch: Array, yaw: Array) -> tuple[Vector, Vector, Vector]:
    """The columns of Rz(yaw) Ry(pitch) Rx(roll); a loop, or XLA computes every sine anew for each component."""
    roll, pitch, yaw = jnp.broadcast_arrays(roll, pitch, yaw)
    (sin_r, sin_p, sin_y), (cos_r, cos_p, cos_y) = jax.lax.map(sin_cos, jnp.stack([roll, pitch, yaw]))
    return (
        (cos_y * cos_p, sin_y * cos_p, -sin_p),
        (cos_y * sin_p * sin_r - sin_y * cos_r, sin_y * sin_p * sin_r + cos_y * cos_r, cos_p * sin_r),
        (cos_y * sin_p * cos_r + sin_y * sin_r, sin_y * sin_p * cos_r - cos_y * sin_r, cos_p * cos_r),
    )


def cycle_duration(robot: Robot, pregrasp: Joints, grasp: Joints, config: PickConfig) -> Array:
    """Duration (s) of a whole pick cycle: home, pre-grasp, grasp, close, pre-grasp, stow, open, home."""
    home, stow = tuple(robot.home), tuple(robot.stow)
    descent = synchronised_duration(robot, pregrasp, grasp)
    always = joint_move_duration(robot, jnp.asarray(robot.stow), robot.home) + config.close_s + config.open_s
    out, carry = synchronised_duration(robot, home, pregrasp), synchronised_duration(robot, pregrasp, stow)
    return out + 2 * descent + carry + always


def branches(robot: Robot, config: PickConfig) -> int:
    """How many solutions the closed form gives: of seven joints for each of some angles of the last."""
    return ur.BRANCHES if robot.closed_form == ur.NAME else seven.BRANCHES * config.last_joint_angles


def _branch(
    robot: Robot, target: Frame, index: Int[Array, "*batch"], aside: Float[Array, "*batch"] | float, config: PickConfig
) -> ClosedForm:
    """The closed form's solutions of these numbers, with the last of seven joints so far (rad) beside its angle."""
    if robot.closed_form == ur.NAME:
        return ur.closed_form(robot, target, ur.branch_signs(index))
    angle = jnp.maximum(robot.joint_lower[-1], -jnp.pi) + (index // seven.BRANCHES + 0.5) * _angle_step(robot, config)
    return seven.closed_form(robot, target, angle + aside, seven.branch_signs(index % seven.BRANCHES))


def _angle_step(robot: Robot, config: PickConfig) -> Array:
    """Between the angles (rad) of joint 7 that are tried."""
    lower, upper = jnp.maximum(robot.joint_lower[-1], -jnp.pi), jnp.minimum(robot.joint_upper[-1], jnp.pi)
    return (upper - lower) / config.last_joint_angles


def _solve_closed_form(robot: Robot, picks: Picks, config: PickConfig) -> Solutions:
    """Loops over the branches, and over both ends: XLA would compute one expression anew for every use of its result.

    So the joints of an end are computed once, where without the inner loop each joint's time computes them again, and
    the program is half as long.
    """
    (batch,) = picks.approach.shape
    turn = jnp.arange(turns(config))[:, None] * jnp.pi
    shape, allowed = (turns(config), batch), ((turn == 0) | picks.symmetric) & picks.there
    by_last_joint = ur.turns_tool(robot)
    back = (_back(picks, config.pregrasp_height_m, config), jnp.zeros_like(picks.approach))
    above, below = (tool_target(robot, picks, each, 0.0 if by_last_joint else turn) for each in back)
    origins = tuple(jnp.stack(ends) for ends in zip(above.origin, below.origin, strict=True))

    def estimate(branch: Array, aside: Array | float = 0.0) -> Array:
        both = jax.lax.map(lambda origin: _branch(robot, below._replace(origin=origin), branch, aside, config), origins)
        ends = [jax.tree.map(lambda x, end=end: x[end], both) for end in range(len(back))]
        if by_last_joint:
            ends = [end._replace(joints=(*end.joints[:-1], end.joints[-1] - turn)) for end in ends]
        pregrasp, inside = _nearest_equivalents(robot, ends[0].joints, tuple(robot.home))
        grasp, grasp_inside = _nearest_equivalents(robot, ends[1].joints, pregrasp)
        reached = (ends[0].shortfall <= config.position_tolerance_m) & (
            ends[1].shortfall <= config.position_tolerance_m
        )
        duration = cycle_duration(robot, pregrasp, grasp, config)
        return jnp.broadcast_to(jnp.where(inside & grasp_inside & reached & allowed, duration, jnp.inf), shape)

    estimates = jax.lax.map(estimate, jnp.arange(branches(robot, config))).reshape(-1, batch)
    if robot.closed_form == ur.NAME:
        return Solutions(estimates)
    return _sharpen(estimates, estimate, _angle_step(robot, config), config)


def _sharpen(
    estimates: Float[Array, "K B"], estimate: Callable[..., Array], step: Array, config: PickConfig
) -> Solutions:
    """The solutions of seven joints, the fastest of each pick with the last joint at the best angle about its own."""
    best, (batch,) = jnp.argmin(estimates, axis=0), estimates.shape[1:]
    shares = np.delete(np.linspace(-0.5, 0.5, _SHARES), _SHARES // 2)

    def try_next(share: Array) -> Array:
        every = estimate(best // turns(config), share * step)
        return jnp.take_along_axis(every, (best % turns(config))[None], axis=0)[0]

    found = jax.lax.map(try_next, jnp.asarray(shares, estimates.dtype))
    at, here = jnp.argmin(found, axis=0), jnp.arange(batch)
    better = found[at, here] < estimates[best, here]
    aside = jnp.where(better, jnp.asarray(shares)[at], 0.0) * step
    return Solutions(estimates.at[best, here].min(found[at, here]), sharpest=best[None], aside=aside[None])


def _solve_from_seeds(robot: Robot, picks: Picks, config: PickConfig, joints: Float[Array, "seeds dof"]) -> Solutions:
    """In rounds of few picks: every one is as many arms as there are seeds and ways to hold the gripper."""
    every = jax.tree.map(lambda x: jnp.broadcast_to(x, picks.approach.shape), picks)
    return rounds.in_chunks(
        lambda part: _solve_round(robot, part, config, joints), every, config.lattice_chunk, out_axis=-1
    )


def _solve_round(robot: Robot, picks: Picks, config: PickConfig, joints: Float[Array, "seeds dof"]) -> Solutions:
    """All seeds take some steps towards the pre-grasp; those that come nearest go on to it, and down to the grasp."""
    (batch,) = picks.approach.shape
    count, kept = len(joints), min(config.lattice_kept, len(joints))
    seeds = jnp.asarray(joints.T, picks.approach.dtype)
    turn = jnp.arange(turns(config))[:, None] * jnp.pi

    def targets(height: float, solutions: int) -> Frame:
        target = tool_target(robot, picks, _back(picks, height, config), turn)
        return jax.tree.map(lambda x: jnp.broadcast_to(x, (solutions, turns(config), batch)), target)

    start = jnp.broadcast_to(seeds[:, :, None, None], (robot.dof, count, turns(config), batch))
    above, below = targets(config.pregrasp_height_m, count), targets(0.0, kept)
    start = damped_least_squares(robot, above, start, config.lattice_first_iterations)
    start = _nearest(robot, above, start, kept)
    above = targets(config.pregrasp_height_m, kept)
    pregrasp = damped_least_squares(robot, above, start, config.lattice_iterations)
    pregrasp, inside = _nearest_equivalents(robot, tuple(pregrasp), tuple(robot.home))
    grasp = damped_least_squares(robot, below, jnp.stack(pregrasp), config.lattice_descent_iterations)
    grasp, grasp_inside = _nearest_equivalents(robot, tuple(grasp), pregrasp)
    reached = _reached(robot, above, pregrasp, config) & _reached(robot, below, grasp, config)
    duration = cycle_duration(robot, pregrasp, grasp, config)
    allowed = ((turn == 0) | picks.symmetric) & picks.there
    estimate = jnp.where(inside & grasp_inside & reached & allowed, duration, jnp.inf)
    return Solutions(estimate.reshape(-1, batch), jnp.stack(pregrasp).reshape(robot.dof, -1, batch))


def _nearest(robot: Robot, target: Frame, joints: Float[Array, "dof K T B"], kept: int) -> Float[Array, "dof S T B"]:
    """Of the K joint vectors of each pick and turn, those with the least error: m and rad count alike."""
    position_error, orientation_error = residual(robot, target, joints)
    error = jnp.moveaxis(position_error + orientation_error, 0, -1)
    _, index = jax.lax.top_k(-error, kept)
    return jnp.take_along_axis(joints, jnp.moveaxis(index, -1, 0)[None], axis=1)


def lattice(robot: Robot, count: int) -> Float[Array, "count dof"]:
    """Joint vectors spread evenly over the limits (one turn of them at most): home first, then Roberts' R sequence.

    M. Roberts, *The unreasonable effectiveness of quasirandom sequences*, 2018: multiples of the powers of the
    root of x^(d+1) = x + 1, modulo 1.
    """
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (robot.dof + 1))
    unit = (0.5 + np.outer(np.arange(1, count), root ** -np.arange(1.0, robot.dof + 1))) % 1.0
    revolute = ~np.array(robot.prismatic)
    lower = jnp.where(revolute, jnp.maximum(robot.joint_lower, -jnp.pi), robot.joint_lower)
    upper = jnp.where(revolute, jnp.minimum(robot.joint_upper, jnp.pi), robot.joint_upper)
    return jnp.concatenate([jnp.asarray(robot.home)[None], lower + unit * (upper - lower)])


def _descend(
    robot: Robot, target: Frame, pregrasp: Float[Array, "dof B"], config: PickConfig
) -> Float[Array, "dof waypoints B"]:
    """Waypoints from the pre-grasp down, each solved from the one above."""
    rows = [pregrasp]
    for row in range(1, len(heights(config))):
        below = jax.tree.map(lambda x, row=row: x[row] if x.ndim == 2 and len(x) > 1 else x, target)
        rows.append(damped_least_squares(robot, below, rows[-1], config.lattice_descent_iterations))
    return jnp.stack(rows, axis=1)


def _follow(robot: Robot, joints: Joints) -> Float[Array, "dof waypoints B"]:
    """The equivalents nearest to home for the pre-grasp, to the waypoint above for the others."""

    def step(above: Joints, row: Joints) -> tuple[Joints, Joints]:
        nearest, _ = _nearest_equivalents(robot, row, above)
        return nearest, nearest

    home = tuple(jnp.broadcast_to(q, joints[0].shape[1:]).astype(joints[0].dtype) for q in jnp.asarray(robot.home))
    _, rows = jax.lax.scan(step, home, joints)
    return jnp.stack(rows)


def _nearest_equivalents(robot: Robot, joints: Joints, reference: Joints) -> tuple[Joints, Array]:
    """Per joint the 2 pi-equivalent inside the limits nearest to a reference, and whether all joints have one."""
    nearest, inside = [], jnp.ones((), bool)
    for index, (joint, near) in enumerate(zip(joints, reference, strict=True)):
        lower, upper = robot.joint_lower[index], robot.joint_upper[index]
        if not robot.prismatic[index]:
            turn = 2.0 * jnp.pi
            fewest, most = jnp.ceil((lower - joint) / turn), jnp.floor((upper - joint) / turn)
            joint = joint + turn * jnp.clip(jnp.round((near - joint) / turn), fewest, jnp.maximum(most, fewest))
        inside = inside & (joint >= lower) & (joint <= upper)
        nearest.append(joint)
    return tuple(nearest), inside


def _reached(robot: Robot, target: Frame, joints: Joints, config: PickConfig) -> Array:
    position_error, orientation_error = residual(robot, target, jnp.stack(joints))
    return (position_error <= config.position_tolerance_m) & (orientation_error <= config.orientation_tolerance_rad)
