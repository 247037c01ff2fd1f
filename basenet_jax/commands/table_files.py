"""An evaluation as files: `table.md` (the paper's layout), `table.csv` (long form), `results.json` (everything)."""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from basenet_jax.atomic import write_atomically
from basenet_jax.commands.table_text import check_cells, cost_cells, noise_cells
from basenet_jax.evaluation.figures import SHARES, Summary, per_scene, summarise
from basenet_jax.evaluation.table import Row

FORMAT = "basenet-evaluation/1"
NAMES = ("table.md", "table.csv", "results.json")

_CSV_COLUMNS = ("planner", "objects", "scenes", "figure", "unit", "mean", "sd", "ci95_low", "ci95_high", "refused")


def write_tables(folder: Path, rows: Sequence[Row], about: dict[str, Any]) -> None:
    """Writes the three files, each whole or not at all.

    Args:
        folder: an existing folder.
        rows: the evaluation.
        about: what it was made with, JSON-able: `command`, `seed`, `repeats`, `scenes`, `versions`, `hardware`,
            `commit`, `weights`.

    Raises:
        OSError: one can't be written.
    """
    texts = (markdown(rows, about), long_form(rows), results(rows, about))
    for name, text in zip(NAMES, texts, strict=True):
        write_atomically(folder / name, text.encode())


def markdown(rows: Sequence[Row], about: dict[str, Any]) -> str:
    """The paper's table, one line per planner, and below it ratios to DP and MuJoCo's disagreements."""
    hardware = about["hardware"]
    where = hardware["accelerator"] or f"{hardware['cores']} cores of {hardware['cpu']}"
    lines = [
        f"`{about['command']}`, on {where}.",
        f"Scenes: {about['scenes']}. Times: mean ± standard deviation over the scenes, in s; P is measured warm",
        f"(median of {about['repeats']} calls), compiling apart, with one scene at a time{_timed(rows)}.",
        "",
        *_table(cost_cells(rows)),
        "",
        "N + G over DP's with its 95 % interval, taken over the scenes where both grasp every object, whose share",
        "stands beside it; picks that MuJoCo's replay found impossible; by how much first calls took longer, in all.",
        "",
        *_table(check_cells(rows)),
        *_noisy(rows, about),
    ]
    refused = [f"- {row.planner}, {row.objects} objects: refused: {row.refused}" for row in rows if row.refused]
    return "\n".join([*lines, *(["", *refused] if refused else []), ""])


def long_form(rows: Sequence[Row]) -> str:
    """One line per planner, number of objects and figure."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_CSV_COLUMNS)
    for row in rows:
        summary = summarise(row, rows)
        if summary is None:
            writer.writerow([row.planner, row.objects, len(row.labels), *[""] * 6, row.refused])
        else:
            writer.writerows([row.planner, row.objects, *line, ""] for line in _csv_lines(summary))
    return stream.getvalue()


def results(rows: Sequence[Row], about: dict[str, Any]) -> str:
    """Everything: what it was made with, summaries with intervals, and every figure of every scene."""
    content = {
        "format": FORMAT,
        **about,
        "results": [
            {
                "planner": row.planner,
                "objects": row.objects,
                "refused": row.refused,
                "summary": (summary := summarise(row, rows)) and asdict(summary),
                "scenes": _scenes(row),
            }
            for row in rows
        ],
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=1).decode() + "\n"


def _noisy(rows: Sequence[Row], about: dict[str, Any]) -> list[str]:
    cells = noise_cells(rows)
    if not cells:
        return []
    errors = about["uncertainty"]
    spread = f"{errors['sd_xy_m']:g} m and {math.degrees(errors['sd_heading_rad']):.3g} degrees"
    said = f"With errors of parking of {spread} (standard deviations, {errors['draws']} draws): how sure picks are"
    more = "."
    if len(cells[0]) > 2:
        more = (
            ";\nin what share of draws all picks are possible at first;\nand what executing comes to, with replanning."
        )
    return ["", f"{said}{more}", "", *_table(cells)]


def _timed(rows: Sequence[Row]) -> str:
    """In words, which scenes P is of, where it isn't all."""
    summaries = [summary for row in rows if (summary := summarise(row, rows))]
    fewer = {each.timed for each in summaries if each.timed < each.scenes}
    return f", for the first {min(fewer)} scenes" if fewer else ""


def _table(lines: Sequence[Sequence[str]]) -> list[str]:
    header, *body = lines
    return [f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *body)]


def _csv_lines(summary: Summary) -> list[list[Any]]:
    lines: list[list[Any]] = []
    for name, figure in summary.figures.items():
        unit = "s" if name.endswith("_s") else "share" if name in SHARES else "1"
        scenes = summary.timed if name in ("planning_s", "total_s") else summary.scenes
        lines.append([scenes, name, unit, figure.mean, _blank(figure.sd), *(figure.ci95 or ("", ""))])
    lines.append([summary.timed, "compile_s", "s", summary.compile_s, "", "", ""])
    lines.append([summary.scenes, "disagreements", "picks", summary.disagreements, "", "", ""])
    if (ratio := summary.ratio_to_dp) is not None:
        lines.append([ratio.scenes, "ratio_to_dp", "1", _blank(ratio.ratio), "", *(ratio.ci95 or ("", ""))])
        lines.append([summary.scenes, "ratio_scenes", "share", ratio.share, "", "", ""])
    return lines


def _blank(value: float | None) -> float | str:
    return "" if value is None else value


def _scenes(row: Row) -> list[dict[str, Any]] | None:
    if row.scores is None:
        return None
    scores, figures = row.scores, per_scene(row.scores, row.objects)
    figures["compile_s"] = scores.compile_s
    del figures["grasped"]  # as a share; here it is a number
    return [
        {
            "scene": label,
            "grasped": int(scores.grasped[index]),
            **{name: float(values[index]) for name, values in figures.items()},
            "disagreements": int(scores.disagreements[index]),
            "not_grasped": scores.reasons[index],
        }
        for index, label in enumerate(row.labels)
    ]
