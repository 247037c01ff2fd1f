"""Ablations' figures and pictures, from made-up curves."""

import json

import numpy as np
import pytest
from matplotlib.collections import PathCollection

from basenet_jax.evaluation.ablation import FIGURES, BasePoses, as_markdown, final_figures, read_curves
from basenet_jax.learning.ablation import VARIANTS, layer_of
from basenet_jax.plots.ablation import plot_base_poses, plot_curves

SEEDS, INTERVALS = 3, 4
STUDIES = ("baseline", "attention")


def value(study, variant, figure, seed, interval):
    """A number that says where it belongs."""
    layer, names = layer_of(study, variant), sorted(FIGURES[study])
    return len(layer) + 100 * names.index(figure) + 10 * seed + interval


@pytest.fixture(scope="module")
def curves(tmp_path_factory):
    layers = {layer_of(study, variant): (study, variant) for study in STUDIES for variant in VARIANTS[study]}
    lines = []
    for layer, (study, variant) in layers.items():
        for interval in range(1, INTERVALS + 1):
            record = {"layer": layer, "interval": interval, "loss/0": 1.0}
            for figure in FIGURES[study]:
                for seed in range(SEEDS):
                    record[f"{figure}/{seed}"] = value(study, variant, figure, seed, interval)
            lines.append(json.dumps(record))
    file = tmp_path_factory.mktemp("run") / "metrics.jsonl"
    file.write_text("\n".join(lines) + "\n")
    return read_curves(file, STUDIES)


def test_curves_are_read_by_study_variant_figure_seed_and_interval(curves):
    assert set(curves) == set(STUDIES)
    for study, variants in curves.items():
        assert set(variants) == set(VARIANTS[study])
        for variant, figures in variants.items():
            for figure, values in figures.items():
                expected = [
                    [value(study, variant, figure, seed, interval) for interval in range(1, INTERVALS + 1)]
                    for seed in range(SEEDS)
                ]
                np.testing.assert_array_equal(values, expected)


def test_final_figures_are_the_last_intervals_over_the_seeds(curves):
    final = final_figures(curves)
    for study, variants in curves.items():
        for variant, figures in variants.items():
            for figure, values in figures.items():
                found = final[study][variant][figure]
                last = values[:, -1]
                assert found["seeds"] == last.tolist()
                assert (found["min"], found["mean"], found["max"]) == (last.min(), last.mean(), last.max())
    json.dumps(final, allow_nan=False)


def test_the_text_has_every_variant_and_the_shares_of_success(curves):
    poses = {"object frame": BasePoses(np.zeros((2, 3)), np.array([True, False]), [0.5, 1.0])}
    text = as_markdown(final_figures(curves), poses, "python -m somewhere")
    assert "`python -m somewhere`" in text
    assert all(f"| {variant} |" in text for study in STUDIES for variant in VARIANTS[study])
    assert "object frame: 75.0 % of picks succeed (50.0 to 100.0)" in text


def test_curves_are_drawn_with_their_spread(curves):
    labels = FIGURES["baseline"]
    figure = plot_curves(curves["baseline"], labels)
    assert [axes.get_ylabel() for axes in figure.axes] == list(labels.values())
    for axes, name in zip(figure.axes, labels, strict=True):
        drawn = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
        for variant, figures in curves["baseline"].items():
            np.testing.assert_allclose(np.asarray(drawn[variant], float), figures[name].mean(axis=0))
        assert len(axes.collections) == 2
    figure.canvas.draw()


def test_base_poses_are_drawn_in_each_frame():
    random = np.random.default_rng(0)
    clouds = {
        "object frame": (random.normal(size=(20, 3)), random.random(20) < 0.5, 0.9),
        "table frame": (random.normal(size=(10, 3)), np.ones(10, bool), 1.0),
    }
    figure = plot_base_poses(clouds, (1.0, 0.4))
    for axes, (variant, (pose, _, share)) in zip(figure.axes, clouds.items(), strict=True):
        assert variant in axes.get_title()
        assert f"{100 * share:.1f} %" in axes.get_title()
        points = [each for each in axes.collections if isinstance(each, PathCollection)]
        assert sum(len(np.asarray(each.get_offsets())) for each in points) == len(pose)
    figure.canvas.draw()
