"""Grasps as a room's file writes them, or a file of their own that it names."""

import io
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float, Int
from msgspec import UNSET, Meta, Struct, UnsetType
from scipy.spatial.transform import Rotation

from basenet_jax.documents.fields import DocumentError, convert, describe, field_error, shortest
from basenet_jax.documents.text_files import find_file, read_bytes, read_json, read_yaml
from basenet_jax.world.grasps import Grasps, select
from basenet_jax.world.room_fields import MAX_GRASPS, GraspPoseFields, RoomObjectFields, ToolFrameFields
from basenet_jax.world.scene_fields import CLASSES

GRASPS_FORMAT = "basenet-grasps/1"
KEPT = 16  # of an object's grasps: planning looks at so many
_MAX_BYTES = 1024 * 1024
_FAR_M = 0.75  # farther from an object's box no gripper's frame is
_UPWARD, _BELOW_M = 0.2, 0.02  # the z of the z axis of a tool that comes from below, and how far below the box it is
_ORTHONORMAL = 1e-3  # how far the columns of a matrix may be from a rotation's

_ALLOWED = {
    "format": f"is {GRASPS_FORMAT!r}",
    "grasps": f"is a list of 1 to {MAX_GRASPS} grasps",
    "grasps[]": "is a mapping with position and rpy_degrees",
    "grasps[].position": "is [x, y, z], three numbers (m)",
    "grasps[].position[]": "is a number from -2 to 2 (m)",
    "grasps[].rpy_degrees": "is [roll, pitch, yaw], three numbers (degrees)",
    "grasps[].rpy_degrees[]": "is a number from -6000 to 6000 (degrees)",
    "grasps[].approach": "is a number from 0.001 to 1 (m), or no such key",
    "grasps[].symmetric": "is true or false, or no such key",
    "grasps[].score": "is a number, the more the better, or no such key",
    "tool_frame": "is a mapping with position and rpy_degrees, or no such key",
    "tool_frame.position": "is [x, y, z], three numbers (m)",
    "tool_frame.position[]": "is a number from -2 to 2 (m)",
    "tool_frame.rpy_degrees": "is [roll, pitch, yaw], three numbers (degrees)",
    "tool_frame.rpy_degrees[]": "is a number from -6000 to 6000 (degrees)",
}


class GraspFileFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """A file of grasps of one object."""

    format: str
    tool_frame: ToolFrameFields | UnsetType = UNSET
    grasps: Annotated[list[GraspPoseFields], Meta(min_length=1, max_length=MAX_GRASPS)]


def size_of(item: RoomObjectFields) -> tuple[float, float, float]:
    """The size (m) of an object, its own or its class's."""
    return CLASSES[str(item.class_)].size if isinstance(item.size, UnsetType) else item.size


def read_grasps(
    item: RoomObjectFields, folder: Path, path: str, *, sides: bool
) -> tuple[Grasps, Int[np.ndarray, " G"]]:
    """An object's grasps in its frame, float32 on the host, and which of those written each is.

    Args:
        item: the object.
        folder: of the scene file, in which the grasps' file is.
        path: of the object, for messages.
        sides: whether classes have their side grasps.

    Raises:
        DocumentError: a file is missing, damaged or too large, or holds no grasps; the message names it.
    """
    if item.grasps is UNSET:
        grasps = CLASSES[str(item.class_)].grasps(sides=sides)
        return grasps, np.arange(len(grasps.there))
    field = f"{path}.grasps"
    if not isinstance(item.grasps, str):
        return _kept(item.grasps, _frame(item.tool_frame))
    found = find_file(item.grasps, folder, folder.resolve(), field)
    frame = item.tool_frame
    try:
        if found.suffix.lower() == ".npy":
            grasps = _from_matrices(read_bytes(found, _MAX_BYTES))
        else:
            data = read_json(found) if found.suffix.lower() == ".json" else read_yaml(found)
            fields = convert(data, GraspFileFields, format_name=GRASPS_FORMAT, allowed=_ALLOWED)
            grasps, frame = fields.grasps, frame if fields.tool_frame is UNSET else fields.tool_frame
    except DocumentError as error:
        raise DocumentError(f"{field}: {found.name}: {error}") from None
    _check_places(grasps, _frame(frame), size_of(item), f"{field}: {found.name}")
    return _kept(grasps, _frame(frame))


def _check_places(
    fields: list[GraspPoseFields], tool0: Float[np.ndarray, "4 4"], size: tuple[float, float, float], field: str
) -> None:
    """That some grasp of a file is near the object, and that most aren't from below it: else they are of other frames.

    Raises:
        DocumentError: with the frames that were meant, as it seems.
    """
    given = np.stack([_matrix(each.position, each.rpy_degrees) for each in fields])
    half = 0.5 * np.array(size)
    away = np.linalg.norm(np.maximum(np.abs(given[:, :3, 3]) - half, 0.0), axis=1)
    if np.all(away > _FAR_M):
        found = f"no grasp nearer to the object than {away.min():.2f} m"
        raise field_error(field, found, "are poses in the object's frame, from its box's centre, not a room's")
    tools = given @ tool0
    up, below = tools[:, 2, 2], tools[:, 2, 3] < -half[2] - _BELOW_M
    if np.all(up > -_UPWARD) and np.mean((up > _UPWARD) & below) > 0.5:
        allowed = "are tool frames whose z is the way the gripper comes (where theirs points back, turn tool_frame by "
        raise field_error(
            field, "grasps from below the object and none from above", f"{allowed}rpy_degrees: [180, 0, 0])"
        )


