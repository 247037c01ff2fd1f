"""What the mouse does in the picture: drags objects, furniture and the start, selects them, and asks the floor."""

from dataclasses import dataclass

import numpy as np
import viser
from jaxtyping import Float

from basenet_jax.viewer.page import Page
from basenet_jax.viewer.pointing import Target, hit, is_there, meet_plane, pose_of, surface_met
from basenet_jax.viewer.session import Session


@dataclass
class _Grip:
    """Where something was grabbed, and where it was dragged last."""

    client_id: int
    target: Target
    height: float  # m, of the level plane in which the mouse then moves it
    above: float | None  # m, of the place that was grabbed over the surface that an object stands on
    offset: Float[np.ndarray, "2"]  # from the mouse to its centre
    yaw: float
    place: tuple[float, float] | None = None  # m


class Mouse:
    """Turns the mouse's events into wishes of the session. All run on the server's event loop, in their order."""

    def __init__(self, server: viser.ViserServer, page: Page, session: Session):
        self._page, self._session = page, session
        self._grips: dict[int, _Grip] = {}  # by client
        page.gizmo.handle.on_update(self._on_gizmo)
        server.scene.on_click()(self._on_click)

    async def on_drag(self, event: viser.SceneNodeDragEvent, target: Target) -> None:
        """Something that can be moved is being dragged."""
        if event.phase == "start":
            self._grab(event, target)
        elif grip := self._grips.get(event.client_id):
            camera = np.asarray(event.client.camera.position)
            self._follow(grip, camera, np.asarray(event.end_position) - camera)
        if event.phase == "end":
            self._grips.pop(event.client_id, None)

    def _grab(self, event: viser.SceneNodeDragEvent, target: Target) -> None:
        with self._page.lock:
            if self._page.timeline.time_s > 0.0:
                self._page.go_to(0.0)  # what was under the mouse may be elsewhere at the start: nothing is grabbed
                return
            if not is_there(self._session.scene, target):
                return  # somebody else has just removed it
            pose = pose_of(self._session.scene, target)
            x, y, height = event.start_position
            scene, above = self._session.scene, None
            if target.name in scene.names:
                above = height - float(scene.arrays.surface_height[scene.names.index(target.name)])
            self._grips[event.client_id] = _Grip(
                event.client_id, target, height, above, pose[:2] - (x, y), float(pose[2])
            )
            self._page.select(target)

    def _follow(self, grip: _Grip, origin: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]) -> None:
        """Moves what was grabbed under the mouse: objects over the first surface there, all else in its plane."""
        met = None
        if grip.above is not None:
            met = surface_met(self._session.scene, origin, direction, grip.above, grip.offset)
        if met is not None:
            grip.height = float(self._session.scene.arrays.room.boxes.high[met[0]]) + (grip.above or 0.0)
        place = meet_plane(origin, direction, grip.height)
        if place is not None and tuple(place) != grip.place:  # letting go mostly tells of the last move again
            grip.place = tuple(place)
            pose = np.array([*(place + grip.offset), grip.yaw])
            self._move(grip.client_id, grip.target, pose, None if met is None else met[0])

    def _move(
        self, client_id: int | None, target: Target, pose: Float[np.ndarray, "3"], surface: int | None = None
    ) -> None:
        try:
            self._session.move(target.name, pose, surface)
        except ValueError as error:  # it stays at the last place where it can stand
            self._page.warn(client_id, str(error))

    async def _on_gizmo(self, event: viser.TransformControlsEvent) -> None:
        target = self._page.selected
        if target is None:
            return
        if event.phase == "update":
            self._move(event.client_id, target, self._page.gizmo.pose)
        elif event.phase == "end":
            self._page.select(target)  # the gizmo goes back to what it moves, should that not have followed

    def _on_click(self, event: viser.SceneClickEvent) -> None:
        target, floor = hit(self._session.scene, event.ray_origin, event.ray_direction)
        if floor is not None:
            self._session.ask(floor)
        elif self._page.timeline.time_s == 0.0:  # later, things are not where the scene has them
            self._page.select(target)
