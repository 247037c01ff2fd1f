"""A schedule as YAML, for people and scripts: every message with the very fields that it has in ROS 2."""

from typing import Any

import numpy as np
import yaml

from basenet_jax.exports.schedule import NANOSECONDS, Command, Drive, Pose, Schedule, Stretch, Trajectory
from basenet_jax.task.motion_check import Overlap, thing

FORMAT = "basenet-execution/1"
TURN = "turn"  # in place of a gear

_HEAD = f"""\
# {FORMAT}: commands in order of time. staging_pose and base_goal are geometry_msgs/PoseStamped, arm_trajectory is a
# trajectory_msgs/JointTrajectory, gripper close or open. A drive's legs are turns on the spot (rad, counter-clockwise)
# and straight pieces (m) in their gear. overlaps is what base or arm would touch on their way, and how deep.
# m, rad and s; every stamp is the time since the beginning.
"""
_DECIMALS = 9


def to_yaml(schedule: Schedule) -> bytes:
    """The content of `plan.yaml`."""
    x, y, yaw = schedule.table_pose
    content = {
        "format": FORMAT,
        "robot": schedule.robot,
        "map_frame": schedule.map_frame,
        "table_pose": {"x": x, "y": y, "yaw": yaw},
        "duration_s": round(schedule.duration_s, _DECIMALS),
        "overlaps": [_overlap(each, schedule) for each in schedule.overlaps],
        "commands": [_command(command, schedule) for command in schedule.commands],
    }
    # PyYAML's own emitter takes ten times as long as libyaml's, which isn't in every build of it.
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(content, Dumper=dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=1000)
    return (_HEAD + text).encode()


def _command(command: Command, schedule: Schedule) -> dict[str, Any]:
    head = {
        "at_s": command.time_ns / NANOSECONDS,
        "lasts_s": command.duration_ns / NANOSECONDS,
        "object": command.object,
        "doing": command.doing,
    }
    if command.drive:
        return head | _drive(command.time_ns, command.drive, schedule.map_frame)
    if command.trajectory:
        header = {"stamp": _time(command.time_ns), "frame_id": ""}
        points = _points(command.trajectory)
        message = {"header": header, "joint_names": list(schedule.joint_names), "points": points}
        return head | {"arm_trajectory": message}
    return head | {"gripper": command.gripper}


def _overlap(overlap: Overlap, schedule: Schedule) -> dict[str, Any]:
    what, depth = ("base" if overlap.driving else "arm"), round(overlap.depth_m, 4)
    return {"object": schedule.objects[overlap.step], what: thing(overlap, schedule.box_names), "by_m": depth}


def _drive(time_ns: int, drive: Drive, frame: str) -> dict[str, Any]:
    return {
        "staging_pose": _stamped(time_ns, drive.staging, frame),
        "base_goal": _stamped(time_ns, drive.goal, frame),
        "legs": [_leg(each) for each in drive.legs],
    }


def _leg(stretch: Stretch) -> dict[str, Any]:
    leg, time = stretch.leg, {"at_s": stretch.time_ns / NANOSECONDS, "lasts_s": stretch.duration_ns / NANOSECONDS}
    to = dict(zip(["x", "y", "yaw"], _rounded(*stretch.goal), strict=True))
    if leg.gear is None:
        return time | {"gear": TURN, "turn": round(leg.turn, _DECIMALS), "to": to}
    askew = {"direction": round(leg.direction, _DECIMALS)} if leg.direction else {}
    return time | {"gear": str(leg.gear), "straight": round(leg.straight, _DECIMALS), **askew, "to": to}


def _stamped(time_ns: int, pose: Pose, frame: str) -> dict[str, Any]:
    x, y, z, w = _rounded(*pose[:2], np.sin(pose[2] / 2), np.cos(pose[2] / 2))
    return {
        "header": {"stamp": _time(time_ns), "frame_id": frame},
        "pose": {
            "position": {"x": x, "y": y, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": z, "w": w},
        },
    }


def _rounded(*numbers: float) -> list[float]:
    return (np.round(numbers, _DECIMALS) + 0.0).tolist()  # no -0.0


def _points(trajectory: Trajectory) -> list[dict[str, Any]]:
    states = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    rows = zip(*((np.round(each, _DECIMALS) + 0.0).tolist() for each in states), strict=True)
    return [
        {"positions": position, "velocities": velocity, "accelerations": acceleration, "time_from_start": _time(time)}
        for time, (position, velocity, acceleration) in zip(trajectory.time_ns, rows, strict=True)
    ]


def _time(time_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS)
    return {"sec": seconds, "nanosec": nanoseconds}
