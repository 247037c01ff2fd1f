"""The picture of an inverse reachability map."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

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
