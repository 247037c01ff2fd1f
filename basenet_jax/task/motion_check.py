"""Whether a motion touches anything, by MuJoCo: a second opinion on what robots are about to be told.

The judge tests where the base stops, and the arm at some states of each move. Drives of a point, the paper's, say
nothing of the footprint on the way; here every move is gone through in small steps.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from basenet_jax.config import PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task.motion import Motion
from basenet_jax.world.boxes import Room
from basenet_jax.world.mujoco_scene import BASE_DIMENSION, BOX, KEEP_OUT, MujocoChecker, state_addresses

STEP_M, STEP_RAD = 0.02, np.radians(2.0)  # of the base and, in rad, of the arm's joints
_TOLERANCE_M = 1e-3  # less is rounding: what only touches is free
_MUCH = 10_000  # states of one move at most


class Overlap(NamedTuple):
    """The deepest overlap of a step's drive, or of its arm moves, with one thing."""

    step: int  # of the plan
    driving: bool  # the base; else the arm
    box: int | None  # number in the room; None: the robot's own body
    depth_m: float


def thing(overlap: Overlap, box_names: Sequence[str]) -> str:
    """What is overlapped, by its name in the room."""
    return "the robot's own body" if overlap.box is None else box_names[overlap.box]


def find_overlaps(robot: Robot, room: Room, motion: Motion) -> list[Overlap]:
    """Where a motion's footprint overlaps what blocks the base, or its arm a box or the robot's own body.

    Args:
        robot: the robot.
        room: one concrete room.
        motion: in it.

    Returns:
        In order of the steps, the deepest one of each step and thing.
    """
    # Boxes not grown: the clearance is for where the base stops, and drives keep to their own.
    checker = MujocoChecker(robot, room, PickConfig(base_clearance_m=0.0))
    addresses = state_addresses(robot, checker.model)
    deepest: dict[tuple[int, bool, int | None], float] = {}
    for key, part in enumerate(motion.parts):
        driving = part.leg is not None
        for state in _states(motion, key):
            checker.data.qpos[addresses] = state
            for box, depth in _contacts(checker.model, checker.data, driving):
                which = (part.step, driving, box)
                deepest[which] = max(deepest.get(which, 0.0), depth)
    return [Overlap(*which, depth) for which, depth in deepest.items() if depth > _TOLERANCE_M]


def _states(motion: Motion, key: int) -> Float[np.ndarray, "N 3+dof"]:
    """Base pose and joints in small steps from one key state to the next."""
    ends = np.column_stack([motion.base_pose, motion.joints])[key : key + 2]
    way = np.abs(ends[1] - ends[0])
    steps = max(np.hypot(*way[:2]) / STEP_M, np.max(way[2:]) / STEP_RAD)
    return np.linspace(ends[0], ends[1], min(int(np.ceil(steps)), _MUCH) + 1)


def _contacts(model: mujoco.MjModel, data: mujoco.MjData, driving: bool) -> list[tuple[int | None, float]]:
    """What the base (or the arm) overlaps in its state, and how deep (m)."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    found = []
    for pair, dimension, distance in zip(data.contact.geom, data.contact.dim, data.contact.dist, strict=True):
        if distance < 0 and (dimension == BASE_DIMENSION) == driving:
            names = [model.geom(geom).name for geom in pair]
            boxes = (name.removeprefix(f"{KEEP_OUT} ").removeprefix(f"{BOX} ") for name in names)
            found.append((next((int(name) for name in boxes if name.isdigit()), None), -float(distance)))
    return found
