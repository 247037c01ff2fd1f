"""Pictures of how a rate or a time grows with size."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

# Okabe and Ito's palette, told apart with any colour vision, and markers for print without colour.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999", "#8C6D31", "#7A0177")
_MARKERS = "osD^vPX*<>"

Point = tuple[float, float, float, float]  # size, and the value's median and quartiles


def draw_scaling(
    title: str, series: Mapping[str, Sequence[Point]], *, size: str, value: str, log_size: bool = True
) -> Figure:
    """One line for each series over the sizes, with the quartiles as a band, the values on a logarithmic axis.

    Args:
        title: of the picture.
        series: points by name.
        size: label of the sizes.
        value: label of the values.
        log_size: whether the sizes go by powers of two.
    """
    figure = Figure(figsize=(7.5, 4.8), dpi=120, layout="constrained")
    axes = figure.subplots()
    for index, (name, points) in enumerate(series.items()):
        sizes, medians, low, high = zip(*sorted(points), strict=True)
        color, marker = _COLORS[index % len(_COLORS)], _MARKERS[index % len(_MARKERS)]
        axes.plot(sizes, medians, color=color, marker=marker, ms=5, label=name)
        axes.fill_between(sizes, low, high, color=color, alpha=0.15, lw=0)
    axes.set_yscale("log")
    ticks = sorted({point[0] for points in series.values() for point in points})
    if log_size:
        axes.set_xscale("log", base=2)
    axes.set_xticks(ticks)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda size, _: f"{size:,.0f}"))
    axes.xaxis.set_minor_formatter(FuncFormatter(lambda size, _: ""))
    axes.set(title=title, xlabel=size, ylabel=value)
    axes.grid(which="both", color="#DDDDDD", lw=0.5)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure


def rate_points(rows: Iterable[dict[str, Any]], size: str) -> list[Point]:
    """Rows of `timing.speed` as points: items per second, over one of their facts."""
    return [(row[size], *(row["rate"][name] for name in ("median", "q1", "q3"))) for row in rows]
