"""Checkpoints that are damaged, or of something else."""

import shutil
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.learning import checkpoint
from basenet_jax.learning.checkpoint import CheckpointError
from tests.learning.test_checkpoint import SMALL, files_of, restore, steps


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize("damage", [flip, cut, Path.unlink])
def test_any_damaged_file_makes_the_checkpoint_before_be_used(tmp_path: Path, damage: Any) -> None:
    pristine, directory = tmp_path / "pristine", tmp_path / "damaged"
    for step in (11, 12):
        checkpoint.save(pristine, step, {"w": SMALL["w"] + step, "n": SMALL["n"]}, {})
    names = [path.relative_to(pristine) for path in files_of(pristine / "000012")]
    assert len(names) > 5
    for name in names:
        shutil.copytree(pristine, directory)
        damage(directory / name)
        restored = restore(directory, SMALL)
        assert restored.step == 11
        np.testing.assert_array_equal(restored.state["w"], SMALL["w"] + 11)
        (note,) = restored.notes
        assert note.startswith("checkpoint 000012 is ")
        assert note.endswith("; using 000011")
        shutil.rmtree(directory)


def test_the_note_names_the_damaged_file(tmp_path: Path) -> None:
    for step in (11, 12):
        checkpoint.save(tmp_path, step, SMALL, {})
    flip(tmp_path / "000012/state/_METADATA")
    (note,) = restore(tmp_path, SMALL).notes
    assert note == "checkpoint 000012 is damaged (state/_METADATA differs from its manifest); using 000011"
    (tmp_path / "000012/manifest.sha256").unlink()
    (note,) = restore(tmp_path, SMALL).notes
    assert note == "checkpoint 000012 is incomplete (it has no manifest); using 000011"


def test_a_manifest_that_lost_lines_is_found(tmp_path: Path) -> None:
    for step in (11, 12):
        checkpoint.save(tmp_path, step, SMALL, {})
    manifest = tmp_path / "000012" / "manifest.sha256"
    manifest.write_text("".join(manifest.read_text().splitlines(keepends=True)[1:]))
    (note,) = restore(tmp_path, SMALL).notes
    assert note == "checkpoint 000012 is damaged (description.json isn't in its manifest); using 000011"
    manifest.write_text("")
    assert restore(tmp_path, SMALL).step == 11


def test_where_all_are_damaged_one_message_says_so(tmp_path: Path) -> None:
    for step in (11, 12):
        checkpoint.save(tmp_path, step, SMALL, {})
    for folder in tmp_path.iterdir():
        flip(folder / "description.json")
    with pytest.raises(CheckpointError) as caught:
        checkpoint.restore_latest(tmp_path, SMALL)
    damaged = "is damaged (description.json differs from its manifest)"
    assert str(caught.value) == (
        f"{tmp_path}: no checkpoint can be used: checkpoint 000012 {damaged}; checkpoint 000011 {damaged}"
    )


def test_a_damaged_checkpoint_does_not_displace_the_one_fallen_back_on(tmp_path: Path) -> None:
    for step in (1, 2):
        checkpoint.save(tmp_path, step, SMALL, {})
    flip(tmp_path / "000002/description.json")
    checkpoint.save(tmp_path, 3, SMALL, {})
    assert steps(tmp_path) == ["000001", "000003"]


@pytest.mark.parametrize(
    ("like", "found", "needed"),
    [
        (SMALL | {"w": jnp.zeros((3, 2))}, "w: float32[2, 3]", "w: float32[3, 2]"),
        (SMALL | {"n": jnp.float32(0)}, "n: int32[]", "n: float32[]"),
        (SMALL | {"v": jnp.zeros(1)}, "nothing more", "v: float32[1]"),
        ({"w": SMALL["w"]}, "n: int32[]", "nothing more"),
    ],
)
def test_a_state_of_another_shape_is_not_used(tmp_path: Path, like: Any, found: str, needed: str) -> None:
    checkpoint.save(tmp_path, 1, SMALL, {})
    with pytest.raises(CheckpointError) as caught:
        checkpoint.restore_latest(tmp_path, like)
    assert f"checkpoint 000001 is of another state (found {found}, needs {needed})" in str(caught.value)
