"""A schedule as a table of states over time, for spreadsheets and plots."""

import csv
import io

import numpy as np

from basenet_jax.exports.schedule import Schedule, in_map

_DECIMALS = 6


def to_csv(schedule: Schedule, rate_hz: float) -> bytes:
    """The content of `execution.csv`: the base's pose in the map, the joints, and what is being done.

    Args:
        schedule: what is written.
        rate_hz: of the rows; the beginning and the end of every part have one too.
    """
    motion = schedule.motion
    units = ["m" if slides else "rad" for slides in schedule.prismatic]
    joints = [f"{name}_{unit}" for name, unit in zip(schedule.joint_names, units, strict=True)]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["time_s", "base_x_m", "base_y_m", "base_yaw_rad", *joints, "doing", "object"])
    for key, part in enumerate(motion.parts):
        begin, end = motion.time[key], motion.time[key + 1]
        time = np.append(np.arange(begin, end - 0.1 / rate_hz, 1.0 / rate_hz), end)
        share = part.law.at(time - begin).share[:, None]
        pose, angles = (x[key] + share * (x[key + 1] - x[key]) for x in (motion.base_pose, motion.joints))
        numbers = np.column_stack([time, in_map(pose, schedule.table_pose), angles])
        what = (part.doing, schedule.objects[part.step])
        writer.writerows([*(f"{number:.{_DECIMALS}f}" for number in row), *what] for row in numbers.tolist())
    return stream.getvalue().encode()
