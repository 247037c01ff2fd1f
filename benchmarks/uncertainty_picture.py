"""A fragile plan and a robust one of the same scene, side by side, with where the base may really come to stand."""

import sys
from dataclasses import dataclass
from math import radians
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

import basenet_jax as bn
from basenet_jax.compilation import enable_cache
from basenet_jax.config import PickConfig, UncertaintyConfig
from basenet_jax.geometry import compose
from basenet_jax.plots.drawing import draw_plan, rectangle
from basenet_jax.task.reliability import Errors, actual_picks, draw_errors, is_feasible, seen_grasps

_GOOD, _BAD = "#009E73", "#B00020"


@dataclass(frozen=True)
class Options:
    """What is drawn and where."""

    out: Path = Path("docs/pictures/uncertainty.png")
    """The picture."""
    seed: int = 3
    """Of the scene."""
    objects: int = 6
    """In the scene."""
    sd_xy_m: float = 0.05
    """Of where the base stands."""
    sd_heading_degrees: float = 5.0
    """Of its heading."""
    reliability: float = 0.95
    """Of the robust plan's picks."""
    draws: int = 24
    """Of the base, drawn at each stop."""


def main(arguments: list[str] | None = None) -> None:
    """Draws the picture."""
    options = tyro.cli(Options, args=arguments, prog="python -m benchmarks.uncertainty_picture", description=__doc__)
    enable_cache()
    uncertainty = UncertaintyConfig(sd_xy_m=options.sd_xy_m, sd_heading_rad=radians(options.sd_heading_degrees))
    scene = bn.sample_scene(jax.random.key(options.seed), objects=options.objects)
    errors = draw_errors(jax.random.key(1), UncertaintyConfig(**vars(uncertainty) | {"draws": options.draws}))
    figure = Figure(figsize=(12, 3.9), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    robust = {"uncertainty": uncertainty, "reliability": options.reliability}
    for axes, title, how in zip(panels, ("without errors in mind", "planned for errors"), ({}, robust), strict=True):
        plan = bn.make_plan(scene, **how)
        _draw(axes, title, scene, plan, errors, actual_picks(PickConfig(), uncertainty))
    shown = {_GOOD: "all picks of the stop possible", _BAD: "some pick is not"}
    handles = [Patch(facecolor="none", edgecolor=color, label=text) for color, text in shown.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(options.out, dpi=110)


def _draw(axes: Axes, title: str, scene: bn.NamedScene, plan: bn.Plan, errors: Errors, config: PickConfig) -> None:
    robot, arrays, outcome = bn.load_robot(scene.robot), scene.arrays, bn.execute(scene, plan)
    slot = jnp.maximum(plan.object_index, 0)
    stands = compose(plan.base_pose[:, None], errors.base)
    possible = np.asarray(
        jax.jit(is_feasible, static_argnames="config")(
            robot, stands, seen_grasps(arrays, slot[:, None], errors.seen), arrays.room, config=config
        )
    )
    on_host = jax.device_get((arrays, plan, outcome))
    draw_plan(axes, robot, *on_host, size=8.0)
    pose = np.asarray(plan.base_pose)
    for stop in np.unique(pose[np.asarray(plan.served)], axis=0):
        here = np.all(pose == stop, axis=1) & np.asarray(plan.served)
        for draw, place in enumerate(np.asarray(stands)[np.argmax(here)]):
            color = _GOOD if np.all(possible[here, draw]) else _BAD
            corners = rectangle(place, np.asarray(robot.footprint_half_size))
            axes.add_patch(Polygon(corners, fill=False, edgecolor=color, linewidth=0.6, alpha=0.7, zorder=4))
    share = 100 * np.mean(possible[np.asarray(plan.served)])
    axes.set_title(title, fontsize=11, weight="bold", loc="left")
    total = f"N {float(outcome.navigation):.1f} + G {float(outcome.picking):.1f} s"
    axes.set_title(f"{total}; {share:.0f} % of picks possible", fontsize=9, loc="right")
    axes.set_xlabel("x (m)")


if __name__ == "__main__":
    main(sys.argv[1:])
