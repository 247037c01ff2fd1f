"""The picture of the map shows the numbers of headings."""

import numpy as np
import pytest

from basenet_jax.planners.grasp_map import TILTS, GraspMap, Shape
from basenet_jax.planners.reachability import ReachabilityMap
from basenet_jax.plots import plot_grasp_map, plot_reachability


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


@pytest.fixture
def grasp_map():
    shape = Shape(step_m=0.2, lowest=3, heights=3, side=5, headings=2, turns=1)
    bins = np.zeros(shape.sizes, bool)
    bins[2, 9, 3, 2] = True  # 1 m high, level: in front of the grasp
    bins[2, 18, 2, 3, 0] = True  # from above: to its left, with one of two headings
    return GraspMap(bits=np.packbits(bins, bitorder="little"), axis=np.zeros(2, np.float32), shape=shape)


def test_a_panel_for_each_height_and_tilt_x_to_the_right(grasp_map):
    figure = plot_grasp_map(grasp_map, heights_m=[0.78, 1.02])
    images = [np.asarray(axes.images[0].get_array()) for axes in figure.axes]
    assert len(images) == 6
    assert not np.any(images[0])
    level, down = np.zeros((2, 5, 5))
    level[2, 3], down[3, 2] = 1.0, 0.5  # row: y, column: x
    np.testing.assert_array_equal(images[3], level)
    np.testing.assert_array_equal(images[5], down)
    np.testing.assert_allclose(figure.axes[3].images[0].get_extent(), (-0.5, 0.5, -0.5, 0.5))
    assert [axes.get_title() for axes in figure.axes[::5]] == ["0.80 m, 0° down", "1.00 m, 90° down"]
    assert TILTS == 19


def test_no_height_is_refused(grasp_map):
    with pytest.raises(ValueError, match="heights_m: found none"):
        plot_grasp_map(grasp_map, heights_m=[])
