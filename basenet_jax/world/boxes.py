"""What is solid: boxes turned about z alone, and the room that they stand in."""

import numpy as np
from jaxtyping import Bool, Float

from basenet_jax import struct

UNBOUNDED = (-np.inf, -np.inf, np.inf, np.inf)


@struct.dataclass
class Boxes:
    """B boxes, or a batch of as many; the only geometry there is. A box that blocks nothing pads: it isn't there."""

    pose: Float[np.ndarray, "*batch B 3"]  # centre's x, y (m) and yaw (rad) in W
    half_size: Float[np.ndarray, "*batch B 2"]  # m, along the box's own x and y
    low: Float[np.ndarray, "*batch B"]  # m over the floor
    high: Float[np.ndarray, "*batch B"]
    blocks_base: Bool[np.ndarray, "*batch B"]  # if it overlaps the robot's body in z, see `blocks`
    blocks_arm: Bool[np.ndarray, "*batch B"]


@struct.dataclass
class Room:
    """Boxes and the floor's bounds, or a batch of as many; a pytree of NumPy's or JAX's arrays."""

    boxes: Boxes
    floor: Float[np.ndarray, "*batch 4"]  # x_min, y_min, x_max, y_max (m) of what the footprint may cover


def blocks(boxes: Boxes, body_top: Float[np.ndarray, ""] | float) -> Bool[np.ndarray, "*batch B"]:
    """Which boxes block a base whose body reaches from the floor to `body_top` (m)."""
    return boxes.blocks_base & (boxes.low < body_top) & (boxes.high > 0.0)


def pad(boxes: Boxes, count: int) -> Boxes:
    """The same with boxes that block nothing behind, so that there are `count` of them; on the host.

    Raises:
        ValueError: there are more.
    """
    missing = count - boxes.low.shape[-1]
    if missing < 0:
        raise ValueError(f"boxes: found {boxes.low.shape[-1]}, allowed are up to {count}")

    def fill(x: np.ndarray) -> np.ndarray:
        axis = boxes.low.ndim - 1
        return np.pad(x, [(0, missing if i == axis else 0) for i in range(x.ndim)])

    return Boxes(*(fill(getattr(boxes, name)) for name in Boxes.__dataclass_fields__))
