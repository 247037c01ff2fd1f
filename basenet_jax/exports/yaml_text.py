"""A schedule as YAML, for people and scripts: every message with the very fields that it has in ROS 2."""

from typing import Any

import numpy as np
import yaml

from basenet_jax.exports.schedule import NANOSECONDS, Command, Schedule, Trajectory

FORMAT = "basenet-execution/1"

_HEAD = f"""\
# {FORMAT}: commands in order of time. base_goal is a geometry_msgs/PoseStamped, arm_trajectory a
# trajectory_msgs/JointTrajectory, gripper close or open. m, rad and s; every stamp is the time since the beginning.
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
    if command.goal:
        x, y, yaw = command.goal
        position = {"x": round(x, _DECIMALS), "y": round(y, _DECIMALS), "z": 0.0}
        turn = np.round([np.sin(yaw / 2), np.cos(yaw / 2)], _DECIMALS).tolist()
        orientation = {"x": 0.0, "y": 0.0, "z": turn[0], "w": turn[1]}
        header = {"stamp": _time(command.time_ns), "frame_id": schedule.map_frame}
        return head | {"base_goal": {"header": header, "pose": {"position": position, "orientation": orientation}}}
    if command.trajectory:
        header = {"stamp": _time(command.time_ns), "frame_id": ""}
        points = _points(command.trajectory)
        message = {"header": header, "joint_names": list(schedule.joint_names), "points": points}
        return head | {"arm_trajectory": message}
    return head | {"gripper": command.gripper}


def _points(trajectory: Trajectory) -> list[dict[str, Any]]:
    states = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    rows = zip(*((np.round(each, _DECIMALS) + 0.0).tolist() for each in states), strict=True)  # no -0.0
    return [
        {"positions": position, "velocities": velocity, "accelerations": acceleration, "time_from_start": _time(time)}
        for time, (position, velocity, acceleration) in zip(trajectory.time_ns, rows, strict=True)
    ]


def _time(time_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS)
    return {"sec": seconds, "nanosec": nanoseconds}
