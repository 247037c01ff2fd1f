"""What doesn't move on the page: floor, table, lights and camera; and the page's colours."""

import numpy as np
import viser
from jaxtyping import Float

from basenet_jax.plots.drawing import CLASS_COLORS
from basenet_jax.world.boxes import Room

Color = tuple[int, int, int]
START_COLOR: Color = (0, 114, 178)
PLAN_COLORS: tuple[Color, Color] = ((0, 114, 178), (150, 60, 190))  # of the plan, and of the one it is compared with
_WOOD: Color = (205, 170, 125)
_LINE: Color = (215, 214, 208)
_FLOOR_M, _FLOOR_CELL_M = 12.0, 1.0  # sides of the floor and of its squares


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
        self._lines = scene.add_line_segments("/lines", _floor_lines(), _LINE, thickness=1.5, thickness_units="screen")
        self._floor = scene.add_grid(
            "/floor",
            _FLOOR_M,
            _FLOOR_M,
            cell_size=_FLOOR_CELL_M,
            cell_color=_LINE,
            section_size=_FLOOR_M,
            section_color=_LINE,
            plane_color=(243, 242, 238),
            plane_opacity=1.0,
        )
        self.cast_shadows(False)

    def cast_shadows(self, shadows: bool) -> None:
        """A floor, shadows on it and reflections; or lines and plain light."""
        self.shadows = shadows
        around = "warehouse" if shadows else None
        self._scene.configure_environment_map(around, background=False, environment_intensity=0.4)
        self._scene.configure_default_lights(cast_shadow=shadows)
        self._floor.visible = shadows
        self._ambient.visible = self._lines.visible = not shadows


def _floor_lines() -> Float[np.ndarray, "L 2 3"]:
    """Of a square grid about the origin, in both directions."""
    half = _FLOOR_M / 2
    along = np.arange(-half, half + _FLOOR_CELL_M / 2, _FLOOR_CELL_M)
    ends = np.array([-half, half])
    one_way = np.stack(np.broadcast_arrays(along[:, None], ends, 0.0), axis=-1)
    return np.concatenate([one_way, one_way[..., [1, 0, 2]]])


def place_camera(camera: viser.InitialCameraConfig) -> None:
    """Where everybody looks from at first."""
    camera.position, camera.look_at, camera.fov = (0.75, -3.7, 6.4), (0.75, -0.05, 0.1), np.radians(42.0)


def draw_table(scene: viser.SceneApi, room: Room) -> None:
    """The table top and its block below."""
    length, width = (2.0 * np.asarray(room.table_half_size, float)).tolist()
    height, top = float(room.table_height), 0.04
    scene.add_box("/table/top", _WOOD, (length, width, top), position=(0.0, 0.0, height - top / 2))
    inset, low = 0.06, height - top
    size = (length - inset, width - inset, low)
    scene.add_box("/table/block", (150, 125, 95), size, position=(0.0, 0.0, low / 2))
