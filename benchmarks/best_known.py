"""The best plans that any means found, scene by scene: what optimality gaps are measured to.

For the first scenes of `evaluate --seed 1`, offline: exact planning over a fine grid (5 cm, 22.5 degrees), moved
continuously, and `refined` with a long budget from several seeds. A plan that is better than the one kept replaces it,
so a further run, with another seed or more time, only improves the files; it can be interrupted at any moment.
"""

import functools
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import tyro

from basenet_jax.atomic import write_atomically
from basenet_jax.compilation import enable_cache
from basenet_jax.config import GridConfig
from basenet_jax.evaluation.scene_sets import random_set
from basenet_jax.planners.candidates import check_candidates, grid_poses
from basenet_jax.planners.dp import plan_exactly
from basenet_jax.planners.options import RefinedOptions
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.refined import Refined
from basenet_jax.progress import make_reporter
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.world.scene import Scene

FOLDER = Path(__file__).resolve().parent / "best_known"
SCENE_SEED = 1
FINE = GridConfig(step_m=0.05, turns=16)


class Step(msgspec.Struct, frozen=True):
    """One pick: which object, and where the base parks for it."""

    object: int
    base_pose: tuple[float, float, float]  # (x, y, heading) in W


class Known(msgspec.Struct, frozen=True):
    """The best plan of one scene; all its objects are grasped."""

    scene: int
    execution_s: float  # N + G by the judge
    found_by: str
    steps: tuple[Step, ...]


@dataclass(frozen=True)
class Options:
    """How long to look for better plans."""

    objects: tuple[int, ...] = (5, 10)
    """Numbers of objects in a scene."""
    scenes: int = 100
    """Scenes for each number of objects."""
    budget: float = 5.0
    """Seconds of `refined` for each start."""
    starts: int = 2
    """Seeds of `refined`."""
    fine: bool = True
    """Whether to plan exactly over the fine grid, too."""
    seed: int = 0
    """Of everything random but the scenes."""


def main(arguments: list[str] | None = None) -> None:
    """Looks for better plans and keeps them."""
    options = tyro.cli(Options, args=arguments, prog="python -m benchmarks.best_known", description=__doc__)
    enable_cache()
    reporter = make_reporter()
    refined = Refined(_setup(), RefinedOptions(budget_s=options.budget))
    for objects in options.objects:
        best = {known.scene: known for known in read(objects)}
        scenes = random_set(objects, options.scenes, seed=SCENE_SEED)
        reporter.start(f"{objects} objects", options.scenes, unit="scenes")
        for index in range(options.scenes):
            scene, key = scenes.scene(index), jax.random.fold_in(jax.random.key(options.seed), index)
            for found_by, plan in _plans(refined, scene, key, options):
                found = judged(index, found_by, scene, plan)
                if found and (index not in best or found.execution_s < best[index].execution_s - 1e-4):
                    best[index] = found
            _write(objects, best)
            reporter.update(index + 1, {"N + G": float(np.mean([known.execution_s for known in best.values()]))})
        reporter.finish()


def read(objects: int) -> list[Known]:
    """The plans kept for one number of objects, by scene; none if there is no file."""
    file = _file(objects)
    return msgspec.json.decode(file.read_bytes(), type=list[Known]) if file.exists() else []


@functools.cache
def _setup() -> PlannerSetup:
    return PlannerSetup()


def judged(index: int, found_by: str, scene: Scene, plan: Plan) -> Known | None:
    """A plan as it is kept; None if it doesn't grasp every object."""
    outcome = compiled_execute(_setup().robot, scene, plan)
    if int(outcome.grasped) < int(np.sum(scene.mask)):
        return None
    poses = np.asarray(plan.base_pose, float).tolist()
    steps = tuple(Step(int(slot), (x, y, h)) for slot, (x, y, h) in zip(plan.object_index, poses, strict=True))
    return Known(index, float(outcome.execution), found_by, steps)


def as_plan(known: Known) -> Plan:
    """The plan again."""
    count = len(known.steps)
    return Plan(
        object_index=jnp.array([step.object for step in known.steps]),
        base_pose=jnp.array([step.base_pose for step in known.steps]),
        served=jnp.ones(count, bool),
        reason=jnp.zeros(count, jnp.int32),
    )


def _plans(refined: Refined, scene: Scene, key: jax.Array, options: Options) -> Iterator[tuple[str, Plan]]:
    keys = jax.random.split(key, options.starts + 1)
    if options.fine:
        setup = _setup()
        poses = grid_poses(setup.robot, setup.room, FINE, setup.world.pick)
        plan = plan_exactly(
            setup.robot, setup.drives, scene, check_candidates(setup.robot, scene, poses, world=setup.world)
        )
        yield "dp, 5 cm and 22.5 degrees, refined", refined.improve(scene, plan, keys[-1])
    for own in keys[:-1]:
        yield f"refined, {options.budget:g} s", refined(scene, own)


def _write(objects: int, best: dict[int, Known]) -> None:
    FOLDER.mkdir(exist_ok=True)
    kept = [best[index] for index in sorted(best)]
    lines = b",\n".join(msgspec.json.encode(known) for known in kept)
    write_atomically(_file(objects), b"[\n" + lines + b"\n]\n")


def _file(objects: int) -> Path:
    return FOLDER / f"{objects}_objects.json"


if __name__ == "__main__":
    sys.exit(main())
