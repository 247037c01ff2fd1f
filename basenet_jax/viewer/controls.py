"""What the panel's controls do."""

import threading
from collections.abc import Callable
from typing import Any

import jax
import viser

from basenet_jax import api
from basenet_jax.config import WorldConfig
from basenet_jax.viewer import uploads, words
from basenet_jax.viewer.page import Page
from basenet_jax.viewer.panel import NO_PLANNER, SPEEDS, Panel
from basenet_jax.viewer.planned import Planned
from basenet_jax.viewer.pointing import Target
from basenet_jax.viewer.session import Session
from basenet_jax.world.generate_rooms import draw_room
from basenet_jax.world.scene import NamedScene

Event = viser.GuiEvent[Any]
_REFUSED = "That can't be done"
_NOTICE_S = 12.0  # that a message about one person's file stays


class Controls:
    """Turns the panel's events into wishes of session and page.

    Args:
        panel: with the controls.
        page: with the timeline.
        session: with the rest.
        seed: of the first random scene.
    """

    def __init__(self, panel: Panel, page: Page, session: Session, seed: int):
        self._panel, self._page, self._session, self._seed = panel, page, session, seed
        self._drawing = threading.Lock()
        panel.planner.on_update(self._when(self._choose))
        panel.second.on_update(self._when(self._choose))
        panel.play.on_click(self._when(self._play))
        panel.time.on_update(self._when(lambda _: page.go_to(panel.time.value)))
        panel.speed.on_update(self._when(self._set_speed))
        panel.selected.on_update(self._when(self._select))
        panel.add.on_click(self._when(self._add))
        panel.add_piece.on_click(self._when(self._add_piece))
        panel.remove.on_click(self._when(self._remove))
        panel.forget.on_click(self._when(lambda _: session.ask(None)))
        panel.random.on_click(self._when(self._draw_scene))
        panel.download_scene.on_click(self._when(self._download_scene))
        panel.download_plan.on_click(self._when(self._download_plan))
        panel.shadows.on_update(self._when(lambda _: page.surroundings.cast_shadows(panel.shadows.value)))

    def _when(self, act: Callable[[Event], object]) -> Callable[[Event], None]:
        """Acts on what somebody did, and tells that person if it can't be done."""

        def callback(event: Event) -> None:
            if event.client is None:  # not a person: the page itself has set the value
                return
            try:
                act(event)
            except ValueError as error:
                event.client.add_notification(_REFUSED, str(error), auto_close_seconds=_NOTICE_S, color="red")

        return callback

    def _choose(self, _: Event) -> None:
        names = (self._panel.planner.value, self._panel.second.value)
        self._session.choose(*(name for name in names if name != NO_PLANNER))

    def _play(self, _: Event) -> None:
        with self._page.lock:
            timeline = self._page.timeline
            if timeline.playing:
                timeline.pause()
            else:
                timeline.play()
            self._page.show_time(timeline.time_s)

    def _set_speed(self, _: Event) -> None:
        self._page.timeline.speed = SPEEDS[self._panel.speed.value]

    def _select(self, _: Event) -> None:
        name = self._panel.selected.value
        self._page.select(None if name == words.NOTHING else Target(None if name == words.START else name))

    def _add(self, _: Event) -> None:
        self._page.select(Target(self._session.add_object(self._panel.kind.value)))

    def _add_piece(self, _: Event) -> None:
        self._page.select(Target(self._session.add_piece(self._panel.piece.value)))

    def _remove(self, _: Event) -> None:
        target = self._page.selected
        if target is not None and target.name is not None:
            self._session.remove(target.name)

    def _draw_scene(self, _: Event) -> None:
        with self._drawing:
            self._seed += 1
            scene, world = self._session.scene, self._session.world
            self._page.show_status("drawing a scene")  # the first of a size is compiled for
            try:
                drawn = draw_like(scene, self._seed, world)
            finally:
                self._page.show_status("")
        self._session.replace_scene(drawn)

    def open_scene(self, name: str, content: bytes) -> str | None:
        """Goes on with the scene of a file; what its owner should know of it is returned.

        Raises:
            ValueError: it holds no valid scene.
        """
        self._session.upload_scene(name, content)
        other = self._session.scene.written_for
        return f"{name} names {other}; the robot of the command line is used instead" if other else None

    def open_plan(self, name: str, content: bytes) -> None:
        """Shows the plan of a file.

        Raises:
            ValueError: it holds no plan of this scene.
        """
        self._session.upload_plan(name, content)

    def _download_scene(self, event: Event) -> None:
        _send(event, "scene.yaml", uploads.scene_file(self._session.scene))

    def _download_plan(self, event: Event) -> None:
        plans = self._session.plans
        if not plans or not isinstance(plans[0], Planned) or plans[0].scene is not self._session.scene:
            raise ValueError("there is no plan of this scene to save, or not yet")
        _send(event, "plan.json", uploads.plan_file(plans[0]))


def draw_like(scene: NamedScene, seed: int, world: WorldConfig) -> NamedScene:
    """A random scene of the same kind, table or room, with as many objects and the same robot.

    Raises:
        ValueError: so many objects find no place.
    """
    if scene.furniture is None:
        return api.sample_scene(jax.random.key(seed), objects=len(scene.names), robot=scene.robot, world=world)
    return draw_room(seed, len(scene.names), robot=scene.robot, config=world.scene)


def _send(event: Event, name: str, content: bytes) -> None:
    if event.client is not None:
        event.client.send_file_download(name, content, save_immediately=True)
