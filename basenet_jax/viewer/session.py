"""What all pages show: the scene, the chosen planners, their plans, and the question asked of the floor."""

import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from basenet_jax.config import WorldConfig
from basenet_jax.planners.registry import find_planner
from basenet_jax.viewer import asking, editing, furnishing, planned, uploads
from basenet_jax.viewer.asking import Answer
from basenet_jax.viewer.plan_maker import PlanMaker
from basenet_jax.viewer.planned import Awaited, Choices, Shown
from basenet_jax.viewer.worker import Worker
from basenet_jax.world.scene import NamedScene


class Screen(Protocol):
    """What is told of every change; from several threads, never from two at once."""

    def show_scene(self, scene: NamedScene, *, new: bool) -> None:
        """The scene has changed, or is another one; the plans that are shown are of an older one."""
        ...

    def show_plans(self, plans: tuple[Shown, ...]) -> None:
        """What there is for each chosen planner."""
        ...

    def show_answer(self, answer: Answer | None) -> None:
        """What can be picked from the place that was asked about; None: the question is withdrawn."""
        ...

    def show_status(self, text: str) -> None:
        """What takes long now; empty: nothing does."""
        ...


class Latency(NamedTuple):
    """When, by `time.perf_counter`, the newest planned change was asked for, and all its plans had been shown."""

    asked_s: float
    shown_s: float


