"""Building the map of grasps of any orientation: what bins it has for a robot, and which of them are reached."""

import dataclasses
import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import rounds
from basenet_jax.config import PickConfig
from basenet_jax.planners.candidates import REACH_MARGIN
from basenet_jax.planners.grasp_map import TILTS, GraspMap, Shape, nearest_bin, tool_angles
from basenet_jax.robot import seven
from basenet_jax.robot.kinematics import attach, link_frames, reach_sphere
from basenet_jax.robot.model import Robot
from basenet_jax.task import arm_solutions
from basenet_jax.trigonometry import sin_cos

_TURNS = 8  # headings of the base, or turns of the gripper, where they count
# Sides of the bins (m): the finest with which a map has at most so many bins takes seconds to build, 2 MB at most.
_STEPS = (0.025, 0.05, 0.1, 0.2)
_MOST_UR, _MOST_SEVEN, _MOST_SAMPLED = 16_000_000, 1_600_000, 2_500_000
_SAMPLES, _SAMPLED_AT_ONCE = 2**24, 4096  # joint vectors of arms without a closed form
# The first and the last joint of an arm turn all round if no more than this of a turn is missing (rad): a Franka arm's
# leave 28 degrees out, in which the map is wrong.
_GAP = math.radians(40.0)
_ALONG = 1e-6  # by how much the components of two directions that are one may differ

_reach_sphere = jax.jit(reach_sphere)


def map_shape(robot: Robot) -> Shape:
    """The bins of a robot's map, the finest that are few enough: all that the arm may reach, over the floor."""
    center, radius, aside = _sphere(robot)
    headings, turns = (1 if free else _TURNS for free in (_base_turns(robot), _gripper_turns(robot)))
    most = _MOST_SEVEN if robot.closed_form == seven.NAME else _MOST_UR if robot.closed_form else _MOST_SAMPLED

    def shape(step: float) -> Shape:
        lowest = max(0, math.ceil((center[2] - radius) / step))
        highest = max(lowest, math.floor((center[2] + radius) / step))
        return Shape(step, lowest, highest - lowest + 1, 2 * math.floor((aside + radius) / step) + 1, headings, turns)

    shapes = [shape(step) for step in _STEPS]
    return next((each for each in shapes if each.total <= most), shapes[-1])


def build_grasp_map(robot: Robot, config: PickConfig = PickConfig(), shape: Shape | None = None) -> GraspMap:
    """The map of a robot, in one program.

    A bin is reached if the closed form has a solution at its centre or, for an arm without one, if one of many joint
    vectors, spread evenly, brings the tool into it.

    Args:
        robot: the robot.
        config: tolerances, and how solutions are found.
        shape: of the map; by default `map_shape`'s.
    """
    shape = map_shape(robot) if shape is None else shape
    round_robot, axis = _all_round(robot), _axis(robot).astype(np.float32)
    if robot.closed_form is None:
        reached = np.asarray(_sample(round_robot, axis, shape))
    else:
        near = np.flatnonzero(_near(robot, shape)).astype(np.int32)
        reached = np.zeros(shape.total, bool)
        reached[near] = _sweep(round_robot, near, axis, shape, config)
    bits = np.packbits(reached, bitorder="little")
    return GraspMap(bits=bits, axis=axis, shape=shape, ways=ways(shape, config))


def ways(shape: Shape, config: PickConfig) -> int:
    """In how many ways a gripper may be held that a bin tells apart."""
    return 2 if config.gripper_symmetric and shape.turns > 1 else 1


