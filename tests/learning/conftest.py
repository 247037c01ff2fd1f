import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest

from tests.learning import toy_training


@pytest.fixture(scope="session")
def toy_state() -> toy_training.State:
    """After three intervals. Not to be given to `interval`, which would take its buffers."""
    state = jax.jit(toy_training.init)(jax.random.key(0))
    for _ in range(3):
        state, _ = toy_training.interval(state)
    return state


@pytest.fixture(autouse=True)
def interruptible() -> Iterator[None]:
    """A shell's background jobs are born deaf to SIGINT, and an ignored signal stays ignored: not so in these tests."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of one megabyte."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", os.fspath(disk)]
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("mounting a file system takes Linux and root")
    yield disk
    subprocess.run(["umount", "--lazy", os.fspath(disk)], check=True)
