import errno
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from basenet_jax.learning import checkpoint
from basenet_jax.learning.checkpoint import CheckpointError, Restored
from tests.learning import toy_training
from tests.learning.toy_training import bits

SMALL = {"w": jnp.arange(6.0).reshape(2, 3), "n": jnp.int32(7)}


def steps(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


def restore(directory: Path, like: Any) -> Restored:
    restored = checkpoint.restore_latest(directory, like)
    assert restored is not None
    return restored


def files_of(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def test_a_restored_state_is_the_saved_one_to_the_bit(tmp_path: Path, toy_state: toy_training.State) -> None:
    checkpoint.save(tmp_path, 3, toy_state, {"layer": "toy", "interval": 3})
    for like in (toy_state, jax.eval_shape(toy_training.init, jax.random.key(1))):
        restored = restore(tmp_path, like)
        assert bits(restored.state) == bits(toy_state)
        assert restored[1:] == (3, {"layer": "toy", "interval": 3}, [])


def test_a_restored_state_runs_the_program_compiled_before(tmp_path: Path, toy_state: toy_training.State) -> None:
    traces = []

    def program(state: toy_training.State) -> toy_training.State:
        traces.append(1)
        return jax.tree.map(lambda leaf: leaf, state)

    step = jax.jit(program, donate_argnums=0)
    checkpoint.save(tmp_path, 3, toy_state, {})
    step(jax.tree.map(jnp.copy, toy_state))
    for _ in range(2):
        result = step(restore(tmp_path, toy_state).state)  # its buffers are the program's to take
        assert bits(result) == bits(toy_state)
    assert len(traces) == 1


def test_every_kind_of_leaf_comes_back(tmp_path: Path) -> None:
    odd = np.array([np.nan, -0.0, np.inf, 1e-42, np.uint32(0x7FC01234).view(np.float32)], np.float32)
    state = {
        "odd": jnp.array(odd),
        "bool": jnp.array([[True], [False]]),
        "int8": jnp.int8(-3),
        "bfloat16": jnp.array([1.5, -2.0], jnp.bfloat16),
        "empty": jnp.zeros((0, 3), jnp.int32),
        "weak": jnp.broadcast_to(jnp.asarray(2.5), (2,)),
        "keys": jax.random.split(jax.random.key(1, impl="rbg"), (2, 3)),
        "number": 5,
        "nothing": None,
    }
    checkpoint.save(tmp_path, 0, state, {})
    expected = jax.tree.map(jnp.asarray, state)
    restored = restore(tmp_path, state).state
    assert bits(restored) == bits(expected)
    assert restored["keys"].dtype == state["keys"].dtype


def test_devices_are_kept_where_the_expected_state_is_committed(tmp_path: Path) -> None:
    device = jax.devices()[0]
    committed = jax.device_put(SMALL, device)
    checkpoint.save(tmp_path, 0, SMALL, {})
    assert restore(tmp_path, committed).state["w"].committed
    assert not restore(tmp_path, SMALL).state["w"].committed


def test_only_the_newest_stay(tmp_path: Path) -> None:
    for step in range(1, 5):
        assert checkpoint.save(tmp_path, step, SMALL, {}) == tmp_path / f"{step:06d}"
    assert steps(tmp_path) == ["000003", "000004"]
    checkpoint.save(tmp_path, 5, SMALL, {}, keep=1)
    assert steps(tmp_path) == ["000005"]


def test_an_earlier_step_removes_the_later(tmp_path: Path) -> None:
    for step in (1, 9, 5):
        checkpoint.save(tmp_path, step, SMALL, {"step": step})
    assert steps(tmp_path) == ["000001", "000005"]
    assert restore(tmp_path, SMALL).step == 5


def test_the_same_step_is_replaced(tmp_path: Path) -> None:
    checkpoint.save(tmp_path, 1, SMALL, {"try": 1})
    checkpoint.save(tmp_path, 1, SMALL, {"try": 2})
    assert restore(tmp_path, SMALL).metadata == {"try": 2}


def test_leftovers_are_ignored_and_then_removed(tmp_path: Path) -> None:
    checkpoint.save(tmp_path, 1, SMALL, {})
    shutil.copytree(tmp_path / "000001", tmp_path / "000002.partial")
    assert restore(tmp_path, SMALL)[1:] == (1, {}, [])
    checkpoint.save(tmp_path, 2, SMALL, {})
    assert steps(tmp_path) == ["000001", "000002"]


def test_without_checkpoints_there_is_nothing_to_restore(tmp_path: Path) -> None:
    assert checkpoint.restore_latest(tmp_path / "missing", SMALL) is None
    (tmp_path / "000001.partial").mkdir()
    assert checkpoint.restore_latest(tmp_path, SMALL) is None


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


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="needs sha256sum")
def test_the_manifest_is_understood_by_sha256sum(tmp_path: Path) -> None:
    folder = checkpoint.save(tmp_path, 1, SMALL, {})
    command = ["sha256sum", "--check", "--strict", "manifest.sha256"]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    assert result.stdout.count(": OK") == len(files_of(folder)) - 1


def assert_full_disk_is_told(directory: Path, state: Any, *, megabytes: str) -> None:
    with pytest.raises(CheckpointError) as caught:
        checkpoint.save(directory, 2, state, {})
    message = str(caught.value)
    assert message.startswith(f"{directory}: the disk is full: a checkpoint needs up to {megabytes} MB, ")
    assert message.endswith(" MB are free; earlier checkpoints are as they were")
    assert "\n" not in message
    assert steps(directory) == ["000001"]
    assert restore(directory, SMALL).notes == []


def test_too_little_space_is_found_before_anything_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkpoint.save(tmp_path, 1, SMALL, {})
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1e5))
    monkeypatch.setattr(checkpoint, "write_arrays", lambda *_: pytest.fail("written"))
    assert_full_disk_is_told(tmp_path, {"w": jnp.zeros(10**6)}, megabytes="4.1")


@pytest.mark.parametrize(
    ("step", "error"),
    [
        ("write_arrays", ValueError('RESOURCE_EXHAUSTED: Error writing "0/0.0": No space left on device')),
        ("write_manifest", OSError(errno.ENOSPC, "No space left on device")),
        ("sync", OSError(errno.EDQUOT, "Disk quota exceeded")),
    ],
)
def test_a_disk_that_fills_while_saving_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str, error: Exception
) -> None:
    def fail(*_: Any) -> None:
        raise error

    checkpoint.save(tmp_path, 1, SMALL, {})
    monkeypatch.setattr(checkpoint, step, fail)
    with pytest.raises(CheckpointError, match="the disk is full"):
        checkpoint.save(tmp_path, 2, SMALL, {})
    assert not list(tmp_path.glob("*.partial"))
    assert (tmp_path / "000001").exists()
    assert restore(tmp_path, SMALL).notes == []


def test_a_disk_that_is_really_full(
    tiny_disk: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    directory = tiny_disk / "checkpoints"
    checkpoint.save(directory, 1, SMALL, {})
    big = {"w": jax.random.normal(jax.random.key(0), (500_000,))}  # incompressible
    assert_full_disk_is_told(directory, big, megabytes="2.1")
    usage = shutil.disk_usage(directory)
    monkeypatch.setattr(checkpoint.shutil, "disk_usage", lambda _: SimpleNamespace(free=1e12, total=usage.total))
    assert_full_disk_is_told(directory, big, megabytes="2.1")
    assert capfd.readouterr() == ("", "")


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CheckpointError, match=r"a checkpoint can't be written: .*File exists"):
        checkpoint.save(tmp_path / "file", 1, SMALL, {})
