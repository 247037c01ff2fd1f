"""Cells of a grid covered by few rectangles."""

import numpy as np
from jaxtyping import Bool, Int

_TRIED = 64  # heights of a rectangle that are compared


def cover(cells: Bool[np.ndarray, "rows columns"], most: int) -> Int[np.ndarray, "K 4"]:
    """Rectangles whose union is exactly the cells that are set; they may overlap.

    Greedy: through the first cell that isn't covered yet runs the rectangle, grown as far as it goes, that covers most
    of such cells. Overlap makes them fewer than any partition's. Leaving out cells in the midst of large areas
    would hardly save a rectangle (these are what ragged edges take), so all are covered, and a pose inside is refused.

    Args:
        cells: which are to be covered.
        most: rectangles.

    Returns:
        Of each rectangle the first row and column, and those behind its last.

    Raises:
        ValueError: it would take more of them.
    """
    first, behind = _runs(cells)
    left, found, position = cells.copy(), [], 0
    flat, columns = left.reshape(-1), cells.shape[1]
    while (position := position + int(np.argmax(flat[position:]))) < flat.size and flat[position]:
        if len(found) == most:
            raise ValueError(f"rectangles: found more, allowed are up to {most}")
        best = _largest(cells, left, first, behind, *divmod(position, columns))
        left[best[0] : best[2], best[1] : best[3]] = False
        found.append(best)
    return np.array(found, np.int64).reshape(-1, 4)


def _runs(cells: Bool[np.ndarray, "rows columns"]) -> tuple[Int[np.ndarray, "rows columns"], ...]:
    """For each cell that is set the first column of its run in its row, and the one behind its last."""
    columns = np.arange(cells.shape[1], dtype=np.int32)
    first = np.maximum.accumulate(np.where(cells, 0, columns + 1), axis=1)
    behind = np.minimum.accumulate(np.where(cells, columns[-1:] + 1, columns)[:, ::-1], axis=1)[:, ::-1]
    return first, behind


def _largest(cells, left, first, behind, row: int, column: int) -> tuple[int, int, int, int]:
    """The rectangle through a cell that covers most of `left`: so far down, as wide as goes, then as far up as goes.

    Args:
        cells: which may be covered.
        left: which still have to be.
        first: of `_runs`.
        behind: likewise.
        row: of the cell.
        column: likewise.
    """
    down, up = _length(cells[row:, column]), _length(cells[row::-1, column])
    below, above = slice(row, row + down), slice(row, row - up if row >= up else None, -1)
    low, high = np.maximum.accumulate(first[below, column]), np.minimum.accumulate(behind[below, column])
    low_above, high_above = first[above, column], behind[above, column]
    narrows = np.flatnonzero(np.append((np.diff(low) != 0) | (np.diff(high) != 0), True))[:_TRIED]
    tried = []
    for last in narrows:
        fits = (low_above <= low[last]) & (high_above >= high[last])
        tried.append((row - _length(fits) + 1, int(low[last]), row + int(last) + 1, int(high[last])))
    return max(tried, key=lambda box: np.count_nonzero(left[box[0] : box[2], box[1] : box[3]]))


def _length(values: Bool[np.ndarray, " n"]) -> int:
    """How many are true from the beginning on."""
    return len(values) if values.all() else int(np.argmin(values))
