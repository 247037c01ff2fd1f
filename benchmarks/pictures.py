"""The README's pictures: one plan, every planner on one scene, and the reachability maps, drawn into docs/."""

import statistics
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import tyro

import basenet_jax as bn
from basenet_jax.compilation import enable_cache
from basenet_jax.planners.grasp_map_build import build_grasp_map
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.reachability import MapStore
from basenet_jax.planners.registry import PLANNERS
from basenet_jax.plots import PlannedScene, plot_comparison, plot_grasp_map, plot_plan, plot_reachability

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS_PER_INCH = 110


@dataclass(frozen=True)
class Options:
    """What is drawn and where."""

    out: Path = Path("docs")
    """Folder of the pictures."""
    seed: int = 3
    """Of the scene."""
    objects: int = 8
    """In the scene."""


def main(arguments: list[str] | None = None) -> None:
    """Draws all pictures."""
    options = tyro.cli(Options, args=arguments, prog="python -m benchmarks.pictures", description=__doc__)
    enable_cache()
    scene = bn.sample_scene(jax.random.key(options.seed), objects=options.objects)
    planned = {name: _plan(scene, name) for name in PLANNERS}
    robot, best = bn.load_robot(), planned["dp"]
    setup = PlannerSetup()
    reach = MapStore(setup.robot, setup.grid, setup.world.pick, None).for_scene(scene.arrays)
    figures = {
        "plan.png": plot_plan(robot, scene.arrays, best.plan, best.outcome, names=scene.names),
        "planners.png": plot_comparison(robot, scene.arrays, planned, columns=4),
        "pictures/grasp_map.png": plot_grasp_map(build_grasp_map(setup.robot)),
        "reachability.png": plot_reachability(reach, layers=range(min(3, options.objects))),
    }
    for name, figure in figures.items():
        _save(figure, options.out / name)


def _plan(scene: "bn.NamedScene", name: str) -> PlannedScene:
    plan = jax.block_until_ready(bn.make_plan(scene, planner=name))  # compiles
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        plan = jax.block_until_ready(bn.make_plan(scene, planner=name))
        times.append(time.perf_counter() - begin)
    return PlannedScene(plan, bn.execute(scene, plan), statistics.median(times))


def _save(figure: "Figure", path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DOTS_PER_INCH, bbox_inches="tight")
    print(f"pictures: wrote {path}", file=sys.stderr)


if __name__ == "__main__":
    main()
