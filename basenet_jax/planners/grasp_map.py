"""The reachability map of grasps of any orientation: from which base poses, seen from the tool, the arm reaches them.

After RM4D (M. Rudorfer, *RM4D: A Combined Reachability and Inverse Reachability Map for Common 6-/7-axis Robot Arms by
Dimensionality Reduction to 4D*, ICRA 2025). An arm whose first joint turns all round about the vertical doesn't mind
how the base is turned about that joint's axis, and one whose last joint turns all round about the tool's z doesn't mind
how the gripper is turned. What is left of base pose and grasp are four numbers: the tool's height, the tilt of its z,
and where the first joint's axis stands, seen along the tool's z. The base's heading counts by where it puts that axis.
Where a joint can't turn so, the map has one axis more, of the base's headings or of the gripper's turns.

Like the map of top-down grasps it knows the arm alone: no pre-grasp, no collision.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int, UInt8

from basenet_jax import struct
from basenet_jax.planners.candidates import Candidates
from basenet_jax.robot.kinematics import Vector
from basenet_jax.task.picking import Reason
from basenet_jax.trigonometry import atan2, sin_cos
from basenet_jax.world.grasps import Grasps
from basenet_jax.world.scene import Scene

TILTS = 19  # of the tool's z, from straight up to straight down, both and level among them


@struct.dataclass
class GraspMap:
    """Bins of tool heights, tilts, places x and y of the first joint's axis, headings and turns, a bit for each.

    The tool's frame here has its origin at the grasp, z up, and x along the horizontal part of the tool's z, the
    approach. Height, x and y are whole multiples of the step at the bins' centres; angles are equal parts of a turn,
    tilts of half of one. Beyond the bins nothing is reached.
    """

    bits: UInt8[np.ndarray, " bytes"]  # of all bins in C order, eight to a byte, the lowest bit first
    axis: Float[np.ndarray, "2"]  # x, y (m) of the first joint's axis in the base's frame
    shape: "Shape" = struct.field(pytree_node=False)
    ways: int = struct.field(
        pytree_node=False, default=1
    )  # 2: a gripper turned by pi holds alike, where bins have turns

    def bins(self) -> Bool[np.ndarray, "heights tilts side side headings turns"]:
        """Whether each is reached, on the host."""
        bits = np.unpackbits(np.asarray(self.bits), count=self.shape.total, bitorder="little")
        return bits.astype(bool).reshape(self.shape.sizes)


class Shape(NamedTuple):
    """Where a map has bins."""

    step_m: float  # of heights, x and y
    lowest: int  # height, in steps above the floor
    heights: int
    side: int  # places along x, and along y, the one in the middle at 0
    headings: int  # of the base, as against the approach; 1: the first joint turns all round
    turns: int  # of the gripper about the approach; 1: the last joint turns all round

    @property
    def sizes(self) -> tuple[int, int, int, int, int, int]:
        """Of the bins' axes."""
        return self.heights, TILTS, self.side, self.side, self.headings, self.turns

    @property
    def total(self) -> int:
        """Of bins."""
        return math.prod(self.sizes)


@jax.jit
def grasp_map_candidates(grasp_map: GraspMap, scene: Scene, base_pose: Float[Array, "K 3"]) -> Candidates:
    """What the map says of all pairs of pose and object, by any of its grasps: no times, and no reason but reach.

    Args:
        grasp_map: of the robot.
        scene: unbatched.
        base_pose: the poses to choose from, (x, y, heading) in W.
    """
    grasps = jax.tree.map(lambda x: jnp.moveaxis(x, 1, 0), scene.grasps)  # "G M"

    def add(reached: Array, own: Grasps) -> tuple[Array, None]:
        return reached | (is_reached(grasp_map, base_pose[:, None], own) & own.there), None

    start = jnp.zeros((len(base_pose), len(scene.mask)), bool)
    serves = jax.lax.scan(add, start, grasps)[0] & scene.mask
    lost = scene.mask & ~jnp.any(serves, axis=0)
    return Candidates(
        base_pose=base_pose,
        serves=serves,
        pick_time=jnp.where(serves, 0.0, jnp.inf),
        reason=jnp.where(lost, Reason.OUT_OF_REACH, Reason.NONE),
    )


