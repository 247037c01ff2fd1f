"""Pictures of inverse reachability maps: of top-down grasps, and of grasps of any orientation."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from basenet_jax.planners.grasp_map import TILTS, GraspMap
from basenet_jax.planners.reachability import ReachabilityMap


def plot_reachability(reach_map: ReachabilityMap, *, layers: Sequence[int] | None = None) -> Figure:
    """For every bin of base positions, from how many headings a top-down grasp is reached.

    Seen from above in the grasp's frame: the grasp is at the origin, its yaw along x.

    Args:
        reach_map: the map.
        layers: which grasp heights to show, as indices; by default all.

    Raises:
        ValueError: there is no layer to show.
    """
    shown = range(len(reach_map.height)) if layers is None else layers
    if not len(shown):
        raise ValueError("layers: found none, at least one is needed")
    counts = np.asarray(reach_map.reachable).sum(axis=-1)
    turns = reach_map.reachable.shape[-1]
    shades = matplotlib.colormaps["cividis_r"](np.linspace(0.05, 1.0, turns))
    colors = ListedColormap(["white", *shades])
    norm = BoundaryNorm(np.arange(turns + 2) - 0.5, turns + 1)
    edge = float(reach_map.axis_m[-1]) + reach_map.step_m / 2
    figure = Figure(figsize=(3.6 * len(shown) + 1.6, 4.6), layout="compressed")
    panels = figure.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False).ravel()
    for axes, layer in zip(panels, shown, strict=True):
        axes.imshow(counts[layer].T, origin="lower", extent=(-edge, edge, -edge, edge), cmap=colors, norm=norm)
        axes.plot([0, 0], [-0.06, 0.06], color="#D55E00", lw=3)
        axes.annotate("", (0.25, 0), (0, 0), arrowprops={"arrowstyle": "->", "color": "#D55E00", "lw": 1.5})
        axes.set_title(f"grasp at {float(reach_map.height[layer]):.3f} m", fontsize=10)
        axes.set_xlabel("base x (m)")
    panels[0].set_ylabel("base y (m)")
    bar = figure.colorbar(ScalarMappable(norm, colors), ax=panels, ticks=np.arange(turns + 1), shrink=0.85)
    bar.set_label(f"headings, of {turns}, that reach the grasp")
    figure.suptitle(
        "Where the base can stand, seen from the grasp\n(orange: gripper axis and the grasp's x)", fontsize=10
    )
    return figure


def plot_grasp_map(grasp_map: GraspMap, *, heights_m: Sequence[float] = (0.5, 1.0, 1.5)) -> Figure:
    """Where the arm's first joint can stand for a grasp: a column for each tilt of the approach, a row for each height.

    Seen from above, the grasp at the origin, the approach to the right. Where headings of the base or turns of the
    gripper count, a place is shaded by the share of them that serves.

    Args:
        grasp_map: the map.
        heights_m: of the grasps above the floor; the nearest that the map has are shown.

    Raises:
        ValueError: there is no height to show.
    """
    if not len(heights_m):
        raise ValueError("heights_m: found none, at least one is needed")
    shape = grasp_map.shape
    shares = np.ma.masked_equal(grasp_map.bins().mean(axis=(-2, -1)), 0.0)  # what can't be reached stays white
    rows = [min(max(round(z / shape.step_m) - shape.lowest, 0), shape.heights - 1) for z in heights_m]
    tilts = [(TILTS - 1) * part // 4 for part in (2, 3, 4)]  # level, half-way down, down
    edge = (shape.side // 2 + 0.5) * shape.step_m
    figure = Figure(figsize=(3.2 * len(tilts), 3.2 * len(rows) + 0.8), layout="compressed")
    panels = figure.subplots(len(rows), len(tilts), sharex=True, sharey=True, squeeze=False)
    for line, row in zip(panels, rows, strict=True):
        for axes, tilt in zip(line, tilts, strict=True):
            axes.imshow(
                shares[row, tilt].T, origin="lower", extent=(-edge, edge, -edge, edge), cmap="cividis_r", vmin=0, vmax=1
            )
            level = np.sin(np.pi * tilt / (TILTS - 1))
            axes.plot(0, 0, "o", ms=5, color="#D55E00")
            if level > 0.01:
                axes.annotate(
                    "", (0, 0), (-0.4 * level, 0), arrowprops={"arrowstyle": "->", "color": "#D55E00", "lw": 2}
                )
            down = round(180 * tilt / (TILTS - 1)) - 90
            axes.set_title(f"{(row + shape.lowest) * shape.step_m:.2f} m, {down}° down", fontsize=10)
    for axes in panels[-1]:
        axes.set_xlabel("arm x (m)")
    for axes in panels[:, 0]:
        axes.set_ylabel("arm y (m)")
    figure.suptitle(
        "Where the arm can stand (dark), seen from the grasp\n(orange: the grasp and its approach)", fontsize=10
    )
    return figure
