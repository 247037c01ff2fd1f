"""An export is there whole or not at all, and what is wrong is said before."""

import importlib.util
import os

import pytest

import basenet_jax as bn
from basenet_jax import api
from basenet_jax.exports import ExportError, export, folder
from tests import judged

NAMES = ["bag", "execution.csv", "plan.yaml"]


def test_a_plan_is_exported_by_the_library(scene, plan, outcome, tmp_path, monkeypatch):
    monkeypatch.setattr(api, "execute", lambda *_, **__: outcome)  # compiled elsewhere
    done = bn.export_plan(scene, plan, tmp_path / "out", table_pose=(1.0, 2.0, 0.5), map_frame="hall")
    assert sorted(path.name for path in done.files) == sorted(os.listdir(tmp_path / "out")) == NAMES
    assert all(path.exists() for path in done.files)
    assert not done.left_out
    text = (tmp_path / "out" / "plan.yaml").read_text()
    assert "frame_id: hall" in text
    assert "table_pose: {x: 1.0, y: 2.0, yaw: 0.5}" in text
    assert float(outcome.execution) == pytest.approx(done.duration_s, rel=0.01)


@pytest.fixture
def write(robot, scene, plan, outcome, tmp_path):
    """Exports into a folder of its own."""

    def write(name="out", outcome=outcome, **options):
        return export(robot, scene, plan, outcome, tmp_path / name, **options)

    return write


def test_only_the_formats_that_are_asked_for(write, tmp_path):
    done = write(formats=["csv", "csv"])
    assert [path.name for path in done.files] == os.listdir(tmp_path / "out") == ["execution.csv"]


def test_an_empty_folder_is_filled_and_a_full_one_left_alone(write, tmp_path):
    (tmp_path / "out").mkdir()
    write(formats=["yaml"])
    before = (tmp_path / "out" / "plan.yaml").stat()
    with pytest.raises(ExportError, match=r"directory: found .*out, which isn't empty, allowed is a new"):
        write(formats=["csv"])
    assert os.listdir(tmp_path / "out") == ["plan.yaml"]
    assert (tmp_path / "out" / "plan.yaml").stat().st_mtime_ns == before.st_mtime_ns


def test_what_fails_is_named(write, outcome):
    done = write(outcome=judged.with_failure(outcome, 0), formats=["csv"])
    assert done.left_out == {"mug_1": "out_of_reach"}


def test_nothing_to_export_is_an_error(write, outcome, tmp_path):
    nothing = judged.with_failure(judged.with_failure(outcome, 0), 1)
    with pytest.raises(ExportError, match="no step that can be executed"):
        write(outcome=nothing)
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"formats": ["xml"]}, "format: found xml, allowed are yaml, csv, bag"),
        ({"formats": []}, "format: found none"),
        ({"table_pose": (0.0, float("nan"), 0.0)}, r"table pose: found \[0.0, nan, 0.0\], allowed are finite"),
        ({"name": "no/where"}, "whose folder isn't there"),
        ({"name": "file"}, "which is a file"),
    ],
)
def test_what_can_not_be_written_is_refused(write, tmp_path, options, message):
    (tmp_path / "file").touch()
    with pytest.raises(ExportError, match=message):
        write(**options)
    assert os.listdir(tmp_path) == ["file"]


def test_a_failure_half_way_leaves_nothing(write, tmp_path, monkeypatch):
    def fail(path, schedule):
        path.mkdir()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folder, "write_bag", fail)
    with pytest.raises(OSError, match="No space left"):
        write()
    assert not os.listdir(tmp_path)


def test_without_rosbags_the_message_says_what_to_install(write, tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "rosbags" else find(name))
    with pytest.raises(ExportError, match=r'needs the package rosbags: pip install "basenet_jax\[ros\]"'):
        write()
    assert not os.listdir(tmp_path)
    assert len(write(formats=["yaml", "csv"]).files) == 2