def is_reached(grasp_map: GraspMap, base_pose: Float[Array, "*batch 3"], grasps: Grasps) -> Bool[Array, "*batch"]:
    """Whether the map's bin nearest to a base pose and a grasp is reached; the gripper may be turned where it says so.

    Args:
        grasp_map: of the robot.
        base_pose: (x, y, heading) in W.
        grasps: one each, in W, without the axis of G.
    """
    shape, (x, y, z, roll, pitch, yaw) = grasp_map.shape, jnp.moveaxis(grasps.pose, -1, 0)
    sine, cosine = sin_cos(base_pose[..., 2])
    beside = (
        base_pose[..., 0] + cosine * grasp_map.axis[0] - sine * grasp_map.axis[1] - x,
        base_pose[..., 1] + sine * grasp_map.axis[0] + cosine * grasp_map.axis[1] - y,
    )
    (sin_r, cos_r), (sin_p, cos_p) = sin_cos(roll), sin_cos(pitch)
    nought = jnp.zeros_like(sin_p)
    angles = tool_angles((cos_p, nought, -sin_p), (sin_p * cos_r, -sin_r, cos_p * cos_r))
    angles = angles._replace(azimuth=angles.azimuth + yaw)  # so that turned about z, a grasp is in the same bin
    found = jnp.zeros((), bool)
    for way in range(grasp_map.ways):
        held = angles._replace(turn=angles.turn + way * jnp.pi)
        index, inside = nearest_bin(shape, beside, z, held, base_pose[..., 2])
        bit = (jnp.asarray(grasp_map.bits)[index >> 3] >> (index & 7).astype(jnp.uint8)) & 1
        found |= inside & (bit == 1) & (grasps.symmetric if way else True)
    return found


class ToolAngles(NamedTuple):
    """Of a tool's axes, `Rz(azimuth) Ry(tilt) Rz(turn)` (rad)."""

    azimuth: Array
    tilt: Array
    turn: Array


def tool_angles(x: Vector, z: Vector) -> ToolAngles:
    """Of the tool's x and z."""
    azimuth, tilt = atan2(z[1], z[0]), atan2(jnp.hypot(z[0], z[1]), z[2])
    (sin_a, cos_a), (sin_t, cos_t) = sin_cos(azimuth), sin_cos(tilt)
    along, across = cos_a * x[0] + sin_a * x[1], cos_a * x[1] - sin_a * x[0]
    return ToolAngles(azimuth, tilt, atan2(across, cos_t * along - sin_t * x[2]))


def nearest_bin(
    shape: Shape, beside: tuple[Array, Array], height: Array, angles: ToolAngles, heading: Array
) -> tuple[Int[Array, "*batch"], Bool[Array, "*batch"]]:
    """Number of the nearest bin, and whether there is one.

    Args:
        shape: of the map.
        beside: x and y (m) of the first joint's axis from the tool.
        height: of the tool (m).
        angles: of the tool.
        heading: of the base (rad).
    """
    sine, cosine = sin_cos(angles.azimuth)
    place = (cosine * beside[0] + sine * beside[1], cosine * beside[1] - sine * beside[0])
    i, j = (jnp.round(p / shape.step_m) + shape.side // 2 for p in place)
    row = jnp.round(height / shape.step_m) - shape.lowest
    inside = (i >= 0) & (i < shape.side) & (j >= 0) & (j < shape.side) & (row >= 0) & (row < shape.heights)
    tilt = jnp.round(angles.tilt * ((TILTS - 1) / jnp.pi))
    turn = _part_of_turn(angles.turn, shape.turns)
    parts = jnp.broadcast_arrays(row, tilt, i, j, _part_of_turn(heading - angles.azimuth, shape.headings), turn)
    index = jnp.ravel_multi_index([part.astype(jnp.int32) for part in parts], shape.sizes, mode="clip")
    return index, jnp.broadcast_to(inside, index.shape)


def _part_of_turn(angle: Array, parts: int) -> Array:
    return jnp.round(angle * (parts / (2.0 * jnp.pi))) % parts
