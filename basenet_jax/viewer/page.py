"""The page: it draws what the session knows, and plays it."""

from collections.abc import Callable, Coroutine
from contextlib import AbstractContextManager

import numpy as np
import viser

from basenet_jax.robot.reading import load_robot
from basenet_jax.viewer import words
from basenet_jax.viewer.asking import Answer
from basenet_jax.viewer.bodies import Bodies
from basenet_jax.viewer.camera import Cameras
from basenet_jax.viewer.drawing import PLAN_COLORS, Surroundings, draw_table
from basenet_jax.viewer.execution import Execution
from basenet_jax.viewer.furnishing import pieces
from basenet_jax.viewer.furniture_view import FurnitureViews
from basenet_jax.viewer.marks import Gizmo, PlaceMark, StartPlate
from basenet_jax.viewer.object_view import ObjectViews
from basenet_jax.viewer.panel import Panel
from basenet_jax.viewer.plan_view import PlanView
from basenet_jax.viewer.planned import Awaited, Planned, Shown
from basenet_jax.viewer.pointing import Target, height_of, is_there, pose_of
from basenet_jax.viewer.robot_view import RobotView
from basenet_jax.viewer.timeline import Timeline
from basenet_jax.viewer.visitors import Visitors
from basenet_jax.world.boxes import fingerprint
from basenet_jax.world.scene import NamedScene

OnDrag = Callable[[viser.SceneNodeDragEvent, Target], Coroutine[None, None, None]]


