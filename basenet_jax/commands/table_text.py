"""The paper's table as cells of text, for Markdown and for the terminal."""

from collections.abc import Callable, Sequence
from functools import partial

import rich.box
from rich.console import Console
from rich.table import Table

from basenet_jax.evaluation.figures import WITH_ERRORS, Summary, summarise
from basenet_jax.evaluation.table import Row

NOTHING = "-"  # where there is no such figure
REFUSED = "refused"


def cost_cells(rows: Sequence[Row]) -> list[list[str]]:
    """The paper's table, its header first: one line per planner, and in each cell one figure per number of objects."""
    counts = f"({' / '.join(str(objects) for objects in _counts(rows))} objects)"
    header = ["method", f"grasped % {counts}", "P (s)", "N (s)", "G (s)", "N + G (s)", "P + N + G (s)"]
    times = ("planning_s", "navigation_s", "grasping_s", "execution_s", "total_s")
    columns = [partial(_seconds, name) for name in times]
    return _lines(rows, header, [_grasped, *columns])


def check_cells(rows: Sequence[Row]) -> list[list[str]]:
    """Beside the paper's table, its header first: ratios to DP, MuJoCo's disagreements, compile times."""
    header = ["method", "N + G to DP's", "scenes compared %", "MuJoCo disagrees (picks)", "compile (s)"]
    return _lines(rows, header, [_ratio, _share, _disagreements, _compile])


def noise_cells(rows: Sequence[Row], *, spread: bool = True) -> list[list[str]]:
    """Where the robot parks with errors, the header first; empty where that wasn't looked at."""
    summaries = [summary for row in rows if (summary := summarise(row, rows))]
    if not any("reliability" in each.figures for each in summaries):
        return []
    if not any(f"{WITH_ERRORS}grasped" in each.figures for each in summaries):
        return _lines(rows, ["method", "sure %"], [partial(_percent, "reliability")])
    header = ["method", "sure %", "all at first %", "grasped %", "N (s)", "G (s)", "N + G (s)", "parkings"]
    shares = ("reliability", f"{WITH_ERRORS}at_first", f"{WITH_ERRORS}grasped")
    times = ("navigation_s", "grasping_s", "execution_s", "parkings")
    columns = [partial(_percent, name) for name in shares]
    show = _seconds if spread else _mean
    return _lines(rows, header, [*columns, *(partial(show, f"{WITH_ERRORS}{name}") for name in times)])


def print_table(rows: Sequence[Row], title: str) -> None:
    """Prints the means on stdout, narrow enough for 80 columns."""
    heading, note = f"{title}; times in s", "means over scenes; more in table.md"
    table = Table(title=heading, caption=note, box=rich.box.SIMPLE, pad_edge=False, collapse_padding=True)
    header = ("objects", "method", "grasped %", "P", "N", "G", "N+G", "P+N+G", "to DP")
    for column in header:
        table.add_column(column, justify="left" if column == "method" else "right", no_wrap=True)
    for objects in _counts(rows):
        for row in rows:
            if row.objects == objects:
                summary = summarise(row, rows)
                cells = [REFUSED] if summary is None else _means(summary)
                table.add_row(str(objects), row.planner, *cells)
        table.add_section()
    Console().print(table)
    if cells := noise_cells(rows, spread=False):
        header, *lines = cells
        noisy = Table(title="where the robot parks with errors", box=rich.box.SIMPLE, pad_edge=False)
        for column in header:
            noisy.add_column(column, justify="left" if column == "method" else "right")
        for line in lines:
            noisy.add_row(*line)
        Console().print(noisy)


def _means(summary: Summary) -> list[str]:
    times = ("planning_s", "navigation_s", "grasping_s", "execution_s", "total_s")
    ratio = summary.ratio_to_dp
    last = NOTHING if ratio is None or ratio.ratio is None else f"{ratio.ratio:.3f}"
    return [_grasped(summary), *(_number(summary.figures[name].mean) for name in times), last]


def _lines(rows: Sequence[Row], header: list[str], columns: Sequence[Callable[[Summary], str]]) -> list[list[str]]:
    lines = [header]
    for planner in dict.fromkeys(row.planner for row in rows):
        summaries = [summarise(row, rows) for row in rows if row.planner == planner]
        texts = [[REFUSED if summary is None else column(summary) for summary in summaries] for column in columns]
        lines.append([planner, *(" / ".join(text) for text in texts)])
    return lines


def _counts(rows: Sequence[Row]) -> list[int]:
    return list(dict.fromkeys(row.objects for row in rows))


def _grasped(summary: Summary) -> str:
    return f"{100 * summary.figures['grasped'].mean:.1f}"


def _percent(name: str, summary: Summary) -> str:
    return f"{100 * summary.figures[name].mean:.1f}"


def _seconds(name: str, summary: Summary) -> str:
    figure = summary.figures[name]
    spread = "" if figure.sd is None else f"±{figure.sd:.{_digits(figure.mean)}f}"
    return f"{_number(figure.mean)}{spread}"


def _mean(name: str, summary: Summary) -> str:
    return _number(summary.figures[name].mean)


def _number(value: float) -> str:
    return f"{value:.{_digits(value)}f}"


def _digits(value: float) -> int:
    return 1 if value >= 10 else 2 if value >= 1 else 4


def _ratio(summary: Summary) -> str:
    ratio = summary.ratio_to_dp
    if ratio is None or ratio.ratio is None:
        return NOTHING
    interval = "" if ratio.ci95 is None else f" ({ratio.ci95[0]:.3f} to {ratio.ci95[1]:.3f})"
    return f"{ratio.ratio:.3f}{interval}"


def _share(summary: Summary) -> str:
    return NOTHING if summary.ratio_to_dp is None else f"{100 * summary.ratio_to_dp.share:.1f}"


def _disagreements(summary: Summary) -> str:
    return str(summary.disagreements)


def _compile(summary: Summary) -> str:
    return f"{summary.compile_s:.1f}"
