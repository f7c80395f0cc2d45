"""Sealed intervals, sorted by (cell, start), and kernels that look things up in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel
from tempog.grid.intervals import append_to_cells, count_per_cell
from tempog.sensing.tiles import TILE_CELLS


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

    @classmethod
    def of(
        cls, cell: NDArray[np.int32], first: NDArray[np.int32], last: NDArray[np.int32], value: NDArray[np.float32]
    ) -> Runs:
        """Intervals given with their cells, sorted by cell, then time."""
        n_cells = count_cells(cell)
        cells, offsets = np.empty(n_cells, dtype=np.int32), np.zeros(n_cells + 1, dtype=np.int64)
        note_cells(cell, cells, offsets)
        return cls(cells, offsets, first, last, value)

    @property
    def n_intervals(self) -> int:
        """Number of intervals."""
        return len(self.first)

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for array in self)

    @property
    def cell(self) -> NDArray[np.int32]:
        """Of each interval, the number of its cell."""
        return np.repeat(self.cells, np.diff(self.offsets))

    def of_cell(self, cell: int) -> slice:
        """Where the intervals of one cell are; empty if it has none."""
        i = int(np.searchsorted(self.cells, np.int32(cell)))  # another type would copy the array
        if i == len(self.cells) or self.cells[i] != cell:
            return slice(0, 0)
        return slice(int(self.offsets[i]), int(self.offsets[i + 1]))


def join(sets: Sequence[Runs]) -> Runs:
    """One set of the intervals of several, given from oldest to newest."""
    if len(sets) == 1:
        return sets[0]
    n_cells = max((int(runs.cells[-1]) + 1 for runs in sets if len(runs.cells)), default=0)
    places = np.zeros(n_cells + 1, dtype=np.int64)
    for runs in sets:
        count_per_cell(runs.cells, runs.offsets, places)
    cells = np.flatnonzero(places[1:]).astype(np.int32)
    np.cumsum(places, out=places)
    offsets = np.append(places[cells], places[-1])
    first, last, value = (np.empty(places[-1], dtype=kind) for kind in (np.int32, np.int32, np.float32))
    for runs in sets:
        append_to_cells(*runs, places, first, last, value)
    return Runs(cells, offsets, first, last, value)


def of_tiles(runs: Runs, tiles: NDArray[np.int32]) -> Runs:
    """The intervals of the cells of some tiles, whose numbers ascend."""
    # A tile's cells follow each other, and so do their intervals.
    first = np.searchsorted(runs.cells, tiles * np.int32(TILE_CELLS))
    end = np.searchsorted(runs.cells, (tiles + np.int32(1)) * np.int32(TILE_CELLS))
    which = _ranges(first, end)
    lengths = runs.offsets[which + 1] - runs.offsets[which]
    offsets = np.append(0, np.cumsum(lengths))
    where = _ranges(runs.offsets[first], runs.offsets[end])
    return Runs(runs.cells[which], offsets, runs.first[where], runs.last[where], runs.value[where])


def _ranges(first: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.int64]:
    """All numbers from each first to before each end, one range after the other."""
    lengths = end - first
    before = np.cumsum(lengths) - lengths
    return np.asarray(np.arange(int(lengths.sum())) + np.repeat(first - before, lengths))


class SegmentStack:
    """Immutable segments from oldest to newest.

    While mapping they only pile up, so that a scan costs the same however long the history is. A question
    joins the newest ones first, until each segment is over twice as large as all newer ones together: an
    interval is copied once per doubling, and a question visits few segments.
    """

    def __init__(self) -> None:
        self._segments: list[Runs] = []

    def push(self, runs: Runs) -> None:
        """Add the newest intervals."""
        self._segments.append(runs)

    def settled(self) -> list[Runs]:
        """The segments, joined as far as is worth it."""
        segments = self._segments
        sizes = [runs.n_intervals for runs in segments]
        for k, size in enumerate(sizes[:-1]):
            if size <= 2 * sum(sizes[k + 1 :]):
                segments[k:] = [join(segments[k:])]
                break
        return segments

    @property
    def n_intervals(self) -> int:
        """Number of intervals in all segments."""
        return sum(runs.n_intervals for runs in self._segments)

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(runs.nbytes for runs in self._segments)


@kernel
def count_cells(cell: NDArray[np.int32]) -> int:
    """How many times the cell is another than before."""
    n = 0
    for k in range(cell.shape[0]):
        if k == 0 or cell[k] != cell[k - 1]:
            n += 1
    return n


@kernel
def note_cells(cell: NDArray[np.int32], cells: NDArray[np.int32], offsets: NDArray[np.int64]) -> None:
    """Which cells these are, each once, and where the intervals of each begin and end   [both written]."""
    i = 0
    for k in range(cell.shape[0]):
        if k == 0 or cell[k] != cell[k - 1]:
            cells[i], offsets[i] = cell[k], k
            i += 1
    offsets[i] = cell.shape[0]


@kernel
def add_spans(
    cell: NDArray[np.int32],
    first: NDArray[np.int32],
    span: NDArray[np.int32],
    end_scan: int,
    last: NDArray[np.int32],
) -> tuple[bool, bool]:
    """The last scan of each interval   [written].

    Returns whether the cells ascend from 0, and whether all scans are from 0 to before `end_scan`.
    """
    ascend, within, before = True, True, 0
    for k in range(cell.shape[0]):
        ascend &= cell[k] >= before
        before = cell[k]
        until = np.int64(first[k]) + span[k]
        within &= first[k] >= 0 and span[k] >= 0 and until < end_scan
        last[k] = until
    return ascend, within


@kernel
def latest_states(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    first_scan: int,
    last_scan: int,
    until: int,
    oldest: int,
    ages_s: NDArray[np.float32],
    tile_places: NDArray[np.int64],
    n_cols: int,
    out_value: NDArray[np.float32],
    out_age_s: NDArray[np.float32],
) -> None:
    """Each cell's latest interval that began by scan `until`, of what the scans `first_scan` to `last_scan` saw.

    oldest            the scan from which on a last look is recent enough; the state of others is unknown
    ages_s (n_scans,) seconds from each scan to the moment asked for, 0 for later ones
    tile_places (n_tiles,) where each tile's south-western cell lies in the output
    n_cols            entries of the output from one row of cells to the next
    out_value, out_age_s: its value and age, or NaN   [updated where found]
    """
    for i in range(cells.shape[0]):
        low, high = offsets[i], offsets[i + 1]
        while low < high:
            middle = (low + high) >> 1
            if first[np.uint64(middle)] <= until:
                low = middle + 1
            else:
                high = middle
        k = np.uint64(low - 1)
        if low > offsets[i] and last[k] >= first_scan:
            seen = min(last[k], last_scan)
            known = seen >= oldest
            cell = cells[i]
            place = np.uint64(tile_places[np.uint64(cell >> 6)] + ((cell >> 3) & 7) * n_cols + (cell & 7))
            out_value[place] = value[k] if known else np.float32(np.nan)
            out_age_s[place] = ages_s[np.uint64(seen)] if known else np.float32(np.nan)


@kernel
def count_overlapping(first: NDArray[np.int32], last: NDArray[np.int32], since: int, until: int) -> int:
    """How many intervals were seen between the scans `since` and `until`, both included."""
    n = 0
    for k in range(first.shape[0]):
        n += first[k] <= until and last[k] >= since
    return n
