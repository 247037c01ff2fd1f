"""The three files hold the same figures, in the paper's layout, in long form, and scene by scene."""

import csv
import dataclasses
import io
import json

import numpy as np
import pytest

from basenet_jax.commands.table_files import NAMES, long_form, markdown, results, write_tables
from basenet_jax.commands.table_text import print_table
from basenet_jax.evaluation.table import Row
from tests.evaluation.test_figures import scores

ABOUT = {
    "command": "python -m basenet_jax.evaluate --objects 2 3 --out results",
    "scenes": "3 random ones",
    "seed": 4,
    "repeats": 3,
    "weights": {"file": "packaged default.weights", "sha256": "0"},
    "versions": {"jax": "1"},
    "hardware": {"cpu": "a CPU", "cores": 2, "accelerator": None, "system": "Linux"},
}
LABELS = ("a.yaml", "b.yaml", "c.yaml")


@pytest.fixture(scope="module")
def rows():
    return [
        Row("pbg", 2, LABELS, scores([2, 2, 1], [11.0, 12.0, 5.0])),
        Row("dp", 2, LABELS, scores([2, 2, 2], [10.0, 10.0, 10.0])),
        Row("pbg", 3, LABELS, scores([3, 3, 3], [20.0, 21.0, 22.0])),
        Row("dp", 3, LABELS, None, "scene a.yaml: too many | objects"),
    ]


def test_markdown_has_the_papers_table(rows):
    lines = markdown(rows, ABOUT).splitlines()
    head = "| method | grasped % (2 / 3 objects) | P (s) | N (s) | G (s) | N + G (s) | P + N + G (s) |"
    start = lines.index(head)
    assert lines[start + 1] == "| --- | --- | --- | --- | --- | --- | --- |"
    assert lines[start + 2] == (
        "| pbg | 83.3 / 100.0 | 0.5000±0.0000 / 0.5000±0.0000 | 2.33±0.95 / 5.25±0.25 | 7.00±2.84 / 15.8±0.8 |"
        " 9.33±3.79 / 21.0±1.0 | 9.83±3.79 / 21.5±1.0 |"
    )
    assert lines[start + 3].startswith("| dp | 100.0 / refused | 0.5000±0.0000 / refused |")
    assert "| pbg | 1.150 (1.100 to 1.200) / - | 66.7 / - | 0 / 0 | 3.0 / 3.0 |" in lines
    assert "- dp, 3 objects: refused: scene a.yaml: too many | objects" in lines
    assert ABOUT["command"] in lines[0]
    assert "2 cores of a CPU" in lines[0]


def test_long_form_has_one_line_per_figure(rows):
    lines = list(csv.DictReader(io.StringIO(long_form(rows))))
    wanted = [line for line in lines if (line["planner"], line["objects"]) == ("pbg", "2")]
    figures = {line["figure"]: line for line in wanted}
    assert len(figures) == len(wanted) == 10
    assert float(figures["execution_s"]["mean"]) == pytest.approx(28 / 3)
    assert float(figures["execution_s"]["sd"]) == pytest.approx(np.std([11, 12, 5], ddof=1))
    assert figures["execution_s"]["unit"] == "s"
    assert float(figures["ratio_to_dp"]["mean"]) == pytest.approx(1.15)
    assert figures["ratio_to_dp"]["scenes"] == "2"
    assert float(figures["ratio_scenes"]["mean"]) == pytest.approx(2 / 3)
    (refused,) = [line for line in lines if line["refused"]]
    assert (refused["planner"], refused["objects"], refused["mean"]) == ("dp", "3", "")


def test_results_hold_every_figure_of_every_scene(rows):
    content = json.loads(results(rows, ABOUT))
    assert content["format"] == "basenet-evaluation/1"
    assert {name: content[name] for name in ABOUT} == ABOUT
    assert [(each["planner"], each["objects"]) for each in content["results"]] == [
        (row.planner, row.objects) for row in rows
    ]
    pbg, dp = content["results"][0], content["results"][3]
    assert [scene["scene"] for scene in pbg["scenes"]] == list(LABELS)
    assert pbg["scenes"][2] == {
        "scene": "c.yaml",
        "grasped": 1,
        "planning_s": 0.5,
        "navigation_s": 1.25,
        "grasping_s": 3.75,
        "execution_s": 5.0,
        "total_s": 5.5,
        "compile_s": 2.0,
        "disagreements": 0,
        "not_grasped": {},
    }
    low, high = pbg["summary"]["figures"]["execution_s"]["ci95"]
    assert low < 28 / 3 < high
    assert pbg["summary"]["ratio_to_dp"]["share"] == pytest.approx(2 / 3)
    assert (dp["summary"], dp["scenes"]) == (None, None)
    assert "too many" in dp["refused"]


def test_one_scene_has_no_spread_and_says_null():
    row = Row("x", 2, ("0",), scores([2], [10.0]))
    assert "| x | 100.0 | 0.5000 | 2.50 | 7.50 | 10.0 | 10.5 |" in markdown([row], ABOUT)
    figures = json.loads(results([row], ABOUT))["results"][0]["summary"]["figures"]
    assert figures["execution_s"] == {"mean": 10.0, "sd": None, "ci95": None}


def test_scenes_that_were_not_timed_have_no_planning_time():
    some = dataclasses.replace(scores([2, 2, 2], [10.0, 10.0, 10.0]), planning_s=np.array([0.5, 0.7, np.nan]))
    row = Row("x", 2, LABELS, some)
    content = json.loads(results([row], ABOUT))["results"][0]
    assert [scene["planning_s"] for scene in content["scenes"]] == [0.5, 0.7, None]
    assert content["summary"]["timed"] == 2
    assert content["summary"]["planning_max_s"] == 0.7
    assert content["summary"]["figures"]["planning_s"]["mean"] == pytest.approx(0.6)
    assert content["summary"]["figures"]["total_s"]["mean"] == pytest.approx(10.6)
    assert "with one scene at a time, for the first 2 scenes." in markdown([row], ABOUT)
    lines = {line["figure"]: line["scenes"] for line in csv.DictReader(io.StringIO(long_form([row])))}
    assert (lines["planning_s"], lines["execution_s"]) == ("2", "3")


def test_files_are_written_whole(rows, tmp_path):
    write_tables(tmp_path, rows, ABOUT)
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(NAMES)
    assert (tmp_path / "table.md").read_text() == markdown(rows, ABOUT)


def test_the_printed_table_fits_80_columns(rows, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    print_table(rows, "3 random ones")
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in lines)
    assert any(
        line.split() == ["2", "pbg", "83.3", "0.5000", "2.33", "7.00", "9.33", "9.83", "1.150"] for line in lines
    )
    assert any(line.split() == ["3", "dp", "refused"] for line in lines)
