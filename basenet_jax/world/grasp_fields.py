"""Grasps as a room's file writes them, and the top-down ones that can be planned with."""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import UNSET, UnsetType

from basenet_jax.documents.fields import describe, field_error
from basenet_jax.world.room_fields import APPROACH_M, GraspPoseFields, RoomObjectFields
from basenet_jax.world.scene_fields import CLASSES

_ALLOWED = (
    "is one top-down grasp for now: [{position: [x, 0, z], rpy_degrees: [180, 0, yaw]}], "
    f"with an approach of {APPROACH_M} m, and symmetric"
)
_TOLERANCE = 1e-6  # m and degrees


def size_of(item: RoomObjectFields) -> tuple[float, float, float]:
    """The size (m) of an object, its own or its class's."""
    return CLASSES[str(item.class_)].size if isinstance(item.size, UnsetType) else item.size


def grasp_of(item: RoomObjectFields, path: str) -> tuple[float, float, float]:
    """tool0's x, z (m) and yaw (rad) in the object's frame at its top-down grasp, its own or its class's.

    Args:
        item: the object.
        path: its own, for messages.

    Raises:
        DocumentError: it has other grasps, or several.
    """
    if item.grasps is UNSET:
        kind = CLASSES[str(item.class_)]
        return kind.grasp_x, kind.grasp_z, kind.grasp_yaw
    if isinstance(item.grasps, str):
        raise field_error(f"{path}.grasps", f"a file, {describe(item.grasps)}", _ALLOWED)
    if len(item.grasps) != 1:
        raise field_error(f"{path}.grasps", f"a list of {len(item.grasps)}", _ALLOWED)
    (grasp,) = item.grasps
    if not _is_top_down(grasp):
        raise field_error(f"{path}.grasps[0]", "a grasp of another kind", _ALLOWED)
    return grasp.position[0], grasp.position[2], math.radians(grasp.rpy_degrees[2])


def top_down(grasp: Sequence[float]) -> GraspPoseFields:
    """The fields of a top-down grasp whose x, z (m) and yaw (rad) are float32; read again they are the same."""
    x, z, yaw = grasp
    degrees = math.degrees(yaw)
    short = next(d for n in range(4, 18) if np.float32(math.radians(d := float(f"{degrees:.{n}g}"))) == np.float32(yaw))
    return GraspPoseFields(position=(x, 0.0, z), rpy_degrees=(180.0, 0.0, short))


def _is_top_down(grasp: GraspPoseFields) -> bool:
    roll, pitch, _ = grasp.rpy_degrees
    down = abs(roll % 360 - 180) <= _TOLERANCE and abs(pitch) <= _TOLERANCE
    known = abs(grasp.approach - APPROACH_M) <= _TOLERANCE and grasp.symmetric
    return down and known and abs(grasp.position[1]) <= _TOLERANCE
