"""What a robot is told to do and when: drives, arm trajectories and gripper commands, in order of time.

Poses are in the frame that the robot navigates in, called map here, in which W has a pose: a room's W is the map.
"""

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from basenet_jax.config import ExportConfig, WorldConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task.manoeuvre import Leg, Manoeuvre
from basenet_jax.task.motion import Doing, Motion, plan_motion
from basenet_jax.task.motion_check import Overlap, find_overlaps
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.scene import NamedScene

Pose = tuple[float, float, float]  # x, y (m), yaw (rad)

NANOSECONDS = 1_000_000_000
BASE = (Doing.TURN, Doing.DRIVE)
_GRIPPER = {Doing.CLOSE: "close", Doing.OPEN: "open"}


@dataclass(frozen=True)
class Trajectory:
    """Joint states (rad, rad/s, rad/s^2; m for sliding joints) at times since its beginning, from rest to rest."""

    time_ns: tuple[int, ...]  # strictly increasing, from 0
    positions: Float[np.ndarray, "T dof"]
    velocities: Float[np.ndarray, "T dof"]
    accelerations: Float[np.ndarray, "T dof"]


@dataclass(frozen=True)
class Stretch:
    """A leg of a drive, on the map."""

    time_ns: int  # since the plan's beginning
    duration_ns: int
    goal: Pose
    leg: Leg


@dataclass(frozen=True)
class Drive:
    """To where the robot parks next."""

    staging: Pose  # from where it goes straight to the goal, in the goal's yaw; the goal itself if it turns there last
    goal: Pose
    legs: tuple[Stretch, ...]


@dataclass(frozen=True)
class Command:
    """One thing to do: exactly one of `drive`, `trajectory` and `gripper` is there."""

    time_ns: int  # since the plan's beginning
    duration_ns: int
    object: str  # name of the object that it is for
    doing: str
    drive: Drive | None = None
    trajectory: Trajectory | None = None
    gripper: str | None = None  # "close" or "open"


@dataclass(frozen=True)
class Schedule:
    """A plan's execution, ready to be written down."""

    robot: str
    joint_names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    map_frame: str
    table_pose: Pose  # of W in the map
    motion: Motion  # in W
    objects: tuple[str, ...]  # name of the object of each step of the plan
    commands: tuple[Command, ...]
    overlaps: tuple[Overlap, ...]  # what the motion would touch, by MuJoCo
    box_names: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """Of the whole execution."""
        return float(self.motion.time[-1])


def make_schedule(
    robot: Robot,
    scene: NamedScene,
    plan: Plan,
    outcome: Outcome,
    *,
    table_pose: Pose = (0.0, 0.0, 0.0),
    map_frame: str = "map",
    config: ExportConfig = ExportConfig(),
    world: WorldConfig = WorldConfig(),
    given_times: bool = False,
) -> Schedule:
    """The commands of a plan, gone through in MuJoCo. Steps that are not feasible are left out, their drives too.

    Args:
        robot: the scene's.
        scene: one scene.
        plan: of that scene.
        outcome: of executing it.
        table_pose: x, y (m) and yaw (rad) of W in the map.
        map_frame: the map's name.
        config: of sampling.
        world: of drives and the pick cycle.
        given_times: whether the outcome's drive times are somebody else's, see `plan_motion`.

    Raises:
        ValueError: a drive that is timed so is none that the robot's own rules allow.
    """
    plan, outcome = jax.device_get((plan, outcome))
    outcome = dataclasses.replace(outcome, is_step=outcome.is_step & outcome.feasible)
    how = {"smoothing_s": config.smoothing_s, "given_times": given_times}
    motion = plan_motion(robot, scene.arrays, plan, outcome, world, **how)
    objects = tuple(scene.names[slot] if slot >= 0 else "" for slot in plan.object_index.tolist())
    return Schedule(
        robot=robot.name,
        joint_names=robot.joint_names,
        prismatic=robot.prismatic,
        map_frame=map_frame,
        table_pose=table_pose,
        motion=motion,
        objects=objects,
        commands=tuple(_commands(motion, objects, table_pose, config)),
        overlaps=tuple(find_overlaps(robot, jax.device_get(scene.arrays.room), motion)),
        box_names=scene.box_names,
    )


def in_map(pose: Float[np.ndarray, "*batch 3"], table_pose: Pose) -> Float[np.ndarray, "*batch 3"]:
    """Base poses (x, y, heading) in W as poses in the map, their yaw in [-pi, pi]."""
    x, y, yaw = table_pose
    cosine, sine = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    turned = pose[..., 2] + yaw
    place = pose[..., :2] @ rotation.T + np.array([x, y])
    return np.concatenate([place, np.arctan2(np.sin(turned), np.cos(turned))[..., None]], axis=-1)


def _commands(motion: Motion, objects: tuple[str, ...], table_pose: Pose, config: ExportConfig) -> Iterator[Command]:
    for _, group in itertools.groupby(range(len(motion.parts)), lambda key: _one_command(motion, key)):
        keys = list(group)
        first, part = keys[0], motion.parts[keys[0]]
        begin, duration = _span(motion, first, keys[-1])
        command = Command(begin, duration, objects[part.step], str(part.doing))
        if part.doing in BASE:
            yield dataclasses.replace(command, doing=str(Doing.DRIVE), drive=_drive(motion, keys, table_pose))
        elif part.doing in _GRIPPER:
            yield dataclasses.replace(command, gripper=_GRIPPER[part.doing])
        else:
            yield dataclasses.replace(command, trajectory=_trajectory(motion, first, config))


def _one_command(motion: Motion, key: int) -> int:
    """Equal for parts that one command stands for: all turns and drives to one base pose."""
    part = motion.parts[key]
    return -1 - part.step if part.doing in BASE else key


def _drive(motion: Motion, keys: list[int], table_pose: Pose) -> Drive:
    legs = {key: leg for key in keys if (leg := motion.parts[key].leg)}
    staging = Manoeuvre(tuple(legs.values())).staging_pose
    assert staging is not None  # a drive has legs

    def on_map(pose: Float[np.ndarray, "3"]) -> Pose:
        return tuple(in_map(pose, table_pose).tolist())

    stretches = (Stretch(*_span(motion, key, key), on_map(leg.after), leg) for key, leg in legs.items())
    return Drive(on_map(staging), on_map(motion.base_pose[keys[-1] + 1]), tuple(stretches))


def _span(motion: Motion, first: int, last: int) -> tuple[int, int]:
    """When a part begins, and how long it takes to the end of the last one (ns)."""
    begin, end = (int(_nanoseconds(motion.time[key])) for key in (first, last + 1))
    return begin, end - begin


def _trajectory(motion: Motion, key: int, config: ExportConfig) -> Trajectory:
    """The arm move after a key state."""
    law = motion.parts[key].law
    time_ns = np.unique(_nanoseconds(law.sample_times(config.rate_hz)))
    progress = law.at(time_ns / NANOSECONDS)
    way = motion.joints[key + 1] - motion.joints[key]
    share, speed, acceleration = (each[:, None] * way for each in progress)
    share[-1], speed[-1] = way, 0.0  # the last nanosecond may have been rounded away
    return Trajectory(tuple(time_ns.tolist()), motion.joints[key] + share, speed, acceleration)


def _nanoseconds(time_s):
    return np.rint(np.asarray(time_s) * NANOSECONDS).astype(np.int64)
