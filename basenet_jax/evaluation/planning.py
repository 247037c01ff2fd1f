"""Plans of one planner for many scenes, and how long each of them took to make."""

import contextlib
import dataclasses
import gc
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from basenet_jax.evaluation.scene_sets import SceneSet
from basenet_jax.planners import registry
from basenet_jax.planners.protocol import BatchPlanner, Planner, PlannerSetup, PlanningError
from basenet_jax.planners.timed import TimedPlan, plan_timed
from basenet_jax.progress import Reporter
from basenet_jax.settings import Settings
from basenet_jax.task.plan import Plan
from basenet_jax.task.reliability import Chance
from basenet_jax.world.boxes import Room, fingerprint
from basenet_jax.world.scene import Scene

MakePlanner = Callable[[PlannerSetup], Planner]


@dataclass(frozen=True)
class Planned:
    """One planner's plans for a set of B scenes."""

    plans: Plan  # a batch of B
    planning_s: Float[np.ndarray, " B"]  # P: the median of warm calls; NaN where the scene wasn't timed
    compile_s: Float[np.ndarray, " B"]  # by how much each scene's first call took longer; likewise


def own_options(names: Sequence[str], given: Mapping[str, Any]) -> dict[str, Settings | None]:
    """Of the planners of these names, each once, or of every name for `("all",)`: its options (None: it has none).

    Args:
        names: of planners.
        given: options; each planner takes those that it has.

    Raises:
        ValueError: there is no planner of a name, or none of them has an option, or not with such a value.
    """
    names = tuple(registry.PLANNERS) if tuple(names) == ("all",) else tuple(names)
    if unknown := [name for name in names if name not in registry.PLANNERS]:
        raise ValueError(f"--planners: found {unknown[0]!r}, allowed are all, {', '.join(registry.PLANNERS)}")
    return registry.shared_options(names, given)


ROBUST = " robust"  # after a planner's name, where it plans for errors


def choose_planners(options: Mapping[str, Settings | None], chance: Chance | None = None) -> dict[str, MakePlanner]:
    """What makes planners, by name and with their options.

    Args:
        options: by planner.
        chance: if given, each planner that can is there twice: as it is, and planning for errors.
    """
    factories: dict[str, MakePlanner] = {}
    for name, own in options.items():
        kind = registry.PLANNERS[name]
        factories[name] = partial(kind.make_planner, options=own)
        if chance is not None and kind.robust:
            factories[f"{name}{ROBUST}"] = partial(_make_robust, kind, own, chance)
    return factories


def _make_robust(kind: registry.PlannerKind, options: Settings | None, chance: Chance, setup: PlannerSetup) -> Planner:
    return kind.make_planner(dataclasses.replace(setup, chance=chance), options=options)


class Planners:
    """A planner by its name for every room that scenes are in, each made once.

    Args:
        factories: by name, what makes a planner.
        setup: robot, world, grid and weights; its room is replaced by the scenes'.
    """

    def __init__(self, factories: dict[str, MakePlanner], setup: PlannerSetup):
        self.names = tuple(factories)
        self.setup = setup
        self._factories = factories
        self._setups: dict[Hashable, PlannerSetup] = {}
        self._planners: dict[tuple[str, Hashable], Planner] = {}

    def get(self, name: str, room: Room) -> Planner:
        """The planner of a name for a concrete room.

        Raises:
            ValueError: its weights can't be used.
        """
        key = fingerprint(room)
        if key not in self._setups:
            self._setups[key] = self.setup.with_room(room)
        if (name, key) not in self._planners:
            self._planners[name, key] = self._factories[name](self._setups[key])
        return self._planners[name, key]


def plan_all(
    planners: Planners,
    name: str,
    scenes: SceneSet,
    *,
    repeats: int,
    seed: int,
    reporter: Reporter,
    timed: int | None = None,
) -> Planned:
    """Plans scene after scene, as a robot would be served, and times the first plans warm, the garbage collector off.

    Scenes beyond those are planned without a stopwatch: together where the planner can, otherwise one after another.
    The plans are the same.

    Args:
        planners: the planners.
        name: of the one to run.
        scenes: the scenes.
        repeats: warm calls per scene, fewer where they take long (see `plan_timed`).
        seed: of planners that draw random numbers.
        reporter: told of every scene.
        timed: so many scenes, the first ones, are timed; None: all.

    Raises:
        PlanningError: the planner refuses a scene; the message names the scene.
        RuntimeError: a plan doesn't have each object exactly once.
    """
    key, planner = jax.random.key(seed), planners.get(name, scenes.scene(0).room)
    timed = len(scenes) if timed is None else min(timed, len(scenes))
    together = planner if isinstance(planner, BatchPlanner) and scenes.in_one_room() and timed < len(scenes) else None
    keys = jax.random.split(key, len(scenes))[: timed if together else None]
    reporter.start(f"{scenes.objects} objects, {name}", len(scenes), unit="scenes")
    try:
        alone = _plan_alone(planners, name, scenes, keys, repeats, timed, reporter)
        plans = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(each.plan for each in alone))
        if together:
            plans = jax.block_until_ready(together.plan_batch(scenes.scenes, key))
            reporter.update(len(scenes), {})
    finally:
        reporter.finish()
    on_host = jax.device_get((plans, scenes.scenes))
    for index, label in enumerate(scenes.labels):
        plan, scene = jax.tree.map(lambda x, index=index: x[index], on_host)
        _check_complete(plan, scene, f"{name}, scene {label}")
    planning_s, compile_s = np.full((2, len(scenes)), np.nan)
    planning_s[:timed] = [each.planning_time_s for each in alone[:timed]]
    compile_s[:timed] = [each.compile_time_s for each in alone[:timed]]
    return Planned(plans, planning_s, compile_s)


def _plan_alone(
    planners: Planners, name: str, scenes: SceneSet, keys: Array, repeats: int, timed: int, reporter: Reporter
) -> list[TimedPlan]:
    """Plans of as many scenes as there are keys, the first ones; the times of those beyond `timed` are NaN."""
    alone: list[TimedPlan] = []
    for index, key in enumerate(keys):
        scene = scenes.scene(index)
        planner = planners.get(name, scene.room)
        jax.block_until_ready((scene, key))
        try:
            if index < timed:
                with _no_garbage_collection():
                    alone.append(plan_timed(planner, scene, key, repeats=repeats))
            else:
                alone.append(TimedPlan(jax.block_until_ready(planner(scene, key)), np.nan, np.nan))
        except PlanningError as error:
            raise PlanningError(f"scene {scenes.labels[index]}: {error}") from error
        reporter.update(index + 1, {"P (s)": float(np.median([each.planning_time_s for each in alone[:timed]]))})
    return alone


@contextlib.contextmanager
def _no_garbage_collection() -> Iterator[None]:
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _check_complete(plan: Plan, scene: Scene, where: str) -> None:
    """A plan with an object twice would be paid for it twice."""
    found = sorted(int(slot) for slot in plan.object_index if slot >= 0)
    wanted = np.flatnonzero(scene.mask).tolist()
    if found != wanted:
        raise RuntimeError(f"{where}: found steps for the slots {found}, each of {wanted} is needed once")
