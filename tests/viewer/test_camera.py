"""At first one sees all of a scene, whatever the window; and nobody looks from below the floor."""

import asyncio
import contextlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from basenet_jax.viewer import camera
from basenet_jax.viewer.drawing import extents


def seen(position, look_at, points, width, height):
    """Pixels of points by a camera that is upright, as three.js has it: an oracle of the projection."""
    ahead = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    away = points - position
    scale = 0.5 * height / np.tan(camera._FIELD / 2) / (away @ ahead)
    return np.stack([width / 2 + scale * (away @ right), height / 2 - scale * (away @ np.cross(right, ahead))], axis=-1)


@pytest.mark.parametrize("window", [(1000, 700), (1280, 800), (1920, 1080), (900, 600), (700, 900)])
@pytest.mark.parametrize("which", ["scene", "room"])
def test_all_of_a_scene_is_beside_the_panel(request, which, window):
    scene, (width, height) = request.getfixturevalue(which), window
    position, look_at = camera.whole_scene(scene, width, height)
    low, high = extents(scene)
    corners = np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (0.0, 1.0)])
    pixels = seen(position, look_at, corners, width, height)
    free = width - camera.PANEL_PX
    assert np.all((pixels >= 0.0) & (pixels <= (free, height)))
    assert np.max(np.ptp(pixels, axis=0) / (free, height)) > 0.85, "it is looked at from too far away"
    start = np.array([*scene.arrays.robot_start[:2], 0.5])
    assert np.all(seen(position, look_at, start, width, height) <= (free, height))


class Camera(SimpleNamespace):
    """As viser's: a new position takes along what is looked at."""

    def __setattr__(self, name, value):
        if name == "position" and hasattr(self, "look_at"):
            super().__setattr__("look_at", np.array(self.look_at) + np.array(value) - np.array(self.position))
        super().__setattr__(name, np.array(value) if name in ("position", "look_at") else value)


def page_of(position, look_at, width=700, height=900):
    client = SimpleNamespace(atomic=contextlib.nullcontext)
    return Camera(client=client, image_width=width, image_height=height, position=position, look_at=look_at)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (((1.0, -3.0, -0.5), (0.0, 0.0, 0.4)), ((1.0, -3.0, 0.1), (0.0, 0.0, 0.4))),
        (((1.0, -3.0, 2.0), (0.0, 0.0, -1.0)), ((1.0, -3.0, 2.0), (0.0, 0.0, 0.0))),
        (((1.0, -3.0, 2.0), (0.0, 0.0, 0.0)), ((1.0, -3.0, 2.0), (0.0, 0.0, 0.0))),
    ],
)
def test_a_camera_stays_above_the_floor(before, after):
    kept, first, moved = camera.KeptAbove(), page_of((0.0, -3.0, 3.0), (0.0, 0.0, 0.0)), page_of(*before)
    for page in (first, moved):
        asyncio.run(kept.put_back(page))  # pyright: ignore[reportArgumentType]
    np.testing.assert_allclose([moved.position, moved.look_at], after, atol=1e-12)


def test_the_camera_before_a_page_is_given_its_first_is_left_alone():
    """It stands on the floor; where it is put back, the page keeps it."""
    kept, early = camera.KeptAbove(), page_of((-5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    asyncio.run(kept.put_back(early))  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(early.position, (-5.0, 0.0, 0.0))


def test_a_page_shows_all_at_first_and_then_what_its_owner_looks_at(scene):
    first = SimpleNamespace()
    server: Any = SimpleNamespace(initial_camera=first, on_client_connect=lambda _: None)
    cameras = camera.Cameras(server, scene)
    new, used = page_of(first.position, first.look_at), page_of((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    for page in (new, used, new):
        asyncio.run(cameras._fit(page))  # pyright: ignore[reportArgumentType]
    position, look_at = camera.whole_scene(scene, 700.0, 900.0)
    np.testing.assert_allclose([new.position, new.look_at], [position, look_at])
    np.testing.assert_allclose(used.position, (1.0, 2.0, 3.0))
