"""A headless Chromium in front of a running viewer: pages, and the mouse where points of the scene are seen."""

import shutil
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    import viser
    from playwright.sync_api import Page

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
# WebGL by software, as there is no screen.
ARGUMENTS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def find_chromium() -> str:
    """The browser's program.

    Raises:
        RuntimeError: there is none.
    """
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        raise RuntimeError(f"no browser found, needed is one of {', '.join(NAMES)} (Debian: apt-get install chromium)")
    return found


def where_seen(camera: "viser.CameraHandle", point: ArrayLike, page: "Page") -> tuple[float, float]:
    """The pixel of a page at which a point (m, in W) is seen by that page's camera."""
    forward = camera.look_at - camera.position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, camera.up_direction)
    right = right / np.linalg.norm(right)
    offset, size = np.asarray(point) - camera.position, page.viewport_size
    assert size is not None
    width, height = size["width"], size["height"]
    scale = 0.5 * height / (np.tan(0.5 * camera.fov) * (offset @ forward))
    up = np.cross(right, forward)
    return float(0.5 * width + scale * (offset @ right)), float(0.5 * height - scale * (offset @ up))


def drag(page: "Page", start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drags with the left button from pixel to pixel, as a hand would: in a few moves."""
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=4)
    page.mouse.up()
