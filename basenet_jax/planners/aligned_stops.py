"""Base poses in line with the table's sides, as near to it as the clearance allows.

The grid of the paper's planners has its lines where they fall: at 10 cm they leave 5 cm to the table. A
stop that just clears the table reaches farther, and stops on one line are driven between without a turn, which with a
trapezoidal profile is dear even when small. A few hundred such stops hold better plans than the whole grid.
"""

import numpy as np
from jaxtyping import Float

from basenet_jax.config import AlignedConfig, PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.world.clearance import compiled_base_collides
from basenet_jax.world.scene import Table


def aligned_poses(
    robot: Robot, table: Table, config: AlignedConfig = AlignedConfig(), pick: PickConfig = PickConfig()
) -> Float[np.ndarray, "K 3"]:
    """Stops (x, y, heading in W) along all four sides of the table, the base lengthwise and crosswise, both ways round.

    Args:
        robot: its footprint counts.
        table: the table.
        config: how far apart they are, and how near to what is allowed.
        pick: of the base's clearance from the table.
    """
    poses = [_round_the_table(robot, table, quarters * np.pi / 2, config, pick) for quarters in (-1, 0, 1, 2)]
    poses = np.concatenate(poses).astype(np.float32)
    collides = compiled_base_collides(robot, poses, table, pick.base_clearance_m, pick.touching_m)
    return poses[~np.asarray(collides)]


def _round_the_table(
    robot: Robot, table: Table, heading: float, config: AlignedConfig, pick: PickConfig
) -> Float[np.ndarray, "K 3"]:
    """The stops with one heading: on the sides of a rectangle about the table, its corners included."""
    length, width = np.asarray(robot.footprint_half_size)
    along = np.abs([np.cos(heading), np.sin(heading)])
    half = np.asarray(table.half_size) + pick.base_clearance_m + config.gap_m + along * length + along[::-1] * width
    x, y = (_symmetric_steps(extent, config.step_m) for extent in half)
    sides = [(x, np.full_like(x, sign * half[1])) for sign in (1, -1)]
    sides += [(np.full_like(y, sign * half[0]), y) for sign in (1, -1)]
    points = np.concatenate([np.stack(side, axis=-1) for side in sides])
    return np.concatenate([points, np.full((len(points), 1), heading)], axis=-1)


def _symmetric_steps(extent: float, step: float) -> Float[np.ndarray, " S"]:
    """Multiples of the step from -extent to extent."""
    count = int(extent / step)
    return np.arange(-count, count + 1) * step
