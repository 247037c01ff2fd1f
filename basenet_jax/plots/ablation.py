"""The paper's ablation figures: learning curves with the spread over seeds, and learned base poses in both frames."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

_COLORS = ("#0072B2", "#D55E00")  # the paper's choice, the other; told apart by colour-blind eyes
_STYLES = ("-", "--")
_TOUCH = "#999999"


def plot_curves(
    variants: Mapping[str, Mapping[str, Float[np.ndarray, "seeds intervals"]]], labels: Mapping[str, str]
) -> Figure:
    """One panel per figure: each variant's mean over the seeds as a line, least to most as a band.

    Args:
        variants: by variant and figure, a value per seed and interval.
        labels: by figure, what its axis says.
    """
    figure = Figure(figsize=(4.6 * len(labels), 3.6), layout="constrained")
    panels = figure.subplots(1, len(labels), squeeze=False)[0]
    for axes, (name, label) in zip(panels, labels.items(), strict=True):
        for (variant, figures), color, style in zip(variants.items(), _COLORS, _STYLES, strict=False):
            values = figures[name]
            intervals = np.arange(1, values.shape[1] + 1)
            axes.plot(intervals, values.mean(axis=0), color=color, linestyle=style, label=variant)
            axes.fill_between(intervals, values.min(axis=0), values.max(axis=0), color=color, alpha=0.2, linewidth=0)
        axes.set(xlabel="interval", ylabel=label)
        axes.spines[["top", "right"]].set_visible(False)
    handles, names = panels[0].get_legend_handles_labels()
    seeds = next(iter(variants.values()))[next(iter(labels))].shape[0]
    title = f"mean of {seeds} seeds,\nband: least to most"
    figure.legend(handles, names, loc="outside right upper", frameon=False, title=title, alignment="left")
    return figure


def plot_base_poses(
    poses: Mapping[str, tuple[Float[np.ndarray, "B 3"], Bool[np.ndarray, " B"], float]],
    table_half_size: tuple[float, float],
) -> Figure:
    """One panel per frame: where the base is put for random objects, in that frame, and whether the pick succeeds.

    Args:
        poses: by variant, base poses (x, y, heading) in its frame, whether each pick succeeds, and the share that does
            over all seeds.
        table_half_size: of the table (m), drawn where the frame is the table's.
    """
    figure = Figure(figsize=(5.0 * len(poses), 4.8), layout="constrained")
    panels = figure.subplots(1, len(poses), squeeze=False)[0]
    for axes, (variant, (pose, success, share)) in zip(panels, poses.items(), strict=True):
        if variant.startswith("table"):
            width, height = 2 * table_half_size[0], 2 * table_half_size[1]
            corner = (-table_half_size[0], -table_half_size[1])
            axes.add_patch(Rectangle(corner, width, height, facecolor="#eeeeee", edgecolor=_TOUCH))
        else:
            axes.plot(0, 0, marker="+", color="black", markersize=12, linestyle="none")
        for wanted, color, marker, label in ((True, _COLORS[0], "o", "grasped"), (False, _COLORS[1], "x", "failed")):
            x, y, heading = pose[success == wanted].T
            axes.quiver(x, y, np.cos(heading), np.sin(heading), color=color, scale=40, width=0.002, alpha=0.4)
            axes.scatter(x, y, s=12, color=color, marker=marker, alpha=0.7, label=label, linewidths=1.0)
        axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
        axes.set_title(f"base poses in the {variant}: {100 * share:.1f} % grasped", fontsize=10)
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside right upper", frameon=False)
    return figure