class Session:
    """The state behind the pages. Changes return at once; planning follows in one thread of its own.

    Methods that change the scene raise `ValueError`, and change nothing, where that can't be.

    Args:
        scene: the first one.
        choices: of the command line.
        screen: told of every change.
        lock: held while it is told; one that a thread may take again.
    """

    def __init__(self, scene: NamedScene, choices: Choices, screen: Screen, lock: AbstractContextManager):
        self._scene, self._planners = editing.pad(scene), choices.planners
        self._choices, self._screen = choices, screen
        self._plans: tuple[Shown, ...] = ()
        self._changed_s = 0.0
        self.last = Latency(0.0, 0.0)
        self._asked: tuple[float, float] | None = None
        self._lock = lock
        self._worker = Worker(self._report)
        self._maker = PlanMaker(choices, self._tell_status, self._report)

    @property
    def scene(self) -> NamedScene:
        """The scene as it is now."""
        return self._scene

    @property
    def world(self) -> WorldConfig:
        """What is planned and judged by."""
        return self._choices.world

    @property
    def plans(self) -> tuple[Shown, ...]:
        """The newest plans."""
        return self._plans

    def begin(self) -> None:
        """Shows the scene and plans it."""
        self._edit(lambda scene: scene, new=True)

    def move(self, name: str | None, pose: Float[np.ndarray, "3"], surface: int | None = None) -> None:
        """Puts an object, a piece of furniture or (None) the robot's start at (x, y, yaw) in W.

        See `editing.move_object`, which `surface` is for, `furnishing.move_piece` and `editing.move_start`.
        """
        rule = self._choices.world.pick

        def change(scene: NamedScene) -> NamedScene:
            if name is None:
                return editing.move_start(scene, pose, rule)
            if name in furnishing.pieces(scene.furniture):
                return furnishing.move_piece(scene, name, pose, rule)
            return editing.move_object(scene, name, pose, surface)

        self._edit(change)

    def add_object(self, kind: str) -> str:
        """Adds an object of a class and returns its name."""
        return self._edit(lambda scene: editing.add_object(scene, kind)).names[-1]

    def add_piece(self, kind: str) -> str:
        """Adds a piece of furniture of a kind and returns its name."""
        with self._lock:
            changed, name = furnishing.add_piece(self._scene, kind, self._choices.world.pick)
            self._edit(lambda _: changed)
            return name

    def remove(self, name: str) -> None:
        """Takes away an object, or a piece of furniture with all that stands on it."""

        def change(scene: NamedScene) -> NamedScene:
            if name in furnishing.pieces(scene.furniture):
                return furnishing.remove_piece(scene, name)
            return editing.remove_object(scene, name)

        self._edit(change)

    def replace_scene(self, scene: NamedScene) -> None:
        """Goes on with another scene."""
        self._edit(lambda _: editing.pad(scene), new=True)

    def upload_scene(self, name: str, content: bytes) -> None:
        """Goes on with the scene of a file."""
        self._edit(lambda scene: uploads.read_scene(name, content, self._choices.robot, scene), new=True)

    def upload_plan(self, name: str, content: bytes) -> None:
        """Shows the plan of a file instead of the first planner's, until something changes."""
        scene = self._scene
        plan = uploads.read_plan(name, content, scene, self._choices.world)

        def show() -> None:
            judged = planned.judge_plan(scene, plan, name[:40], world=self._choices.world)
            self._tell(lambda: self._publish((judged, *self._plans[1:])))

        self._worker.submit("plan", show)

    def choose(self, *planners: str) -> None:
        """Plans by other planners, one or two.

        Raises:
            ValueError: there is none of a name.
        """
        for name in planners:
            find_planner(name)
        with self._lock:
            self._planners = planners
            self._withdraw_plans()
            self._worker.submit("plan", self._plan)

    def ask(self, place: tuple[float, float] | None) -> None:
        """Asks what can be picked from (x, y) on the floor, now and after every change; None: no longer."""
        with self._lock:
            self._asked = place
            if place is None:
                self._screen.show_answer(None)
            else:
                self._worker.submit("ask", self._answer)

    def wait_idle(self, timeout_s: float) -> bool:
        """Waits until everything is planned and shown, and compiled ahead; False after the timeout."""
        return self._worker.wait_idle(timeout_s) and self._maker.wait_idle(timeout_s)

    def close(self) -> bool:
        """Ends planning; False if a compilation goes on."""
        return self._worker.close() & self._maker.close()

    def _edit(self, change: Callable[[NamedScene], NamedScene], *, new: bool = False) -> NamedScene:
        begin = time.perf_counter()
        with self._lock:
            self._scene, self._changed_s = change(self._scene), begin
            self._screen.show_scene(self._scene, new=new)
            if new:
                self._withdraw_plans()
            self._worker.submit("plan", self._plan)
            if self._asked is not None:
                self._worker.submit("ask", self._answer)
            return self._scene

    def _plan(self) -> None:
        """Plans by every chosen planner; the second waits while the scene is still being changed."""
        with self._lock:
            scene, names, since = self._scene, self._planners, self._changed_s
        plans: list[Shown] = [Awaited(name, keep=True) for name in names]
        for index, name in enumerate(names):
            if index and self._worker.is_waiting("plan"):
                return
            plans[index] = self._maker.make(name, scene)
            self._tell(lambda: self._publish(tuple(plans)))
        self.last = Latency(since, time.perf_counter())

    def _answer(self) -> None:
        place, scene = self._asked, self._scene
        if place is not None:
            answer = asking.ask(scene, place, self._choices.grid, self._choices.world)
            self._tell(lambda: self._screen.show_answer(answer))

    def _withdraw_plans(self) -> None:
        """Until there are new ones, which may take a minute, none is shown as if it were of this scene."""
        self._publish(tuple(Awaited(name) for name in self._planners))

    def _report(self, error: Exception) -> None:
        """Of an error that nobody foresaw: the page goes on, the terminal has its trace."""
        traceback.print_exception(error)
        self._tell_status(f"{type(error).__name__}: {error}")

    def _tell_status(self, text: str) -> None:
        self._tell(lambda: self._screen.show_status(text))

    def _publish(self, plans: tuple[Shown, ...]) -> None:
        self._plans = plans
        self._screen.show_plans(plans)

    def _tell(self, what: Callable[[], None]) -> None:
        with self._lock:
            what()
