"""Rectangles cover the cells that are set, and no others."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from basenet_jax.world.rectangles import cover


def drawn(rectangles, shape):
    cells = np.zeros(shape, bool)
    for top, left, bottom, right in rectangles:
        assert 0 <= top < bottom <= shape[0]
        assert 0 <= left < right <= shape[1]
        cells[top:bottom, left:right] = True
    return cells


@settings(max_examples=300)
@given(arrays.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_any_cells_are_covered_exactly(cells):
    found = cover(cells, cells.size)
    np.testing.assert_array_equal(drawn(found, cells.shape), cells)
    for top, left, bottom, right in found:  # each is as high as it can be
        assert top == 0 or not cells[top - 1, left:right].all()
        assert bottom == len(cells) or not cells[bottom, left:right].all()


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_noise_is_covered_exactly(share):
    cells = np.random.default_rng(0).uniform(size=(60, 80)) < share
    found = cover(cells, cells.size)
    np.testing.assert_array_equal(drawn(found, cells.shape), cells)
    assert len(found) < cells.sum()


def test_crossing_bars_take_two_rectangles_and_a_ring_four():
    cells = np.zeros((9, 9), bool)
    cells[4], cells[:, 4] = True, True
    assert len(cover(cells, 81)) == 2
    ring = np.ones((9, 9), bool)
    ring[2:7, 2:7] = False
    assert len(cover(ring, 81)) == 4


def test_too_many_are_told():
    cells = np.eye(5, dtype=bool)
    assert len(cover(cells, 5)) == 5
    with pytest.raises(ValueError, match="found more, allowed are up to 4"):
        cover(cells, 4)
    assert cover(np.zeros((3, 4), bool), 0).shape == (0, 4)
