"""Exact dynamic programming over (objects grasped, last base pose) on validated costs."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from basenet_jax.planners.candidates import Candidates
from basenet_jax.planners.protocol import PlannerSetup, PlanningError, no_plan
from basenet_jax.planners.reachability import CandidateSource
from basenet_jax.planners.stop_problem import Sizes, stop_problem
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import Drives
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.world.scene import Scene

MAX_OBJECTS = 14  # 2^14 subsets x 2,500 poses: 160 MiB and some ten seconds on two cores; each more doubles both


class Dp:
    """The least-cost plan among all whose base poses are on the grid."""

    def __init__(self, setup: PlannerSetup):
        self._setup, self._candidates = setup, CandidateSource(setup, checked=True)
        self._sizes = Sizes(MAX_OBJECTS)

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored."""
        del key
        setup = self._setup
        check_size(int(np.sum(scene.mask)))
        candidates, stops = self._candidates(scene)
        return plan_exactly(setup.robot, setup.drives, scene, candidates, self._sizes, between=stops.known)

    def preparations(self, scene: Scene) -> Sequence[Callable[[], object]]:
        """See `PreparedPlanner`."""
        robot, world = self._setup.robot, self._setup.world
        judged = (robot, scene, no_plan(scene), self._setup.docked)
        return [*self._candidates.preparations(scene), partial(compiled_execute.prepare, *judged, config=world)]


def check_size(objects: int) -> None:
    """Refuses scenes that would take minutes and gigabytes.

    Raises:
        PlanningError: with what to use instead.
    """
    if objects > MAX_OBJECTS:
        raise PlanningError(
            f"objects: found {objects}, dp plans at most {MAX_OBJECTS} (its time and memory double with each); "
            "use refined, greedy-stops, mbp-gc or basenet"
        )


def plan_exactly(
    robot: Robot,
    drives: Drives,
    scene: Scene,
    candidates: Candidates,
    sizes: Sizes | None = None,
    *,
    between: Float[ArrayLike, "K K"] | None = None,
) -> Plan:
    """The plan of least N + G over all orders and all choices among the candidates; unserved objects come last.

    Args:
        robot: its base's speeds and accelerations count.
        drives: of the scene's room.
        scene: unbatched.
        candidates: base poses with validated costs.
        sizes: of the problems before, see `stop_problem`.
        between: drives (s) between the candidates, where they are known.
    """
    problem = stop_problem(robot, drives, scene, candidates, sizes, between=between)
    if not len(problem.slots):
        return problem.plan_nothing(scene)
    return problem.plan(scene, *problem.best_steps())
