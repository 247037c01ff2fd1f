"""Benchmarks say how to get their figures again, and their statistics are right."""

import importlib.util
import json
import sys
import time
import types

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from benchmarks import __main__ as every
from benchmarks import environment, harness, navigation, peers, timing
from benchmarks.paired import CONFIDENCE, bootstrap_interval, paired_difference
from tests.test_imports import MACHINE_PATH


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The file of the cheapest benchmark at its tiny size."""
    file = tmp_path_factory.mktemp("results") / "some" / "navigation.json"
    navigation.main(["--quick", "--out", str(file)])
    return file.read_text(encoding="utf-8")


def test_a_result_says_how_to_get_it_again(written):
    report = json.loads(written)
    assert report["benchmark"] == "navigation"
    assert report["command"] == "python -m benchmarks.navigation --quick --out some/navigation.json"
    assert time.strptime(report["date"], "%Y-%m-%dT%H:%M:%SZ")
    assert report["commit"].keys() == {"hash", "dirty"}
    assert report["options"] == {"quick": True, "out": "some/navigation.json", "repeats": 2, "seed": 0}
    assert report["hardware"].keys() >= {"cpu", "cores", "memory_gib", "accelerator"}
    assert report["versions"].keys() >= {"python", "jax", "jaxlib", "mujoco", "brax", "flax"}
    assert report["load_average_at_start"] >= 0
    assert isinstance(report["compilation_cache"], bool)


def test_a_result_has_figures(written):
    rows = json.loads(written)["results"]
    assert {row["what"] for row in rows} == {"outer product 16 x 16", "element by element"}
    for row in rows:
        run, rate = row["run_s"], row["rate"]
        assert 0 < run["min"] <= run["q1"] <= run["median"] <= run["q3"] <= run["max"]
        assert rate["q1"] <= rate["median"] <= rate["q3"]
        assert rate["median"] == pytest.approx(row["pairs"] / run["median"])
        assert row["compile_s"] > 0
        assert row["repeats"] == 2
        assert row["reachable_share"] > 0.9


def test_a_result_holds_no_machine_path(written):
    assert not MACHINE_PATH.search(written)


def test_a_quick_run_writes_nothing_by_itself(tmp_path, monkeypatch):
    monkeypatch.setattr(harness, "RESULTS", tmp_path)
    options = harness.parse(harness.Options, "some", None, ["--quick"])
    harness.Report("some", options, []).finish([], table=harness.Table())
    assert not list(tmp_path.iterdir())
    harness.Report("some", harness.Options(), []).finish([], table=harness.Table())
    assert [file.name for file in tmp_path.iterdir()] == ["some.json"]


def test_a_run_makes_every_call_after_one_compilation():
    traces = []

    def double(x):
        traces.append(x)
        return 2 * x

    measured = timing.measure(double, [(jnp.ones(3),), (jnp.zeros(3),)], repeats=4)
    assert len(traces) == 1
    assert len(measured.runs_s) == 4


def test_training_steps_go_on_from_one_another():
    def step(state):
        return state + 1, {"steps": state}

    measured, metrics = timing.measure_steps(step, jnp.zeros(()), repeats=3)
    assert len(measured.runs_s) == 3
    assert metrics["steps"] == 3, "the warm-up is step 0"


def test_rates_are_of_the_median_run():
    measured = timing.Timing(1.0, (4.0, 1.0, 2.0, 3.0, 100.0), (1.0,) * 5)
    assert measured.rate(12) == {"median": 4.0, "q1": 3.0, "q3": 6.0}


def test_a_plain_function_is_warmed_up_and_not_compiled():
    calls = []
    measured = timing.measure_plain(lambda: calls.append(sum(range(300_000))), repeats=3)
    assert len(calls) == 4
    assert len(measured.runs_s) == len(measured.cpu_s) == 3
    assert measured.compile_s is None
    assert 0 < measured.cores <= 1.1, "one thread; other work can take its core away"


def test_waiting_is_not_work():
    measured = timing.measure_plain(lambda: time.sleep(0.05), repeats=2)
    assert measured.cores < 0.5


def test_comparisons_are_of_medians_and_by_busy_core():
    ours = timing.speed("ours", "picks/s", 8, timing.Timing(1.0, (2.0,), (4.0,)))
    theirs = timing.speed("theirs", "poses/s", 1, timing.Timing(None, (1.0,), (0.5,)))
    found = timing.compare(ours, theirs, at="8")
    assert found["rates"] == [4.0, 1.0]
    assert found["ratio"] == 4.0
    assert found["ratio_per_core"] == 1.0, "2 cores' worth of work beside half a core's"
    assert found["at"] == "8"


def test_a_benchmark_whose_peer_is_missing_is_passed_over(monkeypatch, capsys):
    def fake(name, missing):
        module = types.ModuleType(f"benchmarks.{name}")

        def main(arguments):
            assert arguments == ["--quick"]
            if missing:
                raise ModuleNotFoundError(f"No module named {missing!r}", name=missing)
            row = timing.speed(name, "items/s", 3, timing.Timing(None, (1.0,), (1.0,)))
            return {"results": [row]}

        module.main = main  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, f"benchmarks.{name}", module)

    fake("first", "pyvrp")
    fake("second", None)
    monkeypatch.setattr(every, "enable_cache", lambda: None)
    monkeypatch.setattr(every, "SCRIPTS", ("first", "second"))
    every.main([])
    printed = capsys.readouterr().out
    assert 'first: left out, not installed: PyVRP: pip install "basenet_jax[benchmarks]"' in printed
    assert "second (items/s)" in printed
    fake("second", "no_peer_of_ours")
    with pytest.raises(ModuleNotFoundError, match="no_peer_of_ours"):
        every.main([])


def test_a_missing_peer_is_named_with_its_cure(monkeypatch, capsys):
    assert peers.installed("pyvrp", asked_by="some") == (importlib.util.find_spec("pyvrp") is not None)
    monkeypatch.setattr(peers.importlib.util, "find_spec", lambda name: None)
    assert not peers.installed("ur_analytic_ik", asked_by="some")
    assert capsys.readouterr().err.endswith("(its wheels are for Python 3.11 only)\n")


def test_a_training_is_measured_from_outside(tmp_path, monkeypatch):
    pytest.importorskip("resource", reason="Unix only")
    from benchmarks import training_memory

    script = """