class Page:
    """What every browser shows; a `Screen` of the session.

    Args:
        server: of the pages.
        panel: beside the picture.
        lock: held by whoever draws.
        scene: the first one.
    """

    def __init__(self, server: viser.ViserServer, panel: Panel, lock: AbstractContextManager, scene: NamedScene):
        self._server, self._panel, self.lock = server, panel, lock
        self.timeline = Timeline(self.show_time, lock)
        self.selected: Target | None = None
        self.visitors: Visitors | None = None
        self.on_drag: OnDrag | None = None  # told of all drags of what can be moved
        self._executions: list[Execution | None] = [None, None]  # of the plan, and of the one it is compared with
        api = server.scene
        self.surroundings = Surroundings(api)
        self._furniture = FurnitureViews(api, lambda box, name: self._bind(box, Target(name)))
        self._cameras = Cameras(server, scene)
        self._objects = ObjectViews(api, lambda box, name: self._bind(box, Target(name)))
        self._plans = [PlanView(api, f"/plan{index}", color, index) for index, color in enumerate(PLAN_COLORS)]
        self._mark, self.gizmo = PlaceMark(api), Gizmo(api)
        self._scene = scene
        self._use_robot(scene)
        self._show_room(scene)

    def show_scene(self, scene: NamedScene, *, new: bool) -> None:
        """See `Screen`: objects stand on their surfaces, the robot at its start."""
        with self.lock, self._server.atomic():
            if load_robot(scene.robot) is not self._robot:  # another one, or its file has changed
                self._remove_robot()
                self._use_robot(scene)
            if not _same_room(scene, self._scene):
                self._show_room(scene)
            self._scene = scene
            self._executions[:] = [None, None]
            self._rest()
            self.select(self.selected)
            if new:
                self._cameras.look_at(scene)
            self._panel.show_names(scene.names, tuple(pieces(scene.furniture)))
            if self.visitors is not None:
                self.visitors.withdraw_warnings()

    def show_plans(self, plans: tuple[Shown, ...]) -> None:
        """See `Screen`; sent at once."""
        if any(isinstance(plan, Planned) and plan.scene.robot != self._scene.robot for plan in plans):
            return  # the robot was changed meanwhile
        with self.lock, self._server.atomic():
            if self.timeline.time_s > 0.0:
                self._rest()
            for index, plan in enumerate((*plans, None)[:2]):
                if not isinstance(plan, Awaited) or not plan.keep:
                    self._show_plan(index, plan if isinstance(plan, Planned) else None)
            self._views[1].set_visible(len(plans) > 1)
            self.timeline.end_s = max((each.end_s for each in self._executions if each), default=0.0)
            self._panel.show_figures(plans)
            self._panel.show_end(self.timeline.end_s)
        self._server.flush()

    def _show_plan(self, index: int, plan: Planned | None) -> None:
        self._plans[index].show(self._robot, plan)
        self._executions[index] = None if plan is None else Execution(plan, self._robot, self._bodies)
        if index == 0:
            self._objects.label({} if plan is None else words.labels(plan))

    def show_answer(self, answer: Answer | None) -> None:
        """See `Screen`."""
        with self.lock, self._server.atomic():
            self._mark.show(None if answer is None else answer.base_pose, np.asarray(self._robot.footprint_half_size))
            self._panel.show_answer(answer)

    def show_status(self, text: str) -> None:
        """See `Screen`."""
        with self.lock:
            self._panel.show_status(text)

    def show_time(self, time_s: float) -> None:
        """Robots and objects as they are at a time (s) of the plans."""
        with self.lock, self._server.atomic():
            for view, execution in zip(self._views, self._executions, strict=True):
                if execution is not None:
                    view.show(*execution.robot_at(time_s))
            if (first := self._executions[0]) is not None:
                self._objects.place(first.objects_at(time_s))
                self._panel.show_doing(words.doing(first.planned, time_s))
            self._show_gizmo()
            self._panel.show_time(time_s, playing=self.timeline.playing)

    def go_to(self, time_s: float) -> None:
        """Stands still at a time (s)."""
        with self.lock:
            self.timeline.go_to(time_s)
            self.show_time(self.timeline.time_s)

    def select(self, target: Target | None) -> None:
        """Puts the gizmo on what was chosen; nothing if it isn't there any more."""
        with self.lock:
            self.selected = target if target is not None and is_there(self._scene, target) else None
            self._show_gizmo()
            self._panel.show_selected(None if self.selected is None else self.selected.name or words.START)

    def warn(self, client_id: int | None, text: str) -> None:
        """Tells one person why something was not done; until the next change."""
        with self.lock:
            if self.visitors is not None:
                self.visitors.warn(client_id, text)

    def _rest(self) -> None:
        """Everything as it is before the plan begins."""
        self.timeline.go_to(0.0)
        self._objects.show(self._scene)
        start, home = np.asarray(self._scene.arrays.robot_start, float), np.asarray(self._robot.home)
        self._plate.move(start)
        for view in self._views:
            view.show(start, home)
        self._panel.show_time(0.0, playing=False)
        self._panel.show_doing("")

    def _show_gizmo(self) -> None:
        target = self.selected
        if target is None or self.timeline.time_s > 0.0:
            self.gizmo.show(None)
            return
        self.gizmo.show((pose_of(self._scene, target), height_of(self._scene, target)))

    def _show_room(self, scene: NamedScene) -> None:
        self.surroundings.show(scene)
        self._furniture.show(scene)
        draw_table(self._server.scene, scene.arrays.room if scene.furniture is None else None)

    def _bind(self, handle: viser.BoxHandle | viser.MeshHandle, target: Target) -> None:
        async def on_drag(event: viser.SceneNodeDragEvent) -> None:
            if self.on_drag is not None:
                await self.on_drag(event, target)

        handle.on_drag(on_drag)

    def _use_robot(self, scene: NamedScene) -> None:
        self._robot = load_robot(scene.robot)
        self._bodies = Bodies(self._robot)
        api, ghost = self._server.scene, PLAN_COLORS[1]
        self._views = [RobotView(api, "/robot0", self._bodies), RobotView(api, "/robot1", self._bodies, ghost)]
        self._views[1].set_visible(False)
        self._plate = StartPlate(api, self._robot)
        for handle in (self._plate.handle, *self._views[0].base_meshes):
            self._bind(handle, Target(None))

    def _remove_robot(self) -> None:
        self._plate.handle.remove()
        for view in self._views:
            view.remove()


def _same_room(first: NamedScene, second: NamedScene) -> bool:
    return fingerprint(first.arrays.room) == fingerprint(second.arrays.room)
