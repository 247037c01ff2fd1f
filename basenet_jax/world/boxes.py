"""What is solid: boxes turned about z alone, and the room that they stand in."""

from collections.abc import Hashable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float

from basenet_jax import struct
from basenet_jax.config import TableConfig

UNBOUNDED = (-np.inf, -np.inf, np.inf, np.inf)


@struct.dataclass
class Boxes:
    """B boxes, or a batch of as many; the only geometry there is. A box that blocks nothing pads: it isn't there."""

    pose: Float[Array, "*batch B 3"]  # centre's x, y (m) and yaw (rad) in W
    half_size: Float[Array, "*batch B 2"]  # m, along the box's own x and y
    low: Float[Array, "*batch B"]  # m over the floor
    high: Float[Array, "*batch B"]
    blocks_base: Bool[Array, "*batch B"]  # if it overlaps the robot's body in z, see `blocks`
    blocks_arm: Bool[Array, "*batch B"]
    bears_objects: Bool[Array, "*batch B"]  # a surface: objects stand on its top, and the base parks at its sides


@struct.dataclass
class Room:
    """Boxes and the floor's bounds, or a batch of as many; a pytree of NumPy's or JAX's arrays."""

    boxes: Boxes
    floor: Float[Array, "*batch 4"]  # x_min, y_min, x_max, y_max (m) of what the footprint may cover
    cluttered: bool = struct.field(pytree_node=False, default=False)  # whether rules 5 to 7 hold, unless it's switched

    @classmethod
    def from_config(cls, config: TableConfig = TableConfig()) -> "Room":
        """The paper's room: one table about W's origin, solid from the floor to its top, and no bounds; on the host."""
        dtype = jax.dtypes.canonicalize_dtype(float)  # float64 only where x64 is enabled
        half_size = np.array([config.length_m / 2, config.width_m / 2], dtype)
        return cls.of_table(half_size, np.array(config.height_m, dtype), np)

    @classmethod
    def of_table(cls, half_size: ArrayLike, height: ArrayLike, numpy: Any = jnp) -> "Room":
        """Likewise of any table, or a batch of rooms with one each.

        Args:
            half_size: "*batch 2", m, along x and y.
            height: "*batch", m, of its top.
            numpy: the module that makes the arrays: NumPy, or `jax.numpy` where the sizes are traced.
        """
        high = numpy.asarray(height)[..., None]
        boxes = Boxes(
            pose=numpy.zeros((*high.shape, 3), high.dtype),
            half_size=numpy.asarray(half_size)[..., None, :],
            low=numpy.zeros_like(high),
            high=high,
            blocks_base=numpy.ones(high.shape, bool),
            blocks_arm=numpy.ones(high.shape, bool),
            bears_objects=numpy.ones(high.shape, bool),
        )
        return cls(boxes, numpy.broadcast_to(numpy.asarray(UNBOUNDED, high.dtype), (*high.shape[:-1], 4)))

    @property
    def batched(self) -> bool:
        """Whether it is a batch of rooms."""
        return jnp.ndim(self.boxes.low) > 1

    @property
    def table_half_size(self) -> Float[Array, "*batch 2"]:
        """Of the paper's room: half the table's sides along x and y (m)."""
        return self.boxes.half_size[..., 0, :]

    @property
    def table_height(self) -> Float[Array, "*batch"]:
        """Of the paper's room: the height of the table's top (m)."""
        return self.boxes.high[..., 0]


def fingerprint(room: Room) -> Hashable:
    """What tells one concrete room from others, for caches."""
    return tuple((x.shape, x.dtype.str, x.tobytes()) for x in map(np.asarray, jax.tree.leaves(jax.device_get(room))))


def surface_top(room: Room) -> float:
    """Height (m) of the highest surface of a concrete room."""
    return float(np.max(np.where(room.boxes.bears_objects, room.boxes.high, 0.0)))


def blocks(boxes: Boxes, body_top: ArrayLike) -> Bool[Array, "*batch B"]:
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

    def fill(x: Array) -> Any:
        axis = boxes.low.ndim - 1
        return np.pad(np.asarray(x), [(0, missing if i == axis else 0) for i in range(x.ndim)])

    return Boxes(*(fill(getattr(boxes, name)) for name in Boxes.__dataclass_fields__))