def grasp_document(grasps: Grasps) -> list[GraspPoseFields]:
    """The fields of an object's grasps; read again they are the same to the last bit of float32."""
    return [_fields(grasps[index]) for index in np.flatnonzero(grasps.there)]


def _fields(grasp: Grasps) -> GraspPoseFields:
    x, y, z = shortest(grasp.pose[:3])
    roll, pitch, yaw = (_degrees(angle) for angle in grasp.pose[3:])
    approach = shortest(grasp.approach) if grasp.approach > 0 else UNSET
    symmetric: Any = bool(grasp.symmetric)
    return GraspPoseFields(position=(x, y, z), rpy_degrees=(roll, pitch, yaw), approach=approach, symmetric=symmetric)


def _degrees(angle: np.float32) -> float:
    """The shortest decimals in degrees that give back a float32 in rad."""
    degrees = np.degrees(float(angle))
    tries = (float(f"{degrees:.{digits}g}") for digits in range(3, 18))
    return next(each for each in tries if np.float32(np.radians(each)) == angle)


def _from_matrices(data: bytes) -> list[GraspPoseFields]:
    """The grasps of a `.npy` file: 4 x 4 matrices of the tool in the object's frame."""
    try:
        matrices = np.load(io.BytesIO(data), allow_pickle=False)
    except Exception:  # of damaged files NumPy says nearly anything
        raise field_error("", "no array that can be read", "are whole .npy files without Python objects") from None
    shape = getattr(matrices, "shape", None)
    if shape is None or len(shape) != 3 or shape[1:] != (4, 4) or not 1 <= shape[0] <= MAX_GRASPS:
        raise field_error("", f"an array of shape {shape}", f"is n x 4 x 4, n from 1 to {MAX_GRASPS}")
    if matrices.dtype.kind != "f" or not np.all(np.isfinite(matrices)):
        raise field_error("", f"numbers of type {matrices.dtype}, or not finite", "are finite floating point numbers")
    matrices = matrices.astype(float)
    rotation, position = matrices[:, :3, :3], matrices[:, :3, 3]
    skewed = np.abs(np.swapaxes(rotation, 1, 2) @ rotation - np.eye(3)).max(axis=(1, 2)) > _ORTHONORMAL
    mirrored, last = np.linalg.det(rotation) < 0, np.abs(matrices[:, 3] - [0, 0, 0, 1]).max(axis=1) > _ORTHONORMAL
    if np.any(wrong := skewed | mirrored | last):
        raise field_error(f"[{np.argmax(wrong)}]", "no rigid transform", "are a rotation, a position and a row 0 0 0 1")
    if np.any(far := np.abs(position).max(axis=1) > 2):
        found = f"the position {describe(position[np.argmax(far)].tolist())}"
        raise field_error(f"[{np.argmax(far)}]", found, "are positions up to 2 m from the object's centre")
    angles = _rpy(rotation)
    return [
        GraspPoseFields(position=tuple(p), rpy_degrees=tuple(np.degrees(a)))
        for p, a in zip(position.tolist(), angles, strict=True)
    ]


def _frame(fields: ToolFrameFields | UnsetType) -> Float[np.ndarray, "4 4"]:
    """tool0 in the frame that grasps are given of."""
    return np.eye(4) if isinstance(fields, UnsetType) else np.linalg.inv(_matrix(fields.position, fields.rpy_degrees))


def _matrix(position: tuple[float, ...], rpy_degrees: tuple[float, ...]) -> Float[np.ndarray, "4 4"]:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("ZYX", rpy_degrees[::-1], degrees=True).as_matrix()
    matrix[:3, 3] = position
    return matrix


def _rpy(rotation: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    return Rotation.from_matrix(rotation).as_euler("ZYX", suppress_warnings=True)[:, ::-1]


def _kept(fields: list[GraspPoseFields], tool0: Float[np.ndarray, "4 4"]) -> tuple[Grasps, Int[np.ndarray, " G"]]:
    """The grasps of tool0, and which of the fields each is, where there are more than planning looks at."""
    angles = np.radians([each.rpy_degrees for each in fields])
    poses = np.column_stack([[each.position for each in fields], angles])
    if not np.array_equal(tool0, np.eye(4)):
        moved = np.stack([_matrix(each.position, each.rpy_degrees) for each in fields]) @ tool0
        poses = np.column_stack([moved[:, :3, 3], _rpy(moved[:, :3, :3])])
    approach = [0.0 if isinstance(each.approach, UnsetType) else each.approach for each in fields]
    leaves: dict[str, Any] = {  # on the host
        "pose": poses.astype(np.float32),
        "approach": np.array(approach, np.float32),
        "symmetric": np.array([each.symmetric for each in fields]),
        "there": np.ones(len(fields), bool),
    }
    grasps = Grasps(**leaves)
    score = np.array([0.0 if isinstance(each.score, UnsetType) else each.score for each in fields])
    index = select(grasps, score, KEPT)
    return grasps[index], index
