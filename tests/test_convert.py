"""The convert command: a scene of one table as a room that means the same."""

import jax
import numpy as np
import pytest

from basenet_jax import convert
from basenet_jax.world.scene_file import load_scene
from tests import room_texts, scene_texts


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Runs the command in a folder with a scene and a room; exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(scene_texts.TEXT)
    (tmp_path / "room.yaml").write_text(room_texts.TEXT)

    def call(*arguments):
        try:
            code = convert.main(list(arguments))
        except SystemExit as end:  # tyro ends so on --help and wrong options
            code = end.code
        return code, *capsys.readouterr()

    return call


@pytest.mark.parametrize("name", ["new.yaml", "new.json"])
def test_a_scene_becomes_a_room_of_the_same_meaning(call, name):
    assert call("scene.yaml", "--out", name) == (0, f"2 objects on one table, as a room: {name}\n", "")
    before, after = load_scene("scene.yaml"), load_scene(name)
    assert after.names == before.names
    assert after.box_names == ("table",)
    assert room_texts.rules(after) == ("point", False)
    for a, b in zip(jax.tree.leaves(after.arrays), jax.tree.leaves(before.arrays), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["scene.yaml", "--out", "room.yaml"], "--out: found room.yaml, allowed is a new file, or --overwrite"),
        (["room.yaml", "--out", "x.yaml"], "room.yaml: format: found 'basenet-scene/2', allowed is 'basenet-scene/1'"),
        (["none.yaml", "--out", "x.yaml"], "none.yaml: can't be read: No such file or directory"),
        (["scene.yaml", "--out", "none/x.yaml"], "--out: none/x.yaml: can't be written: No such file or directory"),
    ],
    ids=range(4),
)
def test_bad_input_is_refused(call, tmp_path, arguments, said):
    assert call(*arguments) == (2, "", f"basenet_jax.convert: {said}\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["room.yaml", "scene.yaml"]


def test_a_file_is_replaced_where_that_is_asked_for(call):
    assert call("scene.yaml", "--out", "room.yaml", "--overwrite")[0] == 0
    assert load_scene("room.yaml").box_names == ("table",)


def test_help_teaches(call):
    code, out, _ = call("--help")
    assert code == 0
    assert all(word in out for word in ("SCENE", "--out", "--overwrite", "basenet-scene/2", "docked"))