import pathlib, sys
ballast = bytearray(b"x") * 600_000_000
pathlib.Path(sys.argv[-1], "summary.json").write_text('{"single_pick_success": 0.5}')
"""
    monkeypatch.setattr(training_memory, "TRAIN", (sys.executable, "-c", script))
    out = ["--quick", "--out", str(tmp_path / "memory.json")]
    (result,) = training_memory.main([*out, "--", "--preset", "quick", "--run-dir", str(tmp_path)])["results"]
    # Above it is open: on Linux a child's figure is at least the size of the process that started it.
    assert 600_000_000 / 2**30 < result["peak_memory_gib"] < 100
    assert result["wall_s"] > 0
    assert result["summary"] == {"single_pick_success": 0.5}
    assert not MACHINE_PATH.search((tmp_path / "memory.json").read_text(encoding="utf-8"))


def test_commands_name_no_machine(tmp_path):
    inside, outside = environment.ROOT / "runs" / "a" / "x.weights", tmp_path / "weights" / "x.weights"
    command = environment.command("benchmarks.orders", ["--weights", str(inside), f"--out={outside}", "--scenes", "7"])
    assert command == "python -m benchmarks.orders --weights runs/a/x.weights --out=weights/x.weights --scenes 7"


@pytest.fixture
def costs():
    generator = np.random.default_rng(0)
    nearest = generator.normal(50.0, 9.0, 400)
    return nearest + generator.normal(-0.5, 2.0, 400), nearest


def test_paired_interval_is_scipys(costs):
    ours, theirs = costs
    expected = stats.ttest_rel(ours, theirs).confidence_interval(CONFIDENCE)
    found = paired_difference(ours, theirs, seed=0)
    assert found["t"] == pytest.approx([expected.low, expected.high], rel=1e-9)
    assert found["mean"] == pytest.approx(ours.mean() - theirs.mean())
    assert found["scenes"] == 400


def test_bootstrap_interval_agrees_with_the_t_interval(costs):
    found = paired_difference(*costs, seed=0)
    # The mean of 400 is near enough to normal; 10,000 resamples leave about 0.03 standard errors in each percentile,
    # and the rest is for the sample's skewness.
    standard_error = found["sd"] / 20
    assert found["bootstrap"] == pytest.approx(found["t"], abs=0.15 * standard_error)
    assert found["bootstrap"] == bootstrap_interval(costs[0] - costs[1], seed=0)


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_scenes_have_no_interval(count):
    found = paired_difference(np.ones(count), np.zeros(count), seed=0)
    assert found["scenes"] == count
    assert found["t"] is None
    assert found["bootstrap"] is None


@pytest.mark.slow
def test_every_benchmark_runs_at_a_tiny_size(tmp_path):
    every.main(["--out", str(tmp_path)])
    files = list(tmp_path.glob("*.json"))
    assert {file.stem for file in files} == set(every.SCRIPTS)
    assert {file.stem for file in tmp_path.glob("*.png")} == {"picks", "contacts", "sampling", "sac", "scaling"}
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert json.loads(text)["results"], file.stem
        assert not MACHINE_PATH.search(text), file.stem
