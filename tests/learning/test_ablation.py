"""Ablations at a tiny size: seeds side by side are seeds one by one, and the command leaves what it should."""

import dataclasses
import json

import chex
import jax
import numpy as np
import pytest

from basenet_jax import ablate
from basenet_jax.learning import config as module
from basenet_jax.learning.ablation import STUDIES, VARIANTS, Ablation, Several, layer_of
from basenet_jax.learning.config import AblationConfig
from basenet_jax.policies.base_pose import untrained_policy
from tests.tiny_training import tiny_preset


def tiny_ablation(preset, *, objects, seed, seeds, base_pose_weights):
    config = tiny_preset(preset, objects=objects, seed=seed)
    sac = dataclasses.replace(config.sac, intervals=2)
    reinforce = dataclasses.replace(config.reinforce, intervals=2)
    return AblationConfig(preset, seed, seeds, config.robot, config.world, sac, reinforce, base_pose_weights)


@pytest.fixture(scope="module")
def ablation(robot):
    config = tiny_ablation("quick", objects=3, seed=0, seeds=2, base_pose_weights="")
    return Ablation(config, jax.device_put(robot), untrained_policy((256, 256, 256)))


class Toy:
    """A learner whose state is a random number that grows."""

    def init(self, key):
        return {"value": jax.random.normal(key), "step": 0}

    def interval(self, state):
        state = {"value": 1.5 * state["value"], "step": state["step"] + 1}
        return state, {"value": state["value"], "step": state["step"]}


def test_seeds_side_by_side_are_seeds_one_by_one():
    toy, several, key = Toy(), Several(Toy(), 3), jax.random.key(3)
    states, metrics = jax.jit(several.interval)(jax.jit(several.init)(key))
    assert set(metrics) == {f"{name}/{seed}" for name in ("value", "step") for seed in range(3)}
    for seed, own_key in enumerate(jax.random.split(key, 3)):
        state, alone = toy.interval(toy.init(own_key))
        for name, expected in alone.items():
            np.testing.assert_allclose(metrics[f"{name}/{seed}"], expected, rtol=1e-6)
            np.testing.assert_allclose(states[name][seed], state[name], rtol=1e-6)


@pytest.mark.slow  # four programs to compile
@pytest.mark.parametrize(("study", "params"), [("base-frame", "actor"), ("baseline", "params")])
def test_learners_can_be_trained_side_by_side(ablation, study, params):
    learner = ablation._learner(study, VARIANTS[study][0])
    several, key = Several(learner, 2), jax.random.key(3)
    together, metrics = jax.jit(lambda key: several.interval(several.init(key)))(key)
    alone = jax.jit(lambda key: learner.interval(learner.init(key)))
    # Rounding may turn the sign of a gradient near zero, and Adam's steps are of the learning rate whatever its size.
    config = learner.config
    updates = (
        getattr(config, "updates_per_interval", 0) or config.iterations_per_interval * config.updates_per_iteration
    )
    for seed, own_key in enumerate(jax.random.split(key, 2)):
        state, figures = alone(own_key)
        own = jax.tree.map(lambda x, seed=seed: x[seed], getattr(together, params))
        chex.assert_trees_all_close(own, getattr(state, params), atol=2 * updates * config.learning_rate)
        assert {f"{name}/{seed}" for name in figures} <= set(metrics)


def test_the_papers_sequence_is_trained_once_for_both_of_its_studies():
    assert layer_of("baseline", "greedy-rollout baseline") == layer_of("attention", "attention coefficients")
    layers = {layer_of(study, variant) for study in STUDIES for variant in VARIANTS[study]}
    assert len(layers) == 5


def test_what_varies_is_what_the_variant_says(ablation):
    assert ablation._learner("baseline", "no baseline").config.baseline is False
    assert ablation._learner("attention", "plain sum").config.attention is False
    assert ablation._learner("attention", "plain sum").config.baseline is True
    assert [ablation.sac(variant).env.frame for variant in VARIANTS["base-frame"]] == ["object", "table"]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The folder of a whole ablation and what it printed."""
    folder = tmp_path_factory.mktemp("ablation") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "make_ablation", tiny_ablation)
        assert ablate.main(["--out", str(folder), "--seeds", "2", "--objects", "3"]) == 0
    return folder


@pytest.mark.slow  # five trainings, each compiled
def test_the_command_leaves_figures_and_pictures(done):
    pictures = {file.name for file in done.glob("*.png")}
    assert pictures == {"base-frame.png", "baseline.png", "attention.png", "base-poses.png"}
    content = json.loads((done / "ablation.json").read_text())
    assert set(content["studies"]) == set(STUDIES)
    for study in STUDIES:
        assert set(content["studies"][study]) == set(VARIANTS[study])
        for figures in content["studies"][study].values():
            for figure in figures.values():
                assert len(figure["seeds"]) == 2
                assert figure["min"] <= figure["mean"] <= figure["max"]
                assert figure["mean"] == pytest.approx(np.mean(figure["seeds"]))
    assert set(content["base_pose_success"]) == set(VARIANTS["base-frame"])
    text = (done / "ablation.md").read_text()
    assert all(variant in text for variants in VARIANTS.values() for variant in variants)


@pytest.mark.slow
def test_a_finished_ablation_is_not_trained_over_and_can_be_drawn_again(done, monkeypatch, capsys):
    monkeypatch.setattr(module, "make_ablation", tiny_ablation)
    given = ["--out", str(done), "--seeds", "2", "--objects", "3"]
    assert ablate.main(given) == 2
    assert "holds a run already" in capsys.readouterr().err
    before = json.loads((done / "ablation.json").read_text())
    assert ablate.main([*given, "--resume"]) == 0
    after = json.loads((done / "ablation.json").read_text())
    assert after["studies"] == before["studies"]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--seeds", "0"], "--seeds: found 0"),
        (["--objects", "51"], "--objects: found 51"),
        (["--studies"], "--studies"),
    ],
)
def test_bad_wishes_are_refused(tmp_path, capsys, given, message):
    try:
        code = ablate.main(["--out", str(tmp_path / "out"), *given])
    except SystemExit as end:  # the command line's parser
        code = end.code
    assert code == 2
    assert message in capsys.readouterr().err
