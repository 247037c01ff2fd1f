import json
import re
import struct
import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]

from basenet_jax.learning.run_directory import RunDirectory, RunDirectoryError, default_path


@dataclass(frozen=True)
class Learner:
    rate: float = 1e-3
    layers: tuple[int, ...] = (64, 64)


@dataclass(frozen=True)
class Config:
    preset: str = "quick"
    seed: int = 0
    learner: Learner = field(default_factory=Learner)


def records(run: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]


def events(folder: Path) -> list[Any]:
    """The events of all files of a folder, in the order they were written."""
    found = []
    for file in folder.iterdir():
        data, place = file.read_bytes(), 0
        while place < len(data):  # a record: length, checksum of it, content, checksum of that
            (length,) = struct.unpack_from("<Q", data, place)
            found.append(Event.FromString(data[place + 12 : place + 12 + length]))
            place += 16 + length
    return sorted(found, key=lambda event: event.wall_time)


def test_the_default_path_is_preset_seed_and_time() -> None:
    assert re.fullmatch(r"runs/quick-7-\d{8}-\d{6}", default_path("quick", 7).as_posix())


def test_a_new_run_holds_its_configuration(tmp_path: Path) -> None:
    with RunDirectory(tmp_path / "runs" / "a", Config()) as run:
        assert run.path == tmp_path / "runs" / "a"
        assert run.weights.is_dir()
        assert run.checkpoints("base-pose") == run.path / "checkpoints" / "base-pose"
    stored = json.loads((tmp_path / "runs/a/config.json").read_text())
    assert stored == {"preset": "quick", "seed": 0, "learner": {"rate": 0.001, "layers": [64, 64]}}


def test_a_fresh_run_does_not_overwrite_another(tmp_path: Path) -> None:
    RunDirectory(tmp_path, Config()).close()
    message = f"{tmp_path}: holds a run already: continue it with --resume, or choose another --run-dir"
    for _ in range(2):
        with pytest.raises(RunDirectoryError) as caught:
            RunDirectory(tmp_path, Config())
        assert str(caught.value) == message
        (tmp_path / "config.json").unlink(missing_ok=True)
        (tmp_path / "checkpoints").mkdir(exist_ok=True)


def test_there_must_be_a_run_to_resume(tmp_path: Path) -> None:
    with pytest.raises(RunDirectoryError, match="there is no such directory, so no run to resume"):
        RunDirectory(tmp_path / "missing", Config(), resume=True)
    assert not (tmp_path / "missing").exists()
    with pytest.raises(RunDirectoryError, match=r"no run to resume: it has no config\.json"):
        RunDirectory(tmp_path, Config(), resume=True)
    RunDirectory(tmp_path, Config()).close()  # and the lock is free again


def test_a_run_is_resumed_with_its_own_configuration_only(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, Config()) as run:
        config_hash = run.config_hash
    with RunDirectory(tmp_path, Config(), resume=True) as run:
        assert run.config_hash == config_hash
    other = replace(Config(), seed=1, learner=Learner(layers=(64,)))
    with pytest.raises(RunDirectoryError) as caught:
        RunDirectory(tmp_path, other, resume=True)
    assert str(caught.value) == (
        f"{tmp_path}: the run's configuration differs: learner.layers is [64, 64] there and [64] here; "
        "seed is 0 there and 1 here: resume with the configuration of the run, or choose another --run-dir"
    )
    (tmp_path / "config.json").write_text("{")
    with pytest.raises(RunDirectoryError, match=r"config\.json: can't be read"):
        RunDirectory(tmp_path, Config(), resume=True)


