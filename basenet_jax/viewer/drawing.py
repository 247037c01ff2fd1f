"""What doesn't move on the page: floor, table, light and camera; and the page's colours."""

import numpy as np
import viser

from basenet_jax.plots.drawing import CLASS_COLORS
from basenet_jax.world.scene import Table

Color = tuple[int, int, int]
START_COLOR: Color = (0, 114, 178)
PLAN_COLORS: tuple[Color, Color] = ((0, 114, 178), (150, 60, 190))  # of the plan, and of the one it is compared with
_WOOD: Color = (205, 170, 125)


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


def draw_surroundings(server: viser.ViserServer, table: Table) -> None:
    """Floor and table, and where the camera stands at first."""
    scene = server.scene
    scene.configure_environment_map("warehouse", background=False, environment_intensity=0.4)
    scene.add_grid(
        "/floor",
        12.0,
        12.0,
        cell_size=0.5,
        cell_color=(226, 225, 220),
        section_size=1.0,
        section_color=(205, 203, 196),
        plane_color=(243, 242, 238),
        plane_opacity=1.0,
    )
    draw_table(scene, table)
    camera = server.initial_camera
    camera.position, camera.look_at, camera.fov = (0.75, -3.7, 6.4), (0.75, -0.05, 0.1), np.radians(42.0)


def draw_table(scene: viser.SceneApi, table: Table) -> None:
    """The table top and its block below."""
    length, width = (2.0 * np.asarray(table.half_size, float)).tolist()
    height, top = float(table.height), 0.04
    scene.add_box("/table/top", _WOOD, (length, width, top), position=(0.0, 0.0, height - top / 2))
    inset, low = 0.06, height - top
    size = (length - inset, width - inset, low)
    scene.add_box("/table/block", (150, 125, 95), size, position=(0.0, 0.0, low / 2))
