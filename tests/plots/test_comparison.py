"""The figure of all planners side by side."""

from typing import Any

import numpy as np
import pytest

from basenet_jax.plots import PlannedScene, plot_comparison
from tests import judged


def titles(axes):
    return axes.get_title(loc="left"), axes.get_title(loc="right")


def test_every_planner_has_a_panel_with_its_figures(robot, scene, plan, outcome):
    failed = judged.with_failure(outcome, 1)
    planned = {
        "dp": PlannedScene(plan, outcome, 0.1234),
        "pbg": PlannedScene(plan, failed),
        "mbp": PlannedScene(plan, outcome, 1.5),
        "basenet": PlannedScene(plan, outcome, 0.002),
    }
    figure = plot_comparison(robot, scene, planned)
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert [titles(axes)[0] for axes in panels] == list(planned)
    navigation, picking = float(outcome.navigation), float(outcome.picking)
    sums = f"N {navigation:.1f} + G {picking:.1f} = {float(outcome.execution):.1f} s"
    assert titles(panels[0])[1] == f"2 of 2 grasped, P 0.123 s\n{sums}"
    assert titles(panels[1])[1].startswith("1 of 2 grasped\n")
    assert len({axes.get_xlim() for axes in panels}) == 1, "shared axes"
    assert [text.get_text() for text in figure.legends[0].get_texts()].count("not grasped") == 1


def test_legend_and_panels_do_not_overlap(robot, scene, plan, outcome):
    figure = plot_comparison(robot, scene, {name: PlannedScene(plan, outcome) for name in "abc"})
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    boxes: list[Any] = [axes.get_tightbbox() for axes in figure.axes]
    assert not any(legend.overlaps(box) for box in boxes)
    assert np.all([box.width > 150 for box in boxes])


def test_every_panel_without_one_below_has_numbers_on_its_axis(robot, scene, plan, outcome):
    figure = plot_comparison(robot, scene, {name: PlannedScene(plan, outcome) for name in "abcd"}, columns=3)
    labelled = [axes.get_xlabel() for axes in figure.axes if axes.get_visible()]
    assert labelled == ["", "x (m)", "x (m)", "x (m)"]


def test_nothing_to_compare_is_refused(robot, scene):
    with pytest.raises(ValueError, match="found no planner"):
        plot_comparison(robot, scene, {})
