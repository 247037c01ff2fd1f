"""Means, intervals and ratios, against SciPy, against known answers and by their coverage."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from basenet_jax.evaluation.figures import mean_figure, ratio, summarise
from basenet_jax.evaluation.table import Row, Scores


def scores(grasped, execution):
    count = len(grasped)
    return Scores(
        planning_s=np.full(count, 0.5),
        compile_s=np.arange(count, dtype=float),
        grasped=np.array(grasped),
        navigation_s=np.array(execution, float) / 4,
        grasping_s=np.array(execution, float) * 3 / 4,
        disagreements=np.zeros(count, int),
        reasons=({},) * count,
    )


def interval(figure):
    assert figure.ci95 is not None
    return figure.ci95


def summary_of(row, rows) -> Any:
    return summarise(row, rows)


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=30))
def test_mean_and_interval_are_scipys(values):
    figure = mean_figure(np.array(values))
    assert figure.mean == pytest.approx(np.mean(values))
    assert figure.sd == pytest.approx(np.std(values, ddof=1))
    error = np.std(values, ddof=1) / np.sqrt(len(values))
    if error > 0:
        assert figure.ci95 is not None
        low, high = scipy.stats.t.interval(0.95, len(values) - 1, np.mean(values), error)
        assert figure.ci95 == pytest.approx((max(low, 0.0), high))


def test_of_one_scene_only_the_mean_is_known():
    assert dataclasses.astuple(mean_figure(np.array([3.0]))) == (3.0, None, None)


def test_an_interval_of_a_share_stays_a_share():
    low, high = interval(mean_figure(np.array([1.0, 1.0, 0.5]), most=1.0))
    assert 0.0 <= low < 0.8 < high <= 1.0


def test_the_ratio_counts_scenes_where_both_grasp_every_object():
    own = scores([2, 2, 1, 2], [30.0, 20.0, 1.0, 40.0])
    other = scores([2, 2, 2, 1], [20.0, 10.0, 9.0, 1.0])
    found = ratio(own, other, 2)
    assert (found.scenes, found.share) == (2, 0.5)
    assert found.ratio == pytest.approx((1.5 + 2.0) / 2)
    assert interval(found) == pytest.approx((1.5, 2.0))


def test_without_a_common_scene_there_is_no_ratio():
    found = ratio(scores([1], [5.0]), scores([2], [5.0]), 2)
    assert dataclasses.astuple(found) == (0, 0.0, None, None)


def test_of_one_common_scene_there_is_a_ratio_without_interval():
    found = ratio(scores([2, 1], [6.0, 5.0]), scores([2, 2], [5.0, 5.0]), 2)
    assert dataclasses.astuple(found) == (1, 0.5, pytest.approx(1.2), None)


def test_the_ratios_interval_covers_the_truth_about_as_often_as_it_says():
    rng = np.random.default_rng(5)
    covered = 0
    for _ in range(200):
        reference = rng.normal(100.0, 10.0, 50)
        own = 1.2 * reference + rng.normal(0.0, 5.0, 50)
        low, high = interval(ratio(scores([2] * 50, own), scores([2] * 50, reference), 2))
        covered += low <= 1.2 <= high
    assert 180 <= covered <= 198


def test_a_row_is_compared_with_dp_on_the_same_number_of_objects():
    labels = ("0", "1")
    rows = [
        Row("dp", 2, labels, scores([2, 2], [10.0, 10.0])),
        Row("dp", 3, labels, scores([3, 3], [20.0, 20.0])),
        Row("x", 3, labels, scores([3, 3], [30.0, 30.0])),
        Row("y", 4, labels, scores([4, 4], [30.0, 30.0])),
        Row("z", 4, labels, None, "too many"),
    ]
    assert summary_of(rows[2], rows).ratio_to_dp.ratio == pytest.approx(1.5)
    assert summary_of(rows[3], rows).ratio_to_dp is None
    assert summarise(rows[4], rows) is None
    summary = summary_of(rows[2], rows)
    assert summary.compile_s == 1.0
    assert (summary.planning_median_s, summary.planning_max_s) == (0.5, 0.5)
    assert summary.figures["total_s"].mean == pytest.approx(30.5)
    assert summary.figures["grasped"].mean == 1.0
