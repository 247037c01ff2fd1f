"""Occupancy maps of mobile robots, ROS's `map_server` files: a YAML file and a grey image, a pixel for each cell.

Cells are read as Nav2's map_server does (ros-navigation/navigation2, `nav2_map_server/src/map_io.cpp`). A cell that
isn't known to be free is closed to the base, be it occupied or unknown. We differ in one thing: in the mode `trinary`
the grey 205, which `map_saver` writes for unknown cells, is unknown whatever `free_thresh` says. By the 0.25 that Nav2
writes beside it, 205 (an occupancy of 0.196) would be free, and a robot sent where nobody has looked.
"""

import io
import warnings
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from msgspec import Meta, Struct

from basenet_jax.documents.fields import DocumentError, convert, describe, field_error
from basenet_jax.documents.text_files import find_file, read_bytes, read_yaml
from basenet_jax.world.boxes import Boxes
from basenet_jax.world.footprints import in_frame
from basenet_jax.world.furniture import FLAT_M, Angle
from basenet_jax.world.rectangles import cover

MAX_CELLS = 4_000_000
MAX_IMAGE_BYTES = 32 * 1024 * 1024
MAX_RECTANGLES = 8192
MODES = ("trinary", "scale", "raw")
_UNKNOWN = 205  # grey: of unknown cells in what map_saver writes in the mode `trinary`
_FRAME = 1  # cells: beyond the map nothing is known

_Share = Annotated[float, Meta(ge=0, le=1)]
_Position = Annotated[float, Meta(ge=-1000, le=1000)]


class MapFields(Struct, kw_only=True):
    """The YAML file; other keys than these are left alone, as map_server does."""

    image: str
    resolution: Annotated[float, Meta(ge=0.001, le=10)]  # m, a cell's side
    origin: tuple[_Position, _Position, Angle]  # pose of the lower left corner
    negate: Annotated[int, Meta(ge=0, le=1)] | bool  # whether white is occupied
    occupied_thresh: _Share
    free_thresh: _Share
    mode: str = "trinary"


_ALLOWED = {
    "image": "is the image's name, in the map's folder or below",
    "resolution": "is a number from 0.001 to 10 (m)",
    "origin": "is [x, y, yaw], three numbers (m, m, rad)",
    "origin[]": "is a number from -1000 to 1000 (m), and the angle from -6.3 to 6.3 (rad; degrees?)",
    "negate": "is 0 or 1",
    "occupied_thresh": "is a number from 0 to 1",
    "free_thresh": "is a number from 0 to 1",
    "mode": f"is {', '.join(MODES[:-1])} or {MODES[-1]}, or no such key",
}


class OccupancyMap(NamedTuple):
    """Which cells are closed to the base."""

    closed: Bool[np.ndarray, "rows columns"]  # row 0 is the lowest; y grows with the row, x with the column
    resolution: float  # m, a cell's side
    origin: tuple[float, float, float]  # pose in W of the corner of cell (0, 0), where x and y are least


def read_map(name: str, folder: Path) -> OccupancyMap:
    """Reads a map; opens nothing outside the folder.

    Args:
        name: of the YAML file, relative to the folder.
        folder: the scene file's.

    Raises:
        DocumentError: a file is missing, outside the folder, too large or damaged, or a field is wrong; the message
            names the file, the field, what was found and what is allowed.
    """
    folder = folder.resolve()
    path = find_file(name, folder, folder, "map")
    try:
        fields = convert(read_yaml(path), MapFields, format_name=None, allowed=_ALLOWED)
        if fields.mode not in MODES:
            raise field_error("mode", describe(fields.mode), _ALLOWED["mode"])
        if fields.free_thresh >= fields.occupied_thresh:
            found = f"{fields.free_thresh}, where occupied_thresh is {fields.occupied_thresh}"
            raise field_error("free_thresh", found, "are numbers below occupied_thresh")
        image = find_file(fields.image, path.parent, folder, "image")
    except DocumentError as error:
        raise DocumentError(f"map: {path.name}: {error}") from None
    try:
        pixels = _read_image(image)
    except DocumentError as error:
        raise DocumentError(f"map: {image.name}: {error}") from None
    return OccupancyMap(~_free(pixels, fields)[::-1], fields.resolution, fields.origin)


