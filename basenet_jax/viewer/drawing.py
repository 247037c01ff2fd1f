"""What doesn't move on the page: floor, table, lights and camera; and the page's colours."""

import numpy as np
import viser
from jaxtyping import Bool, Float, UInt8

from basenet_jax.plots.drawing import CLASS_COLORS, rectangle, to_world
from basenet_jax.world.boxes import Room
from basenet_jax.world.furniture import MAP
from basenet_jax.world.occupancy_map import OccupancyMap
from basenet_jax.world.scene import NamedScene

Color = tuple[int, int, int]
START_COLOR: Color = (0, 114, 178)
PLAN_COLORS: tuple[Color, Color] = ((0, 114, 178), (150, 60, 190))  # of the plan, and of the one it is compared with
WOOD: Color = (205, 170, 125)
WOOD_BELOW: Color = (150, 125, 95)
SOLID: Color = (160, 164, 170)
KEEP_OUT: Color = (200, 90, 70)
_LINE: Color = (215, 214, 208)
_RIM: Color = (120, 120, 120)
_CLOSED: Color = (118, 122, 128)  # cells of a map
_FLOOR_M, _FLOOR_CELL_M = 6.0, 1.0  # from the paper's table to the floor's sides; the floor's squares
_BEYOND_M = 1.0  # from what stands on it to the floor's sides in rooms without bounds
_MOST_PIXELS = 2048  # along a side of a map's picture


def rgb(text: str) -> Color:
    """A colour such as #D55E00."""
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def css(color: Color) -> str:
    """The same as a style sheet writes it."""
    return "#" + bytes(color).hex()


def class_color(index: int) -> Color:
    """Of an object's class; -1: of the user's own."""
    return rgb(CLASS_COLORS[index])


class Surroundings:
    """Floor and lights: plain at first, which a computer without a graphics card draws several times faster.

    Args:
        scene: to draw in.
    """

    def __init__(self, scene: viser.SceneApi):
        self._scene = scene
        self._ambient = scene.add_light_ambient("/light", intensity=1.2)
        thin = {"thickness": 1.5, "thickness_units": "screen"}
        self._lines = scene.add_line_segments("/lines", np.zeros((1, 2, 3)), _LINE, **thin)
        self._rim = scene.add_line_segments("/rim", np.zeros((1, 2, 3)), _RIM, visible=False, **thin)
        self._floor = scene.add_grid(
            "/floor",
            cell_size=_FLOOR_CELL_M,
            cell_color=_LINE,
            section_size=_FLOOR_CELL_M,
            section_color=_LINE,
            plane_color=(243, 242, 238),
            plane_opacity=1.0,
        )
        self._map: viser.ImageHandle | None = None
        self.cast_shadows(False)

    def show(self, scene: NamedScene) -> None:
        """The floor of a scene: as large as what stands on it, its bounds, and its map."""
        low, high = floor_of(scene)
        self._lines.points = floor_lines(low, high)
        self._floor.width, self._floor.height = (high - low).tolist()
        self._floor.position = (*((low + high) / 2).tolist(), 0.0)
        bounds = np.asarray(scene.arrays.room.floor, float)
        self._rim.visible = bool(np.all(np.isfinite(bounds)))
        if self._rim.visible:
            corners = np.array([bounds[[0, 1]], bounds[[2, 1]], bounds[[2, 3]], bounds[[0, 3]]])
            self._rim.points = _level(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1), 0.002)
        if self._map is not None:
            self._map.remove()
            self._map = None
        if scene.map is not None:
            self._show_map(scene.map)

    def _show_map(self, occupancy: OccupancyMap) -> None:
        x, y, yaw = occupancy.origin
        rows, columns = occupancy.closed.shape
        size = occupancy.resolution * np.array([columns, rows])
        center = to_world((x, y, yaw), size[None] / 2)[0]
        self._map = self._scene.add_image(
            "/map",
            map_picture(occupancy.closed),
            *size.tolist(),
            cast_shadow=False,
            position=(float(center[0]), float(center[1]), 0.001),
            wxyz=(np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)),
        )

    def cast_shadows(self, shadows: bool) -> None:
        """A floor, shadows on it and reflections; or lines and plain light."""
        self.shadows = shadows
        around = "warehouse" if shadows else None
        self._scene.configure_environment_map(around, background=False, environment_intensity=0.4)
        self._scene.configure_default_lights(cast_shadow=shadows)
        self._floor.visible = shadows
        self._ambient.visible = self._lines.visible = not shadows


