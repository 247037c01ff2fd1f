"""Makes plans for the session, and says what takes so long when something does."""

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager

import jax

from basenet_jax.compilation import programs_of_this_thread
from basenet_jax.viewer import planned
from basenet_jax.viewer.planned import Choices, Planned, Refused
from basenet_jax.viewer.worker import Worker
from basenet_jax.world.scene import NamedScene

_PATIENCE_S = 0.4  # after which it is said what takes so long


class PlanMaker:
    """Planners that are warmed up when they are first asked for.

    Args:
        choices: of the command line.
        tell: called with what takes long, and with nothing when it is over.
        report: told of errors while warming up.
    """

    def __init__(self, choices: Choices, tell: Callable[[str], None], report: Callable[[Exception], None]):
        self._choices, self._tell = choices, tell
        self._seen: set[Hashable] = set()  # planners, robots, and numbers of slots and boxes that were compiled for
        self._background = Worker(report)

    def make(self, name: str, scene: NamedScene) -> Planned | Refused:
        """The plan of a planner, or why there is none."""
        variant = (name, scene.robot, *(leaf.shape for leaf in jax.tree.leaves(scene.arrays)))
        new, before = variant not in self._seen, programs_of_this_thread()
        try:
            with self._told(f"compiling {name}, once: this can take a minute" if new else f"{name} is planning"):
                made = planned.make_plan(scene, name, self._choices)
                # Again, for what planning takes without compiling. Exact planners compile now and then for known
                # variants too, when another number of objects or of stops counts.
                if programs_of_this_thread() != before:
                    made = planned.make_plan(scene, name, self._choices)
        except ValueError as error:
            return Refused(name, str(error))
        if new:
            self._seen.add(variant)
            self._background.submit(name, lambda: self._warm_up(name, scene))
        return made

    def wait_idle(self, timeout_s: float) -> bool:
        """Waits until all is compiled ahead; False after the timeout."""
        return self._background.wait_idle(timeout_s)

    def close(self) -> bool:
        """Ends warming up; False if a compilation goes on."""
        return self._background.close()

    def _warm_up(self, name: str, scene: NamedScene) -> None:
        """Compiles, beside planning, what a planner needs once an object can't be reached."""
        with self._told(f"compiling the rest of {name}, once; planning goes on"):
            planned.warm_up(scene, name, self._choices)

    @contextmanager
    def _told(self, text: str) -> Iterator[None]:
        """Says what is being done if it takes long."""
        timer = threading.Timer(_PATIENCE_S, lambda: self._tell(text))
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
            timer.join()
            self._tell("")
