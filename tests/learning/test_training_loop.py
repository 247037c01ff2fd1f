import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import pytest

from basenet_jax.learning import checkpoint
from basenet_jax.learning.checkpoint import CheckpointError
from basenet_jax.learning.run_directory import RunDirectory
from basenet_jax.learning.training_loop import Interrupted, TrainingDiverged
from tests.learning import toy_training
from tests.learning.toy_training import bits, train

Interval = Callable[[toy_training.State], tuple[toy_training.State, dict[str, Any]]]


def expected_state(intervals: int) -> toy_training.State:
    state = jax.jit(toy_training.init)(jax.random.key(0))
    for _ in range(intervals):
        state, _ = toy_training.interval(state)
    return state


def intervals_of(run: Path) -> list[int]:
    return [json.loads(line)["interval"] for line in (run / "metrics.jsonl").read_text().splitlines()]


def checkpoints_of(run: Path) -> list[str]:
    return sorted(path.name for path in (run / "checkpoints" / "toy").iterdir())


def on_interval(number: int, act: Callable[[], None], changes: dict[str, Any] | None = None) -> Interval:
    """The toy's interval that does something, and changes its metrics, in its n-th call."""
    calls = 0

    def interval(state: toy_training.State) -> tuple[toy_training.State, dict[str, Any]]:
        nonlocal calls
        calls += 1
        state, metrics = toy_training.interval(state)
        if calls == number:
            act()
            metrics |= changes or {}
        return state, metrics

    return interval


def kill_self(times: int = 1, number: int = signal.SIGTERM) -> Callable[[], None]:
    def act() -> None:
        for _ in range(times):
            os.kill(os.getpid(), number)

    return act


def test_a_run_records_saves_and_returns_what_the_learner_computes(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, {}) as run:
        state = train(run, intervals=5)
    assert bits(state) == bits(expected_state(5))
    assert intervals_of(tmp_path) == [1, 2, 3, 4, 5]
    assert checkpoints_of(tmp_path) == ["000004", "000005"]
    restored = checkpoint.restore_latest(run.checkpoints("toy"), state)
    assert restored is not None
    assert bits(restored.state) == bits(state)
    assert restored.metadata == {"layer": "toy", "interval": 5, "config": run.config_hash}


def test_a_finished_run_is_resumed_without_running(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, {}) as run:
        train(run, intervals=2)
    with RunDirectory(tmp_path, {}, resume=True) as run:
        never = on_interval(1, lambda: pytest.fail("ran"))
        assert bits(train(run, intervals=2, resume=True, interval=never)) == bits(expected_state(2))
    assert intervals_of(tmp_path) == [1, 2]


def test_checkpoints_come_every_few_intervals_and_at_the_end(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, {}) as run:
        train(run, intervals=7, checkpoint_every=3, checkpoints_kept=9)
    assert checkpoints_of(tmp_path) == ["000003", "000006", "000007"]


@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_a_metric_that_is_no_finite_number_stops_the_run(tmp_path: Path, value: float) -> None:
    bad = on_interval(3, lambda: None, {"critic_loss": jnp.float32(value)})
    with RunDirectory(tmp_path, {}) as run, pytest.raises(TrainingDiverged) as caught:
        train(run, intervals=5, interval=bad)
    good = tmp_path / "checkpoints" / "toy" / "000002"
    message = f"toy: training diverged: critic_loss is {value} in interval 3; the last good state is {good}"
    assert str(caught.value) == message
    assert checkpoints_of(tmp_path) == ["000001", "000002"]
    assert intervals_of(tmp_path) == [1, 2]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_lets_the_interval_end_and_saves_it(
    tmp_path: Path, number: int, capfd: pytest.CaptureFixture[str]
) -> None:
    handlers = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)]
    with RunDirectory(tmp_path, {}) as run, pytest.raises(Interrupted) as caught:
        train(run, intervals=5, checkpoint_every=4, interval=on_interval(2, kill_self(1, number)))
    resume = f"resume with --run-dir {tmp_path} --resume"
    assert str(caught.value) == f"toy: interrupted, saved up to interval 2 of 5; {resume}"
    assert checkpoints_of(tmp_path) == ["000002"]
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == handlers
    with RunDirectory(tmp_path, {}, resume=True) as run:
        assert bits(train(run, intervals=5, resume=True)) == bits(expected_state(5))
    assert intervals_of(tmp_path) == [1, 2, 3, 4, 5]
    assert "toy: resuming after interval 2 of 5" in capfd.readouterr().err