def map_boxes(occupancy: OccupancyMap) -> Boxes:
    """The closed cells, and a frame of cells round the map, as boxes that block the base; they cover just these.

    Raises:
        DocumentError: they are too ragged to be covered by a few thousand rectangles.
    """
    try:
        cells = cover(np.pad(occupancy.closed, _FRAME, constant_values=True), MAX_RECTANGLES)
    except ValueError:
        found = f"closed cells that {MAX_RECTANGLES} rectangles don't cover"
        raise field_error("map", found, "are maps with less noise, or coarser ones") from None
    low, high = (occupancy.resolution * (cells[:, side] - _FRAME) for side in ([1, 0], [3, 2]))  # x, y in its own frame
    x, y, yaw = occupancy.origin
    center = (low + high) / 2 @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) + (x, y)
    count = len(cells)
    leaves: dict[str, Any] = {  # on the host
        "pose": np.column_stack([center, np.full(count, yaw)]).astype(np.float32),
        "half_size": ((high - low) / 2).astype(np.float32),
        "low": np.zeros(count, np.float32),
        "high": np.full(count, FLAT_M, np.float32),
        "blocks_base": np.ones(count, bool),
        "blocks_arm": np.zeros(count, bool),
        "bears_objects": np.zeros(count, bool),
    }
    return Boxes(**leaves)


def check_on_map(start: Float[np.ndarray, "3"], occupancy: OccupancyMap) -> None:
    """That a base pose is on the map, beyond whose frame nothing would stop the base.

    Raises:
        DocumentError: it isn't.
    """
    if not is_on_map(start, occupancy):
        (x, y, yaw), sides = occupancy.origin, occupancy.resolution * np.array(occupancy.closed.shape[::-1])
        size = f"{sides[0]:g} x {sides[1]:g} m from [{x:g}, {y:g}], turned by {yaw:g}"
        raise field_error("robot.start", f"{start.tolist()}, off the map", f"are poses on it, {size}")


def is_on_map(pose: Float[np.ndarray, "3"], occupancy: OccupancyMap) -> bool:
    """Whether a pose (x, y, yaw in W) is within a map's sides."""
    place = in_frame(np.array(occupancy.origin), pose[:2])
    return bool(np.all((place >= 0) & (place <= occupancy.resolution * np.array(occupancy.closed.shape[::-1]))))


def _read_image(path: Path) -> UInt8[np.ndarray, "rows columns channels"]:
    """Red, green, blue and, if the image has it, alpha; the first row is the highest."""
    from PIL import Image  # here and not above: few scenes have a map

    data = read_bytes(path, MAX_IMAGE_BYTES)
    try:
        with warnings.catch_warnings(action="ignore", category=Image.DecompressionBombWarning):
            image = Image.open(io.BytesIO(data), formats=("PPM", "PNG"))  # reads the header alone
        width, height = image.size
        if width * height > MAX_CELLS:
            raise field_error("", f"{width} x {height} cells", f"are up to {MAX_CELLS}")
        if image.mode not in ("L", "LA", "RGB", "RGBA") or ";16" in str(image.tile):
            raise field_error("", f"pixels of another kind ({image.mode})", "are 8 bits a channel, grey or in colour")
        if image.format == "PPM" and image.tile[0].codec_name != "ppm_plain":
            _check_all_read(data[image.tile[0].offset :], width * height * len(image.getbands()))
        return np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
    except Image.DecompressionBombError:
        raise field_error("", "more than 100 million cells", f"are up to {MAX_CELLS}") from None
    except DocumentError:
        raise
    except Exception:  # of damaged files Pillow says nearly anything
        raise field_error("", "no image that can be decoded", "are whole PGM and PNG files") from None


def _check_all_read(pixels: bytes, count: int) -> None:
    """That a PGM's or PPM's header speaks of all its pixels: Pillow takes as many as it says, and no notice of more."""
    if pixels[count:].strip():
        raise field_error("", f"{len(pixels)} bytes of pixels", f"are {count}, by the width and height in its header")


def _free(pixels: UInt8[np.ndarray, "rows columns channels"], fields: MapFields) -> Bool[np.ndarray, "rows columns"]:
    """Which pixels are cells that are known to be free."""
    averaged = pixels if fields.mode == "trinary" else pixels[..., :3]  # alpha is averaged in, in this mode alone
    total, most = averaged.sum(axis=-1, dtype=np.int32), 255 * averaged.shape[-1]
    shade: Float[np.ndarray, "rows columns"] = total / most
    if fields.mode == "raw":  # the value itself is the occupancy in percent, and beyond 100 unknown
        return np.rint(255 * shade) < 100 * fields.free_thresh
    occupancy = shade if fields.negate else 1.0 - shade
    free: Any = occupancy < fields.free_thresh
    if fields.mode == "trinary":
        return free & (total * 255 != _UNKNOWN * most)
    return free & (pixels[..., 3] == 255) if pixels.shape[-1] == 4 else free