def floor_of(scene: NamedScene) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """The least and the greatest x, y (m) of the floor that is drawn, in whole squares."""
    if scene.furniture is None:
        return np.full(2, -_FLOOR_M), np.full(2, _FLOOR_M)
    low, high = extents(scene)
    return np.floor(low / _FLOOR_CELL_M) * _FLOOR_CELL_M, np.ceil(high / _FLOOR_CELL_M) * _FLOOR_CELL_M


def extents(scene: NamedScene) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """The least and the greatest x, y (m) of the floor's bounds, or of what stands in a room; a map doesn't count."""
    boxes, bounds = scene.arrays.room.boxes, np.asarray(scene.arrays.room.floor, float)
    if np.all(np.isfinite(bounds)):
        return bounds[:2], bounds[2:]
    written = [index for index, name in enumerate(scene.box_names) if name != MAP]
    corners = [rectangle(boxes.pose[index], boxes.half_size[index]) for index in written]
    points = np.concatenate([*corners, np.asarray(scene.arrays.robot_start, float)[None, :2]])
    return np.min(points, axis=0) - _BEYOND_M, np.max(points, axis=0) + _BEYOND_M


def floor_lines(low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> Float[np.ndarray, "L 2 3"]:
    """Of a square grid, in both directions."""
    lines = []
    for axis in (0, 1):
        along = np.arange(low[axis], high[axis] + _FLOOR_CELL_M / 2, _FLOOR_CELL_M)
        ends = np.array([low[1 - axis], high[1 - axis]])
        pairs = np.stack(np.broadcast_arrays(along[:, None], ends), axis=-1)
        lines.append(pairs if axis == 0 else pairs[..., ::-1])
    return _level(np.concatenate(lines), 0.0)


def map_picture(closed: Bool[np.ndarray, "rows columns"]) -> UInt8[np.ndarray, "height width 4"]:
    """Closed cells in grey, free ones clear; of large maps, a pixel stands for several cells, any of them."""
    step = -(-max(closed.shape) // _MOST_PIXELS)
    padded = np.pad(closed, [(0, -side % step) for side in closed.shape])
    blocks = padded.reshape(padded.shape[0] // step, step, padded.shape[1] // step, step)
    pixels = np.zeros((*blocks.shape[::2], 4), np.uint8)
    pixels[np.any(blocks, axis=(1, 3))] = (*_CLOSED, 255)
    return pixels


def _level(points: Float[np.ndarray, "*batch 2"], height: float) -> Float[np.ndarray, "*batch 3"]:
    return np.concatenate([points, np.full((*points.shape[:-1], 1), height)], axis=-1)


def draw_table(scene: viser.SceneApi, room: Room | None) -> None:
    """The paper's table: its top and the block below; None: there is none."""
    if room is None:
        scene.remove_by_name("/table")
        return
    length, width = (2.0 * np.asarray(room.table_half_size, float)).tolist()
    height, top = float(room.table_height), 0.04
    scene.add_box("/table/top", WOOD, (length, width, top), position=(0.0, 0.0, height - top / 2))
    inset, low = 0.06, height - top
    size = (length - inset, width - inset, low)
    scene.add_box("/table/block", WOOD_BELOW, size, position=(0.0, 0.0, low / 2))