def test_a_second_signal_stops_at_once_and_leaves_the_state_before(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, {}) as run, pytest.raises(Interrupted, match="saved up to interval 1 of 5"):
        train(run, intervals=5, interval=on_interval(2, kill_self(2)))
    assert checkpoints_of(tmp_path) == ["000001"]
    with RunDirectory(tmp_path / "other", {}) as run, pytest.raises(Interrupted, match="before its first checkpoint"):
        train(run, intervals=5, interval=on_interval(1, kill_self(2)))


def test_a_signal_in_the_last_interval_still_stops_the_program(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, {}) as run, pytest.raises(Interrupted, match="saved up to interval 2 of 2"):
        train(run, intervals=2, interval=on_interval(2, kill_self()))


def test_an_ignored_signal_stays_ignored(tmp_path: Path) -> None:
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with RunDirectory(tmp_path, {}) as run:
            train(run, intervals=2, interval=on_interval(1, kill_self(1, signal.SIGINT)))
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, previous)


def test_a_damaged_checkpoint_is_passed_over_and_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with RunDirectory(tmp_path, {}) as run:
        train(run, intervals=5)
        records = (tmp_path / "metrics.jsonl").read_bytes()
        (run.checkpoints("toy") / "000005" / "description.json").write_bytes(b"{}")
    with RunDirectory(tmp_path, {}, resume=True) as run:
        assert bits(train(run, intervals=5, resume=True)) == bits(expected_state(5))
    note = "toy: checkpoint 000005 is damaged (description.json differs from its manifest); using 000004"
    assert note in capfd.readouterr().err.splitlines()
    assert (tmp_path / "metrics.jsonl").read_bytes() == records


def test_checkpoints_of_another_configuration_are_refused(tmp_path: Path) -> None:
    with RunDirectory(tmp_path / "a", {"rate": 1}) as run:
        train(run, intervals=1)
    with RunDirectory(tmp_path / "b", {"rate": 2}) as run:
        (tmp_path / "a" / "checkpoints").rename(tmp_path / "b" / "checkpoints")
        with pytest.raises(CheckpointError, match="made with another configuration"):
            train(run, intervals=2, resume=True)


def test_metrics_that_cannot_be_written_stop_the_run_before_the_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    with RunDirectory(tmp_path, {}) as run:
        monkeypatch.setattr(run, "log", fail)
        with pytest.raises(CheckpointError, match="metrics can't be written: No space left on device"):
            train(run, intervals=1)
    assert not (tmp_path / "checkpoints").exists()


def test_an_array_may_stand_twice_in_the_first_state(tmp_path: Path) -> None:
    def init(key: jax.Array) -> toy_training.State:
        state = toy_training.init(key)
        weights = state.params["w"]
        return state._replace(optimiser=(toy_training.Momentum(weights, jnp.int32(0)), None), key=key)

    with RunDirectory(tmp_path, {}) as run:
        key = jax.random.key(5)
        train(run, intervals=1, init=init, seed=5)
        jax.random.key_data(key)


def test_only_the_figures_asked_for_are_shown(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with RunDirectory(tmp_path, {}) as run:
        train(run, intervals=1, figures=["steps"])
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "1/1" in line]
    assert line.endswith(" elapsed, steps 0")
