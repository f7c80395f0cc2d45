"""Kernels that write history: extend the open interval or seal it (paper, Fig. 4), then sort what was sealed.

Arrays in, arrays out. No classes, no I/O, no validation: `TemporalGrid` has checked and cast everything.
Times are scan numbers; the stamps are kept once, beside the grid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel

NEVER = -1  # scan number of a cell that was never observed


@kernel
def extend_or_seal(
    cells: NDArray[np.int32],
    prob: NDArray[np.float32],
    scan: int,
    oldest: int,
    tolerance: np.float32,
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    sealed_cell: NDArray[np.int32],
    sealed_first: NDArray[np.int32],
    sealed_last: NDArray[np.int32],
    sealed_value: NDArray[np.float32],
    n_sealed: int,
) -> int:
    """Apply Fig. 4 to every cell that one scan observed; return the new `n_sealed`.

    cells  (n_obs,)    int32    cell numbers, each at most once
    prob   (n_obs,)    float32  P(occupied) by this scan alone
    scan                        number of this scan
    oldest                      first scan within the gap threshold of this one
    first  (n_cells,)  int32    scan that opened the cell's current interval  [updated]
    last   (n_cells,)  int32    scan that saw it last, or NEVER               [updated]
    value  (n_cells,)  float32  P(occupied) of the interval, its first        [updated]
    sealed_*  (capacity,)       finished intervals, in the order they ended   [appended]

    capacity >= n_sealed + n_obs, so nothing here allocates or grows.
    """
    for k in range(cells.shape[0]):
        c = np.uint64(cells[k])  # unsigned: Numba then leaves out the test for negative indices
        if last[c] >= oldest and abs(prob[k] - value[c]) <= tolerance:
            last[c] = scan
            continue
        if last[c] != NEVER:
            sealed_cell[n_sealed] = c
            sealed_first[n_sealed] = first[c]
            sealed_last[n_sealed] = last[c]
            sealed_value[n_sealed] = value[c]
            n_sealed += 1
        first[c] = scan
        last[c] = scan
        value[c] = prob[k]
    return n_sealed


@kernel
def sort_by_cell(
    n_cells: int,
    n_sealed: int,
    sealed_cell: NDArray[np.int32],
    sealed_first: NDArray[np.int32],
    sealed_last: NDArray[np.int32],
    sealed_value: NDArray[np.float32],
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """Counting sort of sealed intervals by cell; within a cell they are in order already.

    Returns cells (n_distinct,), offsets (n_distinct + 1,), first, last, value (n_sealed,).
    """
    next_place = np.zeros(n_cells + 1, dtype=np.int64)
    for k in range(n_sealed):
        next_place[sealed_cell[k] + 1] += 1
    n_distinct = 0
    for c in range(n_cells):
        if next_place[c + 1] > 0:
            n_distinct += 1
    cells = np.empty(n_distinct, dtype=np.int32)
    offsets = np.empty(n_distinct + 1, dtype=np.int64)
    d = 0
    for c in range(n_cells):
        if next_place[c + 1] > 0:
            cells[d] = c
            offsets[d] = next_place[c]
            d += 1
        next_place[c + 1] += next_place[c]
    offsets[d] = n_sealed
    first = np.empty(n_sealed, dtype=np.int32)
    last = np.empty(n_sealed, dtype=np.int32)
    value = np.empty(n_sealed, dtype=np.float32)
    for k in range(n_sealed):
        place = next_place[sealed_cell[k]]
        next_place[sealed_cell[k]] += 1
        first[place] = sealed_first[k]
        last[place] = sealed_last[k]
        value[place] = sealed_value[k]
    return cells, offsets, first, last, value


@kernel
def count_per_cell(cells: NDArray[np.int32], offsets: NDArray[np.int64], next_place: NDArray[np.int64]) -> None:
    """Add each cell's number of intervals to ``next_place[cell + 1]``."""
    for i in range(cells.shape[0]):
        next_place[cells[i] + 1] += offsets[i + 1] - offsets[i]


@kernel
def append_to_cells(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    next_place: NDArray[np.int64],
    out_first: NDArray[np.int32],
    out_last: NDArray[np.int32],
    out_value: NDArray[np.float32],
) -> None:
    """Copy each cell's intervals to its next place in the joined arrays, and move that place on."""
    for i in range(cells.shape[0]):
        place = next_place[cells[i]]
        for k in range(offsets[i], offsets[i + 1]):
            out_first[place], out_last[place], out_value[place] = first[k], last[k], value[k]
            place += 1
        next_place[cells[i]] = place
