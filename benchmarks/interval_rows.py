"""In which order a file keeps intervals, and how its columns are encoded.

Sorted by cell, a file would say again for each cell what its neighbours say: many looks end with the same scan,
when the robot turns away. So 256 cells at a time, four tiles, intervals are kept in the order of their last looks:
the column of last scans all but vanishes, and the lowest byte of a cell's number says which of the 256 it is. A
cell's own intervals are still in time order, and row groups still hold few cells each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.grid.intervals import sort_by_cell
from tempog.grid.segments import Runs

BLOCK_BITS = 8  # with 128 or 512 cells in a block files are 1 to 10 % larger
ENCODINGS = {"cell": "BYTE_STREAM_SPLIT", "last_scan": "DELTA_BINARY_PACKED", "span": "BYTE_STREAM_SPLIT"}
DICTIONARY = ["prob"]


class IntervalRows(NamedTuple):
    """Intervals as a file keeps them, one row each, by block of cells, last scan, and cell.

    Attributes
    ----------
    cell, last_scan : (n,) int32
    span : (n,) int32
        Scans from the one that opened the interval to the last.
    prob : (n,) float32
    """

    cell: NDArray[np.int32]
    last_scan: NDArray[np.int32]
    span: NDArray[np.int32]
    prob: NDArray[np.float32]


def to_rows(runs: Runs) -> IntervalRows:
    """Intervals in the order in which a file keeps them."""
    cell = np.repeat(runs.cells, np.diff(runs.offsets))
    order = np.lexsort((runs.last, cell >> BLOCK_BITS))  # stable, so by cell among the same last scans
    last = runs.last[order]
    return IntervalRows(cell[order], last, last - runs.first[order], runs.value[order])


def from_rows(rows: IntervalRows, n_cells: int) -> Runs:
    """Intervals sorted by cell again; cell numbers must be below `n_cells`.

    The rows may be in any order in which a cell's own intervals are in time order.
    """
    return Runs(
        *sort_by_cell(n_cells, len(rows.cell), rows.cell, rows.last_scan - rows.span, rows.last_scan, rows.prob)
    )
