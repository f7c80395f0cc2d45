"""Sealed intervals, sorted by (cell, start), and kernels that look things up in them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel
from tempog.grid.intervals import merge_runs


class Runs(NamedTuple):
    """Intervals of many cells; a cell's own are one contiguous slice, in time order.

    Attributes
    ----------
    cells : (n,) int32
        Cell numbers, ascending.
    offsets : (n + 1,) int64
        Intervals of ``cells[i]`` are at ``offsets[i]:offsets[i + 1]`` of the following.
    first, last : (n_intervals,) int32
        Scan numbers that opened the interval and that saw it last.
    value : (n_intervals,) float32
        P(occupied).
    """

    cells: NDArray[np.int32]
    offsets: NDArray[np.int64]
    first: NDArray[np.int32]
    last: NDArray[np.int32]
    value: NDArray[np.float32]

    @property
    def n_intervals(self) -> int:
        """Number of intervals."""
        return len(self.first)

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for array in self)

    def of_cell(self, cell: int) -> slice:
        """Where the intervals of one cell are; empty if it has none."""
        i = int(np.searchsorted(self.cells, cell))
        if i == len(self.cells) or self.cells[i] != cell:
            return slice(0, 0)
        return slice(int(self.offsets[i]), int(self.offsets[i + 1]))


class SegmentStack:
    """Immutable segments from oldest to newest, merged so that each is over twice as large as the next.

    An interval is copied once per doubling, so appending stays cheap however long the history is, and a
    query visits a number of segments that grows with the logarithm of the history.
    """

    def __init__(self) -> None:
        self.segments: list[Runs] = []

    def push(self, runs: Runs) -> None:
        """Add the newest intervals."""
        self.segments.append(runs)
        while len(self.segments) > 1 and self.segments[-2].n_intervals <= 2 * self.segments[-1].n_intervals:
            newer, older = self.segments.pop(), self.segments.pop()
            self.segments.append(Runs(*merge_runs(*older, *newer)))

    @property
    def n_intervals(self) -> int:
        """Number of intervals in all segments."""
        return sum(runs.n_intervals for runs in self.segments)

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(runs.nbytes for runs in self.segments)


@kernel
def latest_states(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    since: int,
    until: int,
    out_value: NDArray[np.float32],
    out_last: NDArray[np.int32],
) -> None:
    """Each cell's latest interval that began by scan `until` and was still seen at `since` or later.

    out_value, out_last (n_cells,): its value, and the scan that saw it last   [updated where found]
    """
    for i in range(cells.shape[0]):
        low, high = offsets[i], offsets[i + 1]
        while low < high:
            middle = (low + high) // 2
            if first[middle] <= until:
                low = middle + 1
            else:
                high = middle
        k = low - 1
        if k >= offsets[i] and last[k] >= since:
            out_value[cells[i]] = value[k]
            out_last[cells[i]] = last[k]


@kernel
def count_overlapping(first: NDArray[np.int32], last: NDArray[np.int32], since: int, until: int) -> int:
    """How many intervals were seen between the scans `since` and `until`, both included."""
    n = 0
    for k in range(first.shape[0]):
        n += first[k] <= until and last[k] >= since
    return n
