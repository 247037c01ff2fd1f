"""A headless Chromium in front of a running viewer: pages, and the mouse where points of the scene are seen."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    import viser
    from playwright.sync_api import Page

    from basenet_jax.viewer.app import Viewer

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
# There is no screen: WebGL is drawn by software, Mesa's where there is one (twice as fast as the browser's own).
ARGUMENTS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=gl-egl",
    "--ignore-gpu-blocklist",
    "--enable-unsafe-swiftshader",
)
DRAWN_MS = 3_000  # after which that has drawn all


def find_chromium() -> str:
    """The browser's program.

    Raises:
        RuntimeError: there is none.
    """
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        raise RuntimeError(f"no browser found, needed is one of {', '.join(NAMES)} (Debian: apt-get install chromium)")
    return found


@contextmanager
def page_of(viewer: "Viewer", width: int, height: int) -> Iterator["Page"]:
    """A page of this size (pixels) with a running viewer in it, once its first pictures are drawn.

    Raises:
        RuntimeError: there is no browser.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=list(ARGUMENTS))
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(viewer.url)
        page.get_by_text("N + G").wait_for()
        page.locator(".mantine-Notification-closeButton").click()  # it tells of drawing by software
        page.wait_for_timeout(DRAWN_MS)
        yield page
        browser.close()


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


def drag(
    page: "Page", start: tuple[float, float], end: tuple[float, float], *, moves: int = 4, move_ms: float = 0.0
) -> None:
    """Drags with the left button from pixel to pixel, as a hand would: in a few moves, each of which takes a while."""
    page.mouse.move(*start)
    page.mouse.down()
    for share in np.linspace(0.0, 1.0, moves + 1)[1:]:
        page.wait_for_timeout(move_ms)
        page.mouse.move(*(np.asarray(start) + share * np.subtract(end, start)))
    page.mouse.up()