@partial(jax.jit, static_argnames=("shape", "config"))
def _sweep(
    robot: Robot, near: Int[Array, " B"], axis: Float[Array, "2"], shape: Shape, config: PickConfig
) -> Bool[Array, " B"]:
    """Whether the bins of these numbers are reached; `config.chunk` at a time keep in a CPU core's cache."""
    rpy = jnp.asarray(_bin_angles(shape.turns), jnp.float32)

    def reached(index: Int[Array, " chunk"]) -> Bool[Array, " chunk"]:
        height, tilt, i, j, heading, turn = jnp.unravel_index(index, shape.sizes)
        x, y = ((k - shape.side // 2) * shape.step_m for k in (i, j))
        angle = heading * (2.0 * jnp.pi / shape.headings)
        sine, cosine = sin_cos(angle)
        base_pose = (x - cosine * axis[0] + sine * axis[1], y - sine * axis[0] - cosine * axis[1], angle)
        nought = jnp.zeros(index.shape)
        tool = (nought, nought, (height + shape.lowest) * shape.step_m, *jnp.moveaxis(rpy[tilt, turn], -1, 0))
        single = jnp.zeros(index.shape, bool)
        return arm_solutions.reached(robot, arm_solutions.Picks(base_pose, tool, nought, single, ~single), config)

    return rounds.in_chunks(reached, near, config.chunk)


@partial(jax.jit, static_argnames="shape")
def _sample(robot: Robot, axis: Float[Array, "2"], shape: Shape) -> Bool[Array, " bins"]:
    """The bins that joint vectors bring the tool into; joints that may turn all round, first or last, stay."""
    stays = (*((0,) if shape.headings == 1 else ()), *((robot.dof - 1,) if shape.turns == 1 else ()))
    moves = [joint for joint in range(robot.dof) if joint not in stays]
    # As in `arm_solutions.lattice`, but in integers modulo 2^32, which hold more than single precision does.
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (len(moves) + 1))
    strides = np.round(2.0**32 * root ** -np.arange(1.0, len(moves) + 1)).astype(np.uint32)
    revolute = ~np.array(robot.prismatic)
    lower = jnp.where(revolute, jnp.maximum(robot.joint_lower, -jnp.pi), robot.joint_lower)
    upper = jnp.where(revolute, jnp.minimum(robot.joint_upper, jnp.pi), robot.joint_upper)

    def add(number: Array, reached: Array) -> Array:
        count = number.astype(jnp.uint32) * _SAMPLED_AT_ONCE + jnp.arange(_SAMPLED_AT_ONCE, dtype=jnp.uint32)
        unit = (count[None] * strides[:, None]).astype(jnp.float32) * 2.0**-32
        joints = jnp.broadcast_to(jnp.asarray(robot.home, jnp.float32)[:, None], (robot.dof, _SAMPLED_AT_ONCE))
        for row, joint in enumerate(moves):
            joints = joints.at[joint].set(lower[joint] + unit[row] * (upper[joint] - lower[joint]))
        last = jax.tree.map(lambda x: x[-1], link_frames(robot, joints))
        tool = attach(last, robot.tool_rotation, robot.tool_position)
        beside = (axis[0] - tool.origin[0], axis[1] - tool.origin[1])
        index, inside = nearest_bin(shape, beside, tool.origin[2], tool_angles(tool.x, tool.z), jnp.zeros(()))
        return reached.at[jnp.where(inside, index, shape.total)].set(True, mode="drop")

    return jax.lax.fori_loop(0, _SAMPLES // _SAMPLED_AT_ONCE, add, jnp.zeros(shape.total, bool))


def _bin_angles(turns: int) -> Float[np.ndarray, "tilts turns 3"]:
    """Roll, pitch and yaw (rad) of the bins' tools: `Ry(tilt) Rz(turn) = Rz(yaw) Ry(pitch) Rx(roll)`."""
    tilt, turn = np.meshgrid(
        np.pi * np.arange(TILTS) / (TILTS - 1), 2 * np.pi * np.arange(turns) / turns, indexing="ij"
    )
    pitch = np.arcsin(np.clip(np.sin(tilt) * np.cos(turn), -1.0, 1.0))
    roll = np.arctan2(np.sin(tilt) * np.sin(turn), np.cos(tilt))
    yaw = np.arctan2(np.sin(turn), np.cos(tilt) * np.cos(turn))
    upright = np.abs(np.cos(pitch)) < 1e-9  # the tool's x points up or down, and roll and yaw turn about one line
    roll, yaw = np.where(upright, 0.0, roll), np.where(upright, turn, yaw)
    return np.stack([roll, pitch, yaw], axis=-1)


def _near(robot: Robot, shape: Shape) -> Bool[np.ndarray, " bins"]:
    """The bins that aren't beyond the stretched arm."""
    center, radius, aside = _sphere(robot)
    place = (np.arange(shape.side) - shape.side // 2) * shape.step_m
    distance = np.maximum(np.hypot(place[:, None], place) - aside, 0.0)
    height = (np.arange(shape.heights) + shape.lowest) * shape.step_m - center[2]
    near = np.hypot(height[:, None, None], distance) <= radius
    return np.broadcast_to(near[:, None, :, :, None, None], shape.sizes).ravel()


def _sphere(robot: Robot) -> tuple[Float[np.ndarray, "3"], float, float]:
    """Centre, in the base's frame, and radius of what the tool can't leave, and how far it is from the axis (m)."""
    center, radius = (np.asarray(x, float) for x in _reach_sphere(robot))
    in_base = np.asarray(robot.mount_position) + np.asarray(robot.mount_rotation) @ center
    aside = float(np.hypot(*(in_base[:2] - _axis(robot))))
    return in_base, float(radius) + REACH_MARGIN, aside if aside > _ALONG else 0.0


def _axis(robot: Robot) -> Float[np.ndarray, "2"]:
    """x, y (m) of the first joint in the base's frame."""
    return (np.asarray(robot.mount_position) + np.asarray(robot.mount_rotation) @ robot.joint_position[0])[:2]


def _base_turns(robot: Robot) -> bool:
    """Whether the first joint turns all round about the vertical."""
    axis = np.asarray(robot.mount_rotation) @ np.asarray(robot.joint_rotation[0])[:, 2]
    return _turns(robot, 0) and bool(np.hypot(*axis[:2]) < _ALONG)


def _gripper_turns(robot: Robot) -> bool:
    """Whether the last joint turns all round about the tool's z."""
    along = np.asarray(robot.tool_rotation)[:2, 2], np.asarray(robot.tool_position)[:2]
    return _turns(robot, robot.dof - 1) and bool(np.all(np.abs(along) < _ALONG))


def _turns(robot: Robot, joint: int) -> bool:
    span = float(np.asarray(robot.joint_upper)[joint] - np.asarray(robot.joint_lower)[joint])
    return not robot.prismatic[joint] and span >= 2 * math.pi - _GAP


def _all_round(robot: Robot) -> Robot:
    """The robot whose first and last joint turn all round where the map takes them to."""
    free = np.zeros(robot.dof, bool)
    free[0], free[-1] = _base_turns(robot), _gripper_turns(robot)
    lower = np.where(free, np.minimum(robot.joint_lower, -np.pi), robot.joint_lower)
    upper = np.where(free, np.maximum(robot.joint_upper, np.pi), robot.joint_upper)
    return dataclasses.replace(robot, joint_lower=lower, joint_upper=upper)
