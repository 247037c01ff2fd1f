"""Base poses in line with the table's sides, as near to it as the clearance allows.

The grid of the paper's planners has its lines where they fall: at 10 cm they leave 5 cm to the table. A
stop that just clears the table reaches farther, and stops on one line are driven between without a turn, which with a
trapezoidal profile is dear even when small. A few hundred such stops hold better plans than the whole grid.
"""

import jax
import numpy as np
from jaxtyping import Float

from basenet_jax.config import AlignedConfig, PickConfig
from basenet_jax.robot.model import Robot
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
        _round_the_box(robot, boxes.pose[box], boxes.half_size[box], quarters * np.pi / 2, config, pick)
        for box in np.flatnonzero(boxes.bears_objects)
        for quarters in (-1, 0, 1, 2)
    ]
    poses = np.concatenate(around).astype(np.float32)
    _, first = np.unique(poses, axis=0, return_index=True)  # boards of a shelf have the same sides
    poses = poses[np.sort(first)]
    collides = compiled_base_collides(robot, poses, room, pick.base_clearance_m, pick.touching_m)
    return poses[~np.asarray(collides)]


def _round_the_box(
    robot: Robot, box: np.ndarray, half_size: np.ndarray, turn: float, config: AlignedConfig, pick: PickConfig
) -> Float[np.ndarray, "K 3"]:
    """The stops turned so against the box (rad): on the sides of a rectangle about it, its corners included."""
    length, width = np.asarray(robot.footprint_half_size)
    along = np.abs([np.cos(turn), np.sin(turn)])
    half = half_size + pick.base_clearance_m + config.gap_m + along * length + along[::-1] * width
    x, y = (_symmetric_steps(extent, config.step_m) for extent in half)
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
