"""A schedule as a ROS 2 bag, written without ROS."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from basenet_jax.exports.schedule import NANOSECONDS, Command, Drive, Pose, Schedule, Trajectory
from basenet_jax.exports.yaml_text import TURN

STAGING_POSE, BASE_GOAL, LEG_GOAL, GEAR = "/staging_pose", "/base_goal", "/leg_goal", "/gear"
ARM_TRAJECTORY, GRIPPER = "/arm_trajectory", "/gripper"
_TYPES = {
    STAGING_POSE: "geometry_msgs/msg/PoseStamped",
    BASE_GOAL: "geometry_msgs/msg/PoseStamped",
    LEG_GOAL: "geometry_msgs/msg/PoseStamped",
    GEAR: "std_msgs/msg/String",
    ARM_TRAJECTORY: "trajectory_msgs/msg/JointTrajectory",
    GRIPPER: "std_msgs/msg/String",
}


def write_bag(folder: Path, schedule: Schedule) -> None:
    """Writes a bag: every command's messages, recorded at their time since the plan's beginning.

    Args:
        folder: of the bag, made here; it must not be there.
        schedule: what is written.

    Raises:
        ImportError: the package rosbags isn't installed.
        OSError: the bag can't be written.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer  # an extra: `pip install "basenet_jax[ros]"`
    from rosbags.typesys import Stores, get_typestore

    # These messages are the same in all distributions. Version 8 is the oldest layout that rosbags writes, and
    # SQLite the storage that needs no plugin.
    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = _Messages(store.types, schedule)
    with Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topics = {topic: writer.add_connection(topic, name, typestore=store) for topic, name in _TYPES.items()}
        for command in schedule.commands:
            for topic, time_ns, message in messages.of(command):
                writer.write(topics[topic], time_ns, store.serialize_cdr(message, _TYPES[topic]))


class _Messages:
    """Makes ROS messages of commands."""

    def __init__(self, types: dict[str, Any], schedule: Schedule):
        self._types, self._schedule = types, schedule

    def of(self, command: Command) -> Iterator[tuple[str, int, Any]]:
        """Topics, times (ns) and messages of a command."""
        if command.drive:
            yield from self._drive(command.time_ns, command.drive)
        elif command.trajectory:
            yield ARM_TRAJECTORY, command.time_ns, self._trajectory(command.time_ns, command.trajectory)
        else:
            yield GRIPPER, command.time_ns, self._text(str(command.gripper))

    def _drive(self, time_ns: int, drive: Drive) -> Iterator[tuple[str, int, Any]]:
        yield STAGING_POSE, time_ns, self._pose(time_ns, drive.staging)
        yield BASE_GOAL, time_ns, self._pose(time_ns, drive.goal)
        for each in drive.legs:
            yield GEAR, each.time_ns, self._text(each.leg.gear or TURN)
            yield LEG_GOAL, each.time_ns, self._pose(each.time_ns, each.goal)

    def _text(self, text: str) -> Any:
        return self._types["std_msgs/msg/String"](data=text)

    def _pose(self, time_ns: int, pose: Pose) -> Any:
        x, y, yaw = pose
        position = self._types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
        turn = (float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
        orientation = self._types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=turn[0], w=turn[1])
        stamped = self._types["geometry_msgs/msg/PoseStamped"]
        pose = self._types["geometry_msgs/msg/Pose"](position=position, orientation=orientation)
        return stamped(header=self._header(time_ns, self._schedule.map_frame), pose=pose)

    def _trajectory(self, time_ns: int, trajectory: Trajectory) -> Any:
        point = self._types["trajectory_msgs/msg/JointTrajectoryPoint"]
        duration = self._types["builtin_interfaces/msg/Duration"]
        states = zip(trajectory.positions, trajectory.velocities, trajectory.accelerations, strict=True)
        points = [
            point(
                positions=position,
                velocities=velocity,
                accelerations=acceleration,
                effort=np.zeros(0),
                time_from_start=duration(*divmod(time, NANOSECONDS)),
            )
            for time, (position, velocity, acceleration) in zip(trajectory.time_ns, states, strict=True)
        ]
        return self._types[_TYPES[ARM_TRAJECTORY]](
            header=self._header(time_ns, ""), joint_names=list(self._schedule.joint_names), points=points
        )

    def _header(self, time_ns: int, frame: str) -> Any:
        stamp = self._types["builtin_interfaces/msg/Time"](*divmod(time_ns, NANOSECONDS))
        return self._types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)
