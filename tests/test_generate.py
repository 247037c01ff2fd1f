"""The generate command: valid scenes, the same for a seed, never over existing files unasked."""

import os
from pathlib import Path

import numpy as np
import pytest

from basenet_jax import api, generate
from basenet_jax.world.scene_file import load_scene
from tests.room_texts import rules


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Runs the command in a folder of its own; exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        try:
            code = generate.main(["--objects", "3", *arguments])
        except SystemExit as end:  # tyro ends so on --help and wrong options
            code = end.code
        return code, *capsys.readouterr()

    return call


def texts(folder):
    return {path.name: path.read_text() for path in sorted(Path(folder).iterdir())}


def test_scenes_are_written_and_valid(call):
    code, out, _ = call("--count", "4", "--out", "new/scenes")  # progress, if it takes long, goes to stderr
    assert code == 0
    assert out == "4 scenes with 3 objects: new/scenes/scene-0000.yaml to scene-0003.yaml\n"
    assert sorted(os.listdir("new/scenes")) == [f"scene-000{i}.yaml" for i in range(4)]
    scenes = [load_scene(f"new/scenes/scene-000{i}.yaml") for i in range(4)]
    assert all(len(scene.names) == 3 for scene in scenes)
    assert all(name.rpartition("_")[2] in "123" for scene in scenes for name in scene.names)
    starts = np.array([scene.arrays.robot_start[:2] for scene in scenes])
    assert np.all((np.linalg.norm(starts, axis=1) >= 2.5) & (np.linalg.norm(starts, axis=1) <= 3.0))
    assert len({start.tobytes() for start in starts}) == 4


def test_a_seed_gives_the_same_scenes_whatever_the_count(call):
    for folder, count, seed in (("a", "3", "7"), ("b", "2", "7"), ("c", "2", "8")):
        assert call("--count", count, "--out", folder, "--seed", seed)[0] == 0
    a, b, c = texts("a"), texts("b"), texts("c")
    assert {name: a[name] for name in b} == b
    assert all(b[name] != c[name] for name in b)


def test_rooms_are_written_too(call):
    assert call("--world", "rooms", "--count", "2", "--out", "rooms")[0] == 0
    rooms = [load_scene(f"rooms/scene-000{i}.yaml") for i in range(2)]
    assert all(rules(room) == ("docked", True) and len(room.names) == 3 for room in rooms)
    assert call("--world", "rooms", "--count", "1", "--out", "again")[0] == 0
    assert texts("again")["scene-0000.yaml"] == texts("rooms")["scene-0000.yaml"]


def test_existing_scenes_are_kept_unless_told_otherwise(call):
    call("--count", "1", "--out", ".")
    before = texts(".")
    code, out, err = call("--count", "2", "--out", ".", "--seed", "1")
    assert (code, out) == (2, "")
    assert err.startswith("basenet_jax.generate: --out: found 1 of the files to write, such as scene-0000.yaml, in .")
    assert texts(".") == before
    assert call("--count", "2", "--out", ".", "--seed", "1", "--overwrite")[0] == 0
    assert len(texts(".")) == 2
    assert texts(".")["scene-0000.yaml"] != before["scene-0000.yaml"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--objects", "0"], "--objects: found 0, allowed are 1 to 50"),
        (["--objects", "51"], "--objects: found 51, allowed are 1 to 50"),
        (["--count", "0"], "--count: found 0, allowed are 1 to 100000"),
        (["--seed", "-1"], "--seed: found -1, allowed are 0 to 4294967295"),
        (["--seed", str(2**70)], "--seed: found 1180591620717411303424, allowed are 0 to 4294967295"),
        (
            ["--world", "rooms", "--world.table.width-m", "0.9"],
            "--world.table: found settings of a table, allowed are none with --world rooms",
        ),
        (["--out", "file"], "--out: found file, which can't be a folder to write to: File exists"),
        (["--out", "file/scenes"], "--out: found file/scenes, which can't be a folder to write to: Not a directory"),
    ],
    ids=range(8),
)
def test_bad_input_is_refused(call, arguments, said):
    with open("file", "w"):
        pass
    code, out, err = call("--out", "scenes", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"basenet_jax.generate: {said}")
    assert err.count("\n") == 1
    assert os.listdir() == ["file"]


def test_a_folder_without_the_right_to_write_is_refused(call, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # for the superuser no folder is like that
    code, _, err = call("--out", "scenes")
    assert code == 2
    assert err.startswith("basenet_jax.generate: --out: found scenes, which can't be written")


def test_long_work_shows_progress_on_stderr(call, monkeypatch):
    monkeypatch.setattr(generate, "_QUIET_S", 0.0)
    code, out, err = call("--count", "3", "--out", "scenes")
    assert code == 0
    assert "scenes: 3/3" in err
    assert "3/3" not in out


def test_an_interrupt_tells_what_is_there(call, monkeypatch):
    def interrupt(key, *, objects, robot, world):
        raise KeyboardInterrupt

    monkeypatch.setattr(api, "sample_scene", interrupt)
    assert call("--out", "scenes")[::2] == (
        130,
        "basenet_jax.generate: interrupted; the scenes written so far are in scenes\n",
    )


def test_too_many_objects_for_the_table_are_told(call, monkeypatch):
    def fail(key, *, objects, robot, world):
        raise ValueError(f"no place for {objects}")

    monkeypatch.setattr(api, "sample_scene", fail)
    code, _, err = call("--out", "scenes")
    assert code == 2
    assert err == "basenet_jax.generate: --objects: scene 0 of seed 0: no place for 3\n"


def test_help_teaches(call):
    code, out, _ = call("--help")
    assert code == 0
    assert all(word in out for word in ("--objects", "--count", "--out", "1 to 50", "--overwrite"))
