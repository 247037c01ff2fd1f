"""The evaluate command: what it writes, what it refuses, and that it never leaves half a result."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from basenet_jax import evaluate
from basenet_jax.commands.table_files import NAMES
from basenet_jax.config import WorldConfig
from basenet_jax.evaluation import planning, table
from basenet_jax.planners import registry
from basenet_jax.planners.registry import PlannerKind
from basenet_jax.world.scene import NamedScene
from basenet_jax.world.scene_file import save_scene
from tests import judged
from tests.evaluation.fake_planners import FAKES, Unhappy

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def fakes(monkeypatch):
    kinds = {name: PlannerKind(make) for name, make in (FAKES | {"unhappy": Unhappy}).items()}
    monkeypatch.setattr(registry, "PLANNERS", kinds)


@pytest.fixture
def scene_dir(tmp_path):
    folder = tmp_path / "scenes"
    folder.mkdir()
    for index in range(3):
        arrays = jax.tree.map(lambda x, index=index: x[index], judged.scenes())
        save_scene(folder / f"scene-{index}.yaml", NamedScene(arrays, ("left", "right")))
    return folder


def call(capsys, *arguments):
    """Exit code, stdout and stderr of the command."""
    try:
        code = evaluate.main([str(argument) for argument in arguments])
    except SystemExit as end:  # tyro ends so on --help and wrong options
        code = end.code
    return code, *capsys.readouterr()


def test_scene_files_are_evaluated(capsys, scene_dir, tmp_path):
    out = tmp_path / "results" / "here"
    code, printed, err = call(capsys, "--scene-dir", scene_dir, "--planners", *FAKES, "--out", out)
    assert code == 0, err
    assert sorted(file.name for file in out.iterdir()) == sorted(NAMES)
    results = json.loads((out / "results.json").read_text())
    grasped = {
        each["planner"]: each["scenes"] and [scene["grasped"] for scene in each["scenes"]]
        for each in results["results"]
    }
    assert grasped == {"fixed": [2, 2, 2], "lazy": [1, 1, 1], "picky": None, "dp": [2, 2, 2]}
    assert results["scenes"] == "3 files of scenes"
    assert str(tmp_path) not in (out / "results.json").read_text() + (out / "table.md").read_text()
    assert "refused" in printed
    assert "2 objects, fixed: 3/3" in err


def test_random_scenes_of_several_sizes_are_evaluated(capsys, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(
        table, "compare", lambda planners, sets, **options: seen.append((planners, sets, options)) or []
    )
    arguments = ("--objects", 3, 1, "--scenes", 2, "--planners", "dp", "--seed", 4, "--repeats", 2)
    assert call(capsys, *arguments, "--out", tmp_path)[0] == 0
    ((planners, sets, options),) = seen
    assert planners.names == ("dp",)
    assert [(each.objects, len(each)) for each in sets] == [(3, 2), (1, 2)]
    assert (options["repeats"], options["seed"]) == (2, 4)


def test_what_the_results_are_made_with_is_recorded(capsys, scene_dir, tmp_path):
    arguments = ("--scene-dir", scene_dir, "--planners", "fixed", "--out", tmp_path / "out")
    assert call(capsys, *arguments)[0] == 0
    usual = json.loads((tmp_path / "out" / "results.json").read_text())
    assert usual["world"] == json.loads(json.dumps(dataclasses.asdict(WorldConfig())))
    (tmp_path / "c.yaml").write_text("world: {pick: {open_s: 0.5}}")
    assert call(capsys, *arguments, "--config", tmp_path / "c.yaml", "--world.pick.close-s", 3)[0] == 0
    other = json.loads((tmp_path / "out" / "results.json").read_text())
    assert (other["world"]["pick"]["close_s"], other["world"]["pick"]["open_s"]) == (3.0, 0.5)
    one, two = (results["results"][0]["scenes"][0]["grasping_s"] for results in (usual, other))
    assert two == pytest.approx(one + 2 * (2.0 - 0.5), abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--planners", "best"], "--planners: found 'best', allowed are all, fixed, lazy, picky, dp, unhappy"),
        (["--objects", "0"], "--objects: found 0, allowed are 1 to 50"),
        (["--objects", "5", "51"], "--objects: found 51, allowed are 1 to 50"),
        (["--scenes", "0"], "--scenes: found 0, allowed are 1 to 100000"),
        (["--scenes", "99999999999"], "--scenes: found 99999999999, allowed are 1 to 100000"),
        (["--repeats", "0"], "--repeats: found 0, allowed are 1 to 100000"),
        (["--seed", "-1"], "--seed: found -1, allowed are 0 to 4294967295"),
        (["--scene-dir", "none"], "none: found no folder of this name"),
        (["--scene-dir", "none", "--scenes", "3"], "--scene-dir: its files say what the scenes are; leave out"),
        (
            ["--weights", "none.weights"],
            "option weights: found, but none of the planners fixed,",
        ),
        (["--config", "none.yaml"], "none.yaml: can't be read: No such file"),
    ],
)
def test_bad_input_is_refused_in_one_line(capsys, tmp_path, arguments, message):
    code, out, err = call(capsys, *arguments, "--out", tmp_path)
    assert (code, out) == (2, "")
    assert err.startswith(f"basenet_jax.evaluate: {message}")
    assert len(err.splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("option", ["--objects=five", "--scenes=1.5", "--nonsense=1"])
def test_wrong_options_are_refused(capsys, tmp_path, option):
    code, out, err = call(capsys, option, "--out", tmp_path)
    assert (code, out) == (2, "")
    assert option.partition("=")[0] in err


def test_results_that_cannot_be_written_are_refused_before_any_work(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(planning.Planners, "get", lambda *_: pytest.fail("it worked"))
    (tmp_path / "file").write_text("here")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        code, _, err = call(capsys, "--out", out)
        assert code == 2
        assert err.startswith(f"basenet_jax.evaluate: --out: {out} can't be written: ")
    assert (tmp_path / "file").read_text() == "here"


def test_what_is_refused_leaves_no_folder(capsys, tmp_path):
    for wrong in (["--planners", "dp", "--scene-dir", tmp_path / "none"], ["--weights", tmp_path / "none.weights"]):
        code, _, err = call(capsys, *wrong, "--out", tmp_path / "results" / "table")
        assert code == 2
        assert "none" in err
        assert not list(tmp_path.iterdir())


def test_an_interrupted_evaluation_leaves_the_old_results(capsys, scene_dir, tmp_path):
    out = tmp_path / "results"
    out.mkdir()
    (out / "table.md").write_text("old")
    code, printed, err = call(capsys, "--scene-dir", scene_dir, "--planners", "fixed", "unhappy", "--out", out)
    assert (code, printed) == (130, "")
    assert err.splitlines()[-1] == f"basenet_jax.evaluate: interrupted; nothing was written to {out}"
    assert [(file.name, file.read_text()) for file in out.iterdir()] == [("table.md", "old")]


def test_a_full_disk_is_said(capsys, tmp_path, monkeypatch):
    from basenet_jax.commands import table_files

    def fail(path, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(table_files, "write_atomically", fail)
    monkeypatch.setattr(table, "compare", lambda *_, **__: [])
    code, _, err = call(capsys, "--objects", 1, "--scenes", 2, "--planners", "dp", "--out", tmp_path)
    assert code == 1
    assert "can't be written: No space left on device" in err


def test_help_teaches(capsys):
    code, out, _ = call(capsys, "--help")
    assert code == 0
    assert all(word in out for word in ("--objects", "--scene-dir", "--planners", "Default: 5", "in seconds"))


@pytest.mark.slow
def test_the_command_evaluates_all_planners(tmp_path):
    command = [
        sys.executable,
        "-m",
        "basenet_jax.evaluate",
        "--objects",
        "3",
        "15",
        "--scenes",
        "2",
        "--out",
        str(tmp_path),
    ]
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(ROOT / ".jax_cache")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    results = json.loads((tmp_path / "results.json").read_text())["results"]
    refused = {(each["planner"], each["objects"]) for each in results if each["refused"]}
    assert refused == {("dp", 15)}
    grasped = {(each["planner"], each["objects"]): each["summary"] for each in results}
    for planner in ("dp", "pbg-gc", "mbp-gc"):
        assert grasped[planner, 3]["figures"]["grasped"]["mean"] == 1.0
    assert all(each["summary"]["disagreements"] == 0 for each in results if each["summary"])
    assert "warp" not in done.stdout, "chatter of an import"
