"""What the mouse does in the picture: drags objects and the start, selects them, and asks the floor."""

from dataclasses import dataclass

import numpy as np
import viser
from jaxtyping import Float

from basenet_jax.viewer.page import Page
from basenet_jax.viewer.pointing import Target, hit, meet_plane, pose_of
from basenet_jax.viewer.session import Session


@dataclass
class _Grip:
    """Where something was grabbed, and where it was dragged last."""

    target: Target
    height: float  # m, of the level plane in which the mouse then moves it
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
            place = meet_plane(camera, np.asarray(event.end_position) - camera, grip.height)
            if place is not None and tuple(place) != grip.place:  # letting go mostly tells of the last move again
                grip.place = tuple(place)
                self._move(grip.target, np.array([*(place + grip.offset), grip.yaw]))
        if event.phase == "end":
            self._grips.pop(event.client_id, None)

    def _grab(self, event: viser.SceneNodeDragEvent, target: Target) -> None:
        with self._page.lock:
            if self._page.timeline.time_s > 0.0:
                self._page.go_to(0.0)  # what was under the mouse may be elsewhere at the start: nothing is grabbed
                return
            if target.name is not None and target.name not in self._session.scene.names:
                return  # somebody else has just removed it
            pose = pose_of(self._session.scene, target)
            x, y, height = event.start_position
            self._grips[event.client_id] = _Grip(target, height, pose[:2] - (x, y), float(pose[2]))
            self._page.select(target)

    def _move(self, target: Target, pose: Float[np.ndarray, "3"]) -> None:
        try:
            if target.name is None:
                self._session.move_start(pose)
            else:
                self._session.move_object(target.name, pose)
        except ValueError as error:  # it stays at the last place where it can stand
            self._page.warn(str(error))

    async def _on_gizmo(self, event: viser.TransformControlsEvent) -> None:
        target = self._page.selected
        if target is None:
            return
        if event.phase == "update":
            self._move(target, self._page.gizmo.pose)
        elif event.phase == "end":
            self._page.select(target)  # the gizmo goes back to what it moves, should that not have followed

    def _on_click(self, event: viser.SceneClickEvent) -> None:
        target, floor = hit(self._session.scene, event.ray_origin, event.ray_direction)
        if floor is not None:
            self._session.ask(floor)
        elif self._page.timeline.time_s == 0.0:  # later, things are not where the scene has them
            self._page.select(target)
