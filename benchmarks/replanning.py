"""Planning again when something changes: how long it takes, and what keeping the old plan would cost.

A robot executes a plan of `basenet`; before a random step one of the objects that remain is moved, in half of the
scenes, or taken away. Compared are the rest of the old plan and new plans from where the robot stands, by N + G of what
remains as a ratio to that of the first planner (`refined`), over the scenes where both grasp every object that remains.
"""

import dataclasses
import sys
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.table import Table
from scipy import stats

from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.registry import make_planner
from basenet_jax.planners.timed import plan_timed
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.world.scene import Scene
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse

NAME = "replanning"
KEPT = "the old plan, kept"
_APART_M = 0.18  # the largest distance that two objects may have to keep


@dataclass(frozen=True)
class ReplanningOptions(Options):
    """Options, and what is compared on how many scenes."""

    objects: int = 10
    """In each scene at first."""
    scenes: int = 200
    """How many."""
    planners: tuple[str, ...] = ("refined", "basenet", "basenet-sample", "greedy-stops", "dp")
    """That plan again; the first one's plans are what all are compared with."""
    repeats: int = 3
    """Warm calls per scene and planner; their median counts."""


@dataclass(frozen=True)
class Change:
    """What remains of a scene after a change, and of the plan that was under way."""

    scene: Scene  # the robot's start is where it stands
    rest: Plan
    moved: bool  # otherwise an object was taken away


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(ReplanningOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    objects, count = (QUICK_OBJECTS, 2) if options.quick else (options.objects, options.scenes)
    planners = ("basenet",) if options.quick else options.planners
    setup = PlannerSetup()
    changes = _changes(setup, objects, count, options.seed)
    figures = {KEPT: [(*_judged(setup, each.scene, each.rest), 0.0) for each in changes]}
    for name in planners:
        planner = make_planner(name, setup)
        timed = [plan_timed(planner, each.scene, jax.random.key(0), repeats=options.repeats) for each in changes]
        figures[name] = [
            (*_judged(setup, each.scene, one.plan), one.planning_time_s)
            for each, one in zip(changes, timed, strict=True)
        ]
    reference = np.array(figures[planners[0]])
    results = [_row(name, np.array(values), reference) for name, values in figures.items()]
    moved = sum(each.moved for each in changes)
    return report.finish(
        results, table=_table(results, planners[0]), scenes=count, moved=moved, taken_away=count - moved
    )


def _changes(setup: PlannerSetup, objects: int, count: int, seed: int) -> list[Change]:
    scene_key, other_key = jax.random.split(jax.random.key(seed))
    batch, others = random_scenes(scene_key, objects, count), random_scenes(other_key, objects, count)
    planner, random = make_planner("basenet", setup), np.random.default_rng(seed)
    changes = []
    for index in range(count):
        scene = jax.tree.map(lambda x, i=index: x[i], batch)
        plan = jax.device_get(planner(scene, jax.random.key(0)))
        changes.append(_change(scene, plan, np.asarray(others.object_pose[index]), random, move=index % 2 == 0))
    return changes


def _change(scene: Scene, plan: Plan, places: np.ndarray, random: np.random.Generator, *, move: bool) -> Change:
    """A change before a random step but the first; to be moved, an object needs a place away from all others."""
    done = int(random.integers(1, max(2, len(plan.object_index) - 1)))
    index, left = plan.object_index, plan.object_index[done:]
    changed = int(random.choice(left))
    pose, mask = np.array(scene.object_pose), np.zeros(len(index), bool)
    mask[left] = True
    others = pose[[slot for slot in left if slot != changed], :2]
    free = [place for place in places if np.all(np.linalg.norm(others - place[:2], axis=-1) >= _APART_M)]
    moved = move and bool(free)
    if moved:
        pose[changed] = free[0]
    else:
        mask[changed] = False
    steps = np.arange(len(index)) >= done
    steps &= moved | (index != changed)
    order = np.argsort(~steps, kind="stable")  # what remains comes first
    rest = Plan(
        object_index=jnp.asarray(np.where(steps, index, -1)[order]),
        base_pose=jnp.asarray(plan.base_pose[order]),
        served=jnp.asarray((plan.served & steps)[order]),
        reason=jnp.asarray(plan.reason[order]),
    )
    start = jnp.asarray(plan.base_pose[done - 1])
    left_over = dataclasses.replace(scene, object_pose=jnp.asarray(pose), mask=jnp.asarray(mask), robot_start=start)
    return Change(left_over, rest, moved)


def _judged(setup: PlannerSetup, scene: Scene, plan: Plan) -> tuple[float, float]:
    """Share of the remaining objects that are grasped, and N + G (s)."""
    outcome = compiled_execute(setup.robot, scene, plan)
    return int(outcome.grasped) / max(int(np.sum(scene.mask)), 1), float(outcome.execution)


def _row(name: str, values: np.ndarray, reference: np.ndarray) -> dict[str, Any]:
    grasped, cost, time = values.T
    both = (grasped == 1.0) & (reference[:, 0] == 1.0) & (reference[:, 1] > 0)
    ratio = cost[both] / reference[both, 1]
    half = stats.t.ppf(0.975, len(ratio) - 1) * ratio.std(ddof=1) / np.sqrt(len(ratio)) if len(ratio) > 1 else None
    mean = float(ratio.mean()) if len(ratio) else None
    return {
        "what": name,
        "grasped": float(grasped.mean()),
        "compared": int(both.sum()),
        "ratio": mean,
        "ci95": None if half is None or mean is None else [mean - float(half), mean + float(half)],
        "latency_s": {"median": float(np.median(time)), "max": float(time.max())},
    }


def _table(results: list[dict[str, Any]], reference: str) -> Table:
    table = Table(title="Planning again after a change")
    for column in (
        "what",
        "grasped %",
        f"N + G to {reference}'s",
        "95 %",
        "scenes",
        "latency median (ms)",
        "most (ms)",
    ):
        table.add_column(column, justify="left" if column == "what" else "right")
    for row in results:
        interval = "" if row["ci95"] is None else "{:.4f} to {:.4f}".format(*row["ci95"])
        ratio = "" if row["ratio"] is None else f"{row['ratio']:.4f}"
        times = (f"{1e3 * row['latency_s'][name]:.1f}" for name in ("median", "max"))
        table.add_row(row["what"], f"{100 * row['grasped']:.1f}", ratio, interval, str(row["compared"]), *times)
    return table


if __name__ == "__main__":
    main()
