"""Disks that are full, or can't be written for another reason."""

import errno
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import pytest

from basenet_jax.learning import checkpoint
from basenet_jax.learning.checkpoint import CheckpointError
from tests.learning.test_checkpoint import SMALL, restore, steps


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
    monkeypatch.setattr(checkpoint, "_write_arrays", lambda *_: pytest.fail("written"))
    assert_full_disk_is_told(tmp_path, {"w": jnp.zeros(10**6)}, megabytes="4.1")


@pytest.mark.parametrize(
    ("step", "error"),
    [
        ("_write_arrays", ValueError('RESOURCE_EXHAUSTED: Error writing "0/0.0": No space left on device')),
        ("_write_manifest", OSError(errno.ENOSPC, "No space left on device")),
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
    tiny_disk: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    directory = tiny_disk / "checkpoints"
    checkpoint.save(directory, 1, SMALL, {})
    big = {"w": jax.random.normal(jax.random.key(0), (500_000,))}  # incompressible
    assert_full_disk_is_told(directory, big, megabytes="2.1")
    usage = shutil.disk_usage(directory)
    monkeypatch.setattr(checkpoint.shutil, "disk_usage", lambda _: SimpleNamespace(free=1e12, total=usage.total))
    assert_full_disk_is_told(directory, big, megabytes="2.1")
    assert capfd.readouterr() == ("", "")
    assert not caplog.records


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CheckpointError, match=r"a checkpoint can't be written: .*File exists"):
        checkpoint.save(tmp_path / "file", 1, SMALL, {})
