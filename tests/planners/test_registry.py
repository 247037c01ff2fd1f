"""Planners by name, each with its own options."""

import subprocess
import sys
from pathlib import Path

import pytest

from basenet_jax.config import AlignedConfig
from basenet_jax.planners.options import LearnedOptions, RefinedOptions, SampleOptions
from basenet_jax.planners.registry import PLANNERS, find_planner, make_options, shared_options


def test_a_planner_that_is_not_there_is_refused_with_those_that_are():
    with pytest.raises(ValueError, match=r"^planner: found 'best', allowed are pbg, pbg-gc, .*, basenet-sample$"):
        find_planner("best")


@pytest.mark.parametrize(
    ("name", "option", "allowed"),
    [
        ("dp", "samples", "is none"),
        ("refined", "samples", "are budget_s, aligned, refinement"),
        ("basenet", "samples", "are weights, devices, aligned"),
        ("basenet-paper", "aligned", "are weights, devices"),
        ("greedy-stops", "budget", "are seconds_per_object"),
    ],
)
def test_an_option_that_a_planner_has_not_is_refused_with_its_own(name, option, allowed):
    with pytest.raises(ValueError, match=f"^options of the planner {name}: found {option}, allowed {allowed}$"):
        make_options(name, {option: 1})


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("basenet-sample", {"samples": 0}, "SampleOptions.samples: found 0, allowed are whole numbers, 1 to"),
        ("basenet-sample", {"samples": [1]}, r"SampleOptions.samples: found \[1\], allowed are whole numbers"),
        ("refined", {"budget_s": float("nan")}, "RefinedOptions.budget_s: found nan"),
        ("basenet", {"weights": 3}, "StopsOptions.weights: found 3, allowed is a Path"),
        ("greedy-stops", {"seconds_per_object": 0}, "GreedyStopsOptions.seconds_per_object: found 0"),
    ],
)
def test_an_option_that_means_nothing_is_refused(name, given, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        make_options(name, given)


def test_several_planners_take_what_they_have():
    given = {"weights": Path("a"), "samples": 7, "aligned": AlignedConfig(step_m=0.2)}
    assert shared_options(["dp", "basenet-paper", "basenet-sample", "refined"], given) == {
        "dp": None,
        "basenet-paper": LearnedOptions(weights=Path("a")),
        "basenet-sample": SampleOptions(weights=Path("a"), samples=7, aligned=AlignedConfig(step_m=0.2)),
        "refined": RefinedOptions(aligned=AlignedConfig(step_m=0.2)),
    }
    with pytest.raises(ValueError, match="option samples: found, but none of the planners dp, basenet has it"):
        shared_options(["dp", "basenet"], {"samples": 7})


def test_the_names_and_options_are_known_without_jax():
    code = "import sys, basenet_jax.planners.registry as r; list(r.PLANNERS); sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    assert len(PLANNERS) >= 10
