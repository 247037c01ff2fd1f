"""A schedule as a ROS 2 bag, written without ROS."""

from pathlib import Path
from typing import Any

import numpy as np

from basenet_jax.exports.schedule import NANOSECONDS, Command, Schedule, Trajectory

BASE_GOAL, ARM_TRAJECTORY, GRIPPER = "/base_goal", "/arm_trajectory", "/gripper"
_TYPES = {
    BASE_GOAL: "geometry_msgs/msg/PoseStamped",
    ARM_TRAJECTORY: "trajectory_msgs/msg/JointTrajectory",
    GRIPPER: "std_msgs/msg/String",
}


def write_bag(folder: Path, schedule: Schedule) -> None:
    """Writes a bag: every command as one message, recorded at its time since the plan's beginning.

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
            topic, message = messages.of(command)
            writer.write(topics[topic], command.time_ns, store.serialize_cdr(message, _TYPES[topic]))


class _Messages:
    """Makes ROS messages of commands."""

    def __init__(self, types: dict[str, Any], schedule: Schedule):
        self._types, self._schedule = types, schedule

    def of(self, command: Command) -> tuple[str, Any]:
        """The topic and the message of a command."""
        if command.goal:
            return BASE_GOAL, self._pose(command.time_ns, *command.goal)
        if command.trajectory:
            return ARM_TRAJECTORY, self._trajectory(command.time_ns, command.trajectory)
        return GRIPPER, self._types[_TYPES[GRIPPER]](data=command.gripper)

    def _pose(self, time_ns: int, x: float, y: float, yaw: float) -> Any:
        position = self._types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
        turn = (float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
        orientation = self._types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=turn[0], w=turn[1])
        pose = self._types["geometry_msgs/msg/Pose"](position=position, orientation=orientation)
        return self._types[_TYPES[BASE_GOAL]](header=self._header(time_ns, self._schedule.map_frame), pose=pose)

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
