"""The train command: what it refuses, what it leaves behind, and that a killed run ends like one that wasn't."""

import contextlib
import io
import json
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from basenet_jax import train
from basenet_jax.learning import checkpoint
from basenet_jax.policies.trained import load_policies, load_stops
from tests import tiny_training

ROOT = Path(__file__).parents[1]
SIZES = ["--objects", "3", "--seed", "5"]


def call(capsys, *arguments):
    """Exit code, stdout and stderr of the command."""
    try:
        code = tiny_training.main(list(arguments))
    except SystemExit as end:  # tyro ends so on --help and wrong options
        code = end.code
    return code, *capsys.readouterr()


def weights_of(run):
    return {file.name: file.read_bytes() for file in (run / "weights").iterdir()}


def records_of(run):
    return [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The run directory of a whole tiny training, and what was said on stdout and stderr."""
    run = tmp_path_factory.mktemp("runs") / "finished"
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = tiny_training.main([*SIZES, "--run-dir", str(run)])
    assert code == 0, err.getvalue()
    return run, out.getvalue(), err.getvalue()


@pytest.mark.parametrize("objects", ["0", "51", "-3"])
def test_a_number_of_objects_out_of_range_is_refused(capsys, objects):
    code, out, err = call(capsys, "--objects", objects)
    assert (code, out) == (2, "")
    assert err == f"basenet_jax.train: --objects: found {objects}, allowed are 1 to 50\n"


def test_an_unknown_preset_is_refused_and_the_known_ones_named(capsys):
    code, out, err = call(capsys, "--preset", "fast")
    assert (code, out) == (2, "")
    assert all(word in err for word in ("fast", "quick", "default", "paper"))


def test_resume_needs_a_directory_that_holds_a_run(capsys, tmp_path):
    code, _, err = call(capsys, "--resume")
    assert code == 2
    assert "--run-dir" in err
    code, _, err = call(capsys, "--resume", "--run-dir", str(tmp_path / "none"))
    assert code == 2
    assert "no run to resume" in err


def test_help_teaches(capsys):
    code, out, _ = call(capsys, "--help")
    assert code == 0
    assert all(word in out for word in ("--objects", "--preset", "--resume", "default: 10", "seconds"))


def test_a_training_leaves_what_it_should(finished):
    run, out, err = finished
    for name in ("config.json", "metrics.jsonl", "summary.json", "checkpoints", "weights", "tensorboard"):
        assert (run / name).exists(), name
    summary = json.loads((run / "summary.json").read_text())
    assert 0.0 <= summary["single_pick_success"] <= 1.0
    assert set(summary["plans"]["2"]) == {"basenet", "basenet-paper", "nearest", "random"}
    layers = [(record["layer"], record["interval"]) for record in records_of(run)]
    assert layers == [(layer, i) for layer in ("base-pose", "sequence", "stops") for i in range(1, 5)]
    assert "single-pick success" in out
    assert "base-pose: 4/4" in err


def test_its_weights_are_read_as_those_of_its_own_networks(finished):
    weights = load_policies(finished[0] / "weights" / "basenet.weights")
    assert [len(bias) for bias in weights.base_pose.biases] == [32, 32, 8]
    assert (weights.sequence_network.features, weights.sequence_network.layers) == (8, 2)
    policy, _ = load_stops(finished[0] / "weights" / "stops.weights")
    assert (policy.features, policy.layers) == (8, 1)


def test_a_finished_run_is_not_trained_over(capsys, finished):
    run, *_ = finished
    before = weights_of(run)
    code, _, err = call(capsys, *SIZES, "--run-dir", str(run))
    assert code == 2
    assert "holds a run already" in err
    assert weights_of(run) == before


def test_resuming_with_other_settings_is_refused_by_name(capsys, finished):
    run, *_ = finished
    code, _, err = call(capsys, "--objects", "4", "--seed", "5", "--run-dir", str(run), "--resume")
    assert code == 2
    assert "reinforce.objects" in err


@pytest.mark.slow  # four processes that load all programs
def test_a_run_killed_in_every_layer_and_resumed_ends_bit_for_bit_the_same(finished, tmp_path):
    reference, *_ = finished
    run = tmp_path / "killed"
    command = [sys.executable, "-m", "tests.tiny_training", *SIZES, "--run-dir", str(run)]
    for layer, interval in (("base-pose", 2), ("sequence", 1), ("stops", 1)):
        process = subprocess.Popen(
            [*command, "--resume"] if run.exists() else command, cwd=ROOT, stderr=subprocess.DEVNULL
        )
        while not any((run / "checkpoints" / layer).glob(f"{interval:06d}*")):
            assert process.poll() is None, "it ended before it could be killed"
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
    subprocess.run([*command, "--resume"], cwd=ROOT, check=True, capture_output=True)
    assert weights_of(run) == weights_of(reference)
    assert records_of(run) == records_of(reference)
    assert json.loads((run / "summary.json").read_text()) == json.loads((reference / "summary.json").read_text())


def test_an_evaluation_that_is_interrupted_says_how_to_resume(capsys, monkeypatch, finished, tmp_path):
    run = shutil.copytree(finished[0], tmp_path / "my run")

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("basenet_jax.evaluation.summary.summarise", interrupted)
    code, out, err = call(capsys, *SIZES, "--run-dir", str(run), "--resume", "--devices", "1")
    said, command = err.splitlines()[-2:]
    assert (code, out, said) == (130, "", "basenet_jax.train: interrupted; to resume:")
    assert command.startswith("python -m basenet_jax.train --robot ur5e_mobile --layer all ")
    assert shlex.split(command)[-5:] == ["--devices", "1", "--run-dir", str(run), "--resume"]


def test_an_interruption_before_there_is_a_run_says_so(capsys, monkeypatch, tmp_path):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("basenet_jax.robot.reading.load_robot", interrupted)
    code, _, err = call(capsys, *SIZES, "--run-dir", str(tmp_path / "run"))
    assert (code, err) == (130, "basenet_jax.train: interrupted before there was a run\n")
    assert not (tmp_path / "run").exists()


def test_a_loss_that_is_no_number_stops_the_training_and_is_named(capsys, monkeypatch, tmp_path):
    from basenet_jax.learning.sac import Sac

    def poisoned(self, state):
        return state, {"critic_loss": np.float32("nan"), "success": np.float32(0.5)}

    monkeypatch.setattr(Sac, "interval", poisoned)
    code, _, err = call(capsys, *SIZES, "--run-dir", str(tmp_path / "run"))
    assert code == 1
    assert "critic_loss is nan" in err


class Died(BaseException):
    """Nothing in the package catches it."""


@pytest.fixture
def dying(monkeypatch):
    """Has the next training die once it has saved a layer's state after an interval."""
    save, moments = checkpoint.save, []

    def save_and_die(folder, interval, *more):
        save(folder, interval, *more)
        if (folder.name, interval) in moments:
            moments.clear()
            raise Died

    monkeypatch.setattr(checkpoint, "save", save_and_die)
    return moments


def test_layers_trained_one_by_one_each_having_died_are_bit_for_bit_those_of_one_run(capsys, tmp_path, finished, dying):
    reference, *_ = finished
    run = tmp_path / "layered"
    left = set()
    for layer, name, interval in (("stops", "stops", 1), ("base-pose", "base_pose", 2), ("sequence", "sequence", 3)):
        more = ["--resume"] if left else []
        dying.append((layer, interval))
        with pytest.raises(Died):
            pytest.fail(str(call(capsys, *SIZES, "--run-dir", str(run), "--layer", layer, *more)))
        code, out, err = call(capsys, *SIZES, "--run-dir", str(run), "--layer", layer, "--resume")
        assert code == 0, err
        assert f"{layer}: resuming after interval {interval} of 4" in err
        assert ("single-pick success" in out) == (layer != "stops")
        left |= {f"{name}.weights"} | ({"basenet.weights"} if layer == "sequence" else set())
        assert set(weights_of(run)) == left
    assert weights_of(run) == weights_of(reference)
    ours, theirs = (sorted(records_of(each), key=lambda record: record["layer"]) for each in (run, reference))
    assert ours == theirs
    assert json.loads((run / "summary.json").read_text()) == json.loads((reference / "summary.json").read_text())


def test_the_sequence_alone_needs_base_pose_weights(capsys, tmp_path):
    code, _, err = call(capsys, *SIZES, "--run-dir", str(tmp_path / "run"), "--layer", "sequence")
    assert code == 2
    assert "base_pose.weights: found no such file, which --layer sequence needs" in err
    assert not list(tmp_path.iterdir())


def test_main_module_is_the_command():
    assert train.Arguments.__doc__
    done = subprocess.run(
        [sys.executable, "-m", "basenet_jax.train", "--objects", "0"], capture_output=True, check=False
    )
    assert done.returncode == 2


def test_importing_the_learners_says_nothing():
    done = subprocess.run(
        [sys.executable, "-c", "import basenet_jax.learning.training"], capture_output=True, check=True
    )
    assert (done.stdout, done.stderr) == (b"", b"")