def test_a_directory_in_use_is_refused_until_its_process_ends(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from basenet_jax.learning.run_directory import RunDirectory\n"
        "run = RunDirectory(Path(sys.argv[1]), {}); print('open', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code, tmp_path], stdout=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline() == "open\n"
            for resume in (False, True):
                with pytest.raises(RunDirectoryError) as caught:
                    RunDirectory(tmp_path, {}, resume=resume)
                hint = "wait until it ends, or choose another --run-dir"
                assert str(caught.value) == f"{tmp_path}: in use by another process: {hint}"
        finally:
            other.kill()
    RunDirectory(tmp_path, {}, resume=True).close()


def test_a_path_that_is_no_directory_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunDirectoryError, match="file: can't be used: File exists"):
        RunDirectory(tmp_path / "file", Config())


def test_a_resumed_layer_goes_on_without_duplicates(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, Config()) as run:
        for interval in (1, 2, 3):
            run.log("base-pose", interval, {"loss": interval / 3})
        run.log("sequence", 3, {"cost": 7.0})
    with (tmp_path / "metrics.jsonl").open("a") as stream:
        stream.write('{"layer": "base-pose", "inter')  # torn by a kill
    with RunDirectory(tmp_path, Config(), resume=True) as run:
        run.forget_after("base-pose", 1)
        run.log("base-pose", 2, {"loss": 0.25})
    assert records(tmp_path) == [
        {"layer": "base-pose", "interval": 1, "loss": 1 / 3},
        {"layer": "sequence", "interval": 3, "cost": 7.0},
        {"layer": "base-pose", "interval": 2, "loss": 0.25},
    ]


def test_a_last_line_without_its_end_is_torn_even_if_it_reads_well(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, Config()) as run:
        (tmp_path / "metrics.jsonl").write_text('{"layer": "a", "interval": 1}\n{"layer": "a", "interval": 2}')
        run.forget_after("a", 9)
    assert records(tmp_path) == [{"layer": "a", "interval": 1}]


def test_tensorboard_hears_the_same_and_drops_what_is_redone(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, Config()) as run:
        for interval in (1, 2):
            run.log("base-pose", interval, {"loss": 0.5 * interval, "success": 0.25})
        run.log("sequence", 1, {"cost": 7.0})
    with RunDirectory(tmp_path, Config(), resume=True) as run:
        run.forget_after("base-pose", 1)
        run.log("base-pose", 2, {"loss": 4.0})
    told = events(tmp_path / "tensorboard" / "base-pose")
    scalars = [(event.step, v.tag, v.simple_value) for event in told for v in event.summary.value]
    assert scalars == [
        (1, "loss", 0.5),
        (1, "success", 0.25),
        (2, "loss", 1.0),
        (2, "success", 0.25),
        (2, "loss", 4.0),
    ]
    restarts = [event.step for event in told if event.HasField("session_log")]
    assert restarts == [2]
    assert len(events(tmp_path / "tensorboard" / "sequence")) == 2  # the file's head and one scalar


def test_what_is_no_number_is_not_recorded(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, Config()) as run, pytest.raises(ValueError, match="not JSON compliant"):
        run.log("base-pose", 1, {"loss": float("nan")})


def fill(file: Path) -> None:
    with file.open("wb", buffering=0) as stream:
        while True:
            stream.write(bytes(4096))


def log_for_long(run: RunDirectory) -> None:
    for interval in range(2000):
        run.log("base-pose", interval, {"loss": 1.0})


def test_a_full_disk_is_an_error_and_not_a_deadlock(tiny_disk: Path) -> None:
    with RunDirectory(tiny_disk / "run", Config()) as run:
        run.log("base-pose", 1, {"loss": 1.0})
        with pytest.raises(OSError, match="No space left"):
            fill(tiny_disk / "filler")
        with pytest.raises(OSError, match="No space left"):
            log_for_long(run)
        (tiny_disk / "filler").unlink()


def test_the_summary_is_written_whole(tmp_path: Path) -> None:
    with RunDirectory(tmp_path, Config()) as run:
        for success in (0.5, 0.75):
            run.write_summary({"single_pick_success": success})
        assert json.loads((tmp_path / "summary.json").read_text()) == {"single_pick_success": 0.75}
    assert not list(tmp_path.glob("*.tmp"))
