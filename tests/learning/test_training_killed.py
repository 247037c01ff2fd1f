"""Trainings in processes of their own, killed and interrupted from outside."""

import functools
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import pytest

from basenet_jax.learning import checkpoint
from basenet_jax.learning.run_directory import RunDirectory
from tests.learning import toy_training
from tests.learning.toy_training import bits, train


def start(run: Path, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tests.learning.toy_training", os.fspath(run), *options]
    root = Path(__file__).parents[2]
    return subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(condition: Callable[[], Any], process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 60
    while not condition() and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.001)


def has_progressed(run: Path) -> Callable[[], bool]:
    """Whether there are more records than now."""
    file = run / "metrics.jsonl"
    before = file.read_bytes().count(b"\n") if file.exists() else 0
    return lambda: file.exists() and file.read_bytes().count(b"\n") > before


def run_and_kill(run: Path, options: tuple[str, ...], moment: str) -> None:
    """Runs until at least one more record, then kills at a moment: of its own, while saving, or after some seconds."""
    own = moment in ("before", "after")
    with start(run, *options, *(["--die", moment] if own else [])) as process:
        wait_for(has_progressed(run), process)
        if moment == "saving":
            wait_for(lambda: list(run.glob("checkpoints/toy/*.partial/state")), process)
        elif not own:
            time.sleep(float(moment))
        if not own:
            process.kill()
        process.communicate()
    assert process.returncode == -signal.SIGKILL


def assert_ends_as_undisturbed(folder: Path, moments: list[str], intervals: int) -> None:
    options = ("--intervals", str(intervals), "--replay", "100000")
    whole, killed = folder / "whole", folder / "killed"
    for moment in moments:
        run_and_kill(killed, options, moment)
    with start(killed, *options) as process:
        _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert "toy: resuming after interval" in errors
    init = functools.partial(toy_training.init, replay=100_000)
    with RunDirectory(whole, {"seed": 0}) as run:
        state = train(run, intervals=intervals, init=init)
    restored = checkpoint.restore_latest(killed / "checkpoints" / "toy", jax.eval_shape(init, jax.random.key(0)))
    assert restored is not None
    assert restored.step == intervals
    assert bits(restored.state) == bits(state)
    assert (killed / "metrics.jsonl").read_bytes() == (whole / "metrics.jsonl").read_bytes()
    folders = [sorted(path.name for path in (run / "checkpoints/toy").iterdir()) for run in (killed, whole)]
    assert folders[0] == folders[1] == [f"{intervals - 1:06d}", f"{intervals:06d}"]


def test_a_run_killed_while_saving_ends_as_one_that_never_was(tmp_path: Path) -> None:
    assert_ends_as_undisturbed(tmp_path, ["before", "saving", "after"], 12)


@pytest.mark.slow
def test_a_run_killed_at_random_ends_as_one_that_never_was(tmp_path: Path) -> None:
    draw = random.Random(0)
    moments = [str(draw.uniform(0.0, 0.5)) for _ in range(8)] + ["saving", "before", "after"]
    draw.shuffle(moments)
    assert_ends_as_undisturbed(tmp_path, moments, 80)


def test_signals_are_heard_while_an_interval_runs(tmp_path: Path) -> None:
    with start(tmp_path / "run", "--intervals", "1", "--long") as process:
        assert process.stderr is not None
        while "first interval" not in process.stderr.readline():
            assert process.poll() is None
        time.sleep(1.0)  # so that it is compiled and runs
        process.send_signal(signal.SIGINT)
        assert "stopping after this interval" in process.stderr.readline()
        process.send_signal(signal.SIGTERM)
        assert process.stdout is not None
        message = process.stdout.readline()
        process.kill()  # at its exit JAX waits for the interval
    assert message.startswith("toy: interrupted, before its first checkpoint; resume with --run-dir ")
