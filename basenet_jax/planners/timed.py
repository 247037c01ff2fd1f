"""Planning with a stopwatch."""

import statistics
import time
from dataclasses import dataclass

import jax
from jax import Array

from basenet_jax.compilation import together
from basenet_jax.planners.protocol import Planner, PreparedPlanner
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene


@dataclass(frozen=True)
class TimedPlan:
    """A plan and what making it took."""

    plan: Plan
    planning_time_s: float  # compiled ahead of time: the median of some calls
    compile_time_s: float  # by how much the first call, with what prepares it, took longer


def plan_timed(planner: Planner, scene: Scene, key: Array, *, repeats: int = 5, patience_s: float = 1.0) -> TimedPlan:
    """Plans a scene once to compile, then again for the time.

    Args:
        planner: its first call for the scene's shapes should be this one.
        scene: unbatched.
        key: used for every call, so that all make the same plan.
        repeats: how often at most; at least once.
        patience_s: after which no further call is made.

    Raises:
        PlanningError: the planner can't serve the scene.
    """

    begin = time.perf_counter()
    if isinstance(planner, PreparedPlanner):
        together(*planner.preparations(scene))
    preparing = time.perf_counter() - begin

    def call() -> tuple[Plan, float]:
        begin = time.perf_counter()
        plan = jax.block_until_ready(planner(scene, key))
        return plan, time.perf_counter() - begin

    _, first = call()
    plan, warm = call()
    times = [warm]
    while len(times) < repeats and sum(times) < patience_s:
        times.append(call()[1])
    planning_time = statistics.median(times)
    return TimedPlan(plan, planning_time, preparing + max(0.0, first - planning_time))
