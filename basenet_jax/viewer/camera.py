"""Where the page looks from: at all of a scene, beside the panel, and never from below the floor."""

import numpy as np
import viser
from jaxtyping import Float

from basenet_jax.viewer.drawing import extents
from basenet_jax.world.scene import NamedScene

PANEL_PX = 340.0  # that the panel covers on the right
_FIELD = np.radians(42.0)  # of view, from top to bottom
_ELEVATION = np.radians(60.0)  # from which one looks down
_RIM = 0.03  # of the window that stays empty on each side
_HIGH_M = 1.2  # up to which things stand that are to be seen whole
_LOWEST_M = 0.1  # of the camera over the floor
_NEAREST_M, _FARTHEST_M = 1.0, 1e4
_HALVINGS = 40
_SAME_M = 0.01  # what rounding on the way to a page and back may take
_WINDOW = (1280.0, 800.0)  # pixels


class Cameras:
    """The cameras of all pages.

    Args:
        server: of the pages.
        scene: to look at first.
    """

    def __init__(self, server: viser.ViserServer, scene: NamedScene):
        self._server = server
        server.initial_camera.fov = _FIELD
        self._set_first(scene)
        server.on_client_connect(self._welcome)

    def look_at(self, scene: NamedScene) -> None:
        """Has all pages look at another scene."""
        self._set_first(scene)
        for client in self._server.get_clients().values():
            self._show_all(client.camera)

    def _set_first(self, scene: NamedScene) -> None:
        """What a page has before the size of its window is known, and goes back to."""
        first = self._server.initial_camera
        first.position, first.look_at = whole_scene(scene, *_WINDOW)
        self._scene, self._first = scene, np.array(first.position)

    async def _welcome(self, client: viser.ClientHandle) -> None:
        client.camera.on_update(KeptAbove().put_back)
        client.camera.on_update(self._fit)

    async def _fit(self, camera: viser.CameraHandle) -> None:
        """Shows all to a page that is new, or goes back to how it was; its camera is the first one then."""
        place, _ = self._whole_scene(camera)
        if np.allclose(camera.position, self._first, atol=_SAME_M) and not np.allclose(
            place, self._first, atol=_SAME_M
        ):
            self._show_all(camera)

    def _show_all(self, camera: viser.CameraHandle) -> None:
        place, middle = self._whole_scene(camera)
        with camera.client.atomic():
            camera.position = place
            camera.look_at = middle

    def _whole_scene(self, camera: viser.CameraHandle) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        return whole_scene(self._scene, float(camera.image_width), float(camera.image_height))


def whole_scene(
    scene: NamedScene, width: float, height: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Where the camera is (m), and a place that it looks at, for all of a scene to be seen from the south.

    Args:
        scene: its room counts, or the table and where the robot starts.
        width: of the window, of which the panel takes a part (pixels).
        height: likewise.
    """
    low, high = extents(scene)
    corners = np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (0.0, _HIGH_M)])
    middle = np.array([*(low + high) / 2, 0.0])
    ahead = np.array([0.0, np.cos(_ELEVATION), -np.sin(_ELEVATION)])
    up = np.array([0.0, np.sin(_ELEVATION), np.cos(_ELEVATION)])
    seen = np.stack([corners[:, 0] - middle[0], (corners - middle) @ up], axis=-1)
    depth, tangent = (corners - middle) @ ahead, np.tan(_FIELD / 2)
    panel = PANEL_PX if width > 2.0 * PANEL_PX else 0.0  # narrow windows have it below
    sides = np.array([(-width, width - 2.0 * panel), (-height, height)]) * (1.0 - 2.0 * _RIM) / height

    def shifts(distance: float) -> Float[np.ndarray, "2 2"]:
        """How far right and up the camera is at least and at most (m)."""
        scale = (tangent * (depth + distance))[:, None]
        return np.stack([np.max(seen - scale * sides[:, 1], axis=0), np.min(seen - scale * sides[:, 0], axis=0)])

    near, far = max(_NEAREST_M, _NEAREST_M - float(np.min(depth))), _FARTHEST_M
    for _ in range(_HALVINGS):
        half = (near + far) / 2
        least, most = shifts(half)
        near, far = (near, half) if np.all(least <= most) else (half, far)
    right, higher = np.mean(shifts(far), axis=0)
    position = middle - far * ahead + right * np.array([1.0, 0.0, 0.0]) + higher * up
    return position, position + ahead * (position[2] / -ahead[2])


class KeptAbove:
    """Puts back a page's camera that has gone below the floor, or looks at something below.

    A page may tell of the camera that it has before it is given its first one: on the floor. That one is left alone, or
    the first would be lost.
    """

    def __init__(self):
        self._was_above = False

    async def put_back(self, camera: viser.CameraHandle) -> None:
        """After each move of the page's camera."""
        position, middle = np.array(camera.position), np.array(camera.look_at)
        if position[2] >= _LOWEST_M and middle[2] >= 0.0:
            self._was_above = True
        elif self._was_above:
            with camera.client.atomic():
                camera.position = (*position[:2], max(position[2], _LOWEST_M))
                camera.look_at = (*middle[:2], max(middle[2], 0.0))
