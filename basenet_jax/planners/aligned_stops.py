"""Base poses in line with the table's sides, as near to it as the clearance allows.

The grid of the paper's planners has its lines where they fall: at 10 cm they leave 5 cm to the table. A
stop that just clears the table reaches farther, and stops on one line are driven between without a turn, which with a
trapezoidal profile is dear even when small. A few hundred such stops hold better plans than the whole grid.
"""

import dataclasses

import jax
import numpy as np
from jaxtyping import Float

from basenet_jax.config import AlignedConfig, PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.task.reliability import Chance
from basenet_jax.world.boxes import Room
from basenet_jax.world.clearance import compiled_base_collides


def aligned_poses(
    robot: Robot, room: Room, config: AlignedConfig = AlignedConfig(), pick: PickConfig = PickConfig()
) -> Float[np.ndarray, "K 3"]:
    """Stops (x, y, heading in W) along all sides of every surface, the base lengthwise and crosswise, both ways round.

    Args:
        robot: its footprint counts.
        room: unbatched.
        config: how far apart they are, and how near to what is allowed.
        pick: of the base's clearance from boxes.
    """
    boxes = jax.tree.map(np.asarray, room.boxes)
    around = [
        _round_the_box(robot, boxes.pose[box], boxes.half_size[box] + off, quarters * np.pi / 2, config.step_m)
        for off in pick.base_clearance_m + config.gap_m + np.array([0.0, *config.farther_m])
        for box in np.flatnonzero(boxes.bears_objects)
        for quarters in (-1, 0, 1, 2)
    ]
    poses = np.concatenate(around).astype(np.float32)
    _, first = np.unique(poses, axis=0, return_index=True)  # boards of a shelf have the same sides
    poses = poses[np.sort(first)]
    collides = compiled_base_collides(robot, poses, room, pick.base_clearance_m, pick.touching_m)
    return poses[~np.asarray(collides)]


def sure_lines(robot: Robot, chance: Chance, aligned: AlignedConfig, pick: PickConfig = PickConfig()) -> AlignedConfig:
    """Lines of stops so far off that the base, parked with errors, nearly always keeps its clearance.

    Half of what may fail may fail of that, since picks fail too; and a second line is a standard deviation farther off.
    Where the errors are so small that the usual line does, there is no other.

    Args:
        robot: its footprint counts.
        chance: the errors, and how many of them may fail.
        aligned: the usual line.
        pick: how far off that is.
    """
    base, (length, width) = np.asarray(chance.errors.base, float), np.asarray(robot.footprint_half_size, float)
    sine, cosine = np.abs(np.sin(base[:, 2])), np.cos(base[:, 2])
    # How much farther the turned and shifted footprint comes towards the side, the base lengthwise and crosswise.
    nearer = [
        near * cosine + along * sine - near + np.abs(base[:, axis])
        for near, along, axis in ((width, length, 1), (length, width, 0))
    ]
    needed = np.sort(np.max(nearer, axis=0))[len(base) - 1 - int(chance.allowed) // 2]
    more = needed - (pick.base_clearance_m - chance.uncertainty.base_clearance_m)
    if more <= 0:
        return aligned
    spread = chance.uncertainty.sd_xy_m
    return dataclasses.replace(aligned, gap_m=float(aligned.gap_m + more), farther_m=(*aligned.farther_m, spread))


def _round_the_box(
    robot: Robot, box: np.ndarray, half_size: np.ndarray, turn: float, step_m: float
) -> Float[np.ndarray, "K 3"]:
    """The stops turned so (rad) that touch a box of that half size: on a rectangle about it, its corners included."""
    length, width = np.asarray(robot.footprint_half_size)
    along = np.abs([np.cos(turn), np.sin(turn)])
    half = half_size + along * length + along[::-1] * width
    x, y = (_symmetric_steps(extent, step_m) for extent in half)
    sides = [(x, np.full_like(x, sign * half[1])) for sign in (1, -1)]
    sides += [(np.full_like(y, sign * half[0]), y) for sign in (1, -1)]
    points = np.concatenate([np.stack(side, axis=-1) for side in sides])
    sine, cosine = np.sin(box[2]), np.cos(box[2])
    places = box[:2] + points @ np.array([[cosine, sine], [-sine, cosine]])
    headings = np.pi - (np.pi - box[2] - turn) % (2 * np.pi)
    return np.column_stack([places, np.full(len(points), headings)])


def _symmetric_steps(extent: float, step: float) -> Float[np.ndarray, " S"]:
    """Multiples of the step from -extent to extent."""
    count = int(extent / step)
    return np.arange(-count, count + 1) * step
