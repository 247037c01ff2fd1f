"""The picture of the map shows the numbers of headings."""

import numpy as np
import pytest

from basenet_jax.planners.reachability import ReachabilityMap
from basenet_jax.plots import plot_reachability


@pytest.fixture
def reach_map():
    reachable = np.zeros((2, 5, 5, 8), bool)
    reachable[0, 3, 2, :6] = True  # in front of the grasp's x
    reachable[1, 2, 3] = True
    return ReachabilityMap(reachable=reachable, height=np.array([1.05, 1.2]), step_m=0.1)


def test_each_height_is_a_panel_of_counts_x_to_the_right(reach_map):
    figure = plot_reachability(reach_map)
    images = [axes.images[0] for axes in figure.axes if axes.images]
    expected = np.zeros((5, 5))
    expected[2, 3] = 6  # row: y, column: x
    np.testing.assert_array_equal(images[0].get_array(), expected)
    np.testing.assert_allclose(images[0].get_extent(), (-0.25, 0.25, -0.25, 0.25))
    assert images[0].origin == "lower"
    assert int(np.max(np.asarray(images[1].get_array()))) == 8
    assert [axes.get_title() for axes in figure.axes[:2]] == ["grasp at 1.050 m", "grasp at 1.200 m"]
    assert "of 8" in figure.axes[-1].get_ylabel()


def test_only_the_layers_asked_for(reach_map):
    figure = plot_reachability(reach_map, layers=[1])
    assert [axes.get_title() for axes in figure.axes if axes.images] == ["grasp at 1.200 m"]


def test_no_layer_is_refused(reach_map):
    with pytest.raises(ValueError, match="found none"):
        plot_reachability(reach_map, layers=[])
