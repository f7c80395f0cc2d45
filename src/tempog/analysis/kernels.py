"""Kernels over the intervals of all cells. Times are scan numbers until a weight needs seconds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel


@kernel
def add_sums(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    since: int,
    until: int,
    stamps_s: NDArray[np.float64],
    look_s: float,
    sum_weight: NDArray[np.float64],
    sum_value: NDArray[np.float64],
) -> None:
    """Add each interval's weight, and weight times value, to its cell; clipped to scans since..until.

    stamps_s (n_scans,) seconds from any origin
    look_s   seconds that an interval of one look counts for, on top of its length; or NaN to count
             every interval once
    """
    for i in range(cells.shape[0]):
        c = cells[i]
        for k in range(offsets[i], offsets[i + 1]):
            if first[k] > until or last[k] < since:
                continue
            weight = 1.0
            if look_s == look_s:
                weight = stamps_s[min(last[k], until)] - stamps_s[max(first[k], since)] + look_s
            sum_weight[c] += weight
            sum_value[c] += weight * value[k]


@kernel
def add_deviations(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    since: int,
    until: int,
    stamps_s: NDArray[np.float64],
    look_s: float,
    mean: NDArray[np.float64],
    squared: bool,
    sum_deviation: NDArray[np.float64],
) -> None:
    """Add each interval's weighted distance from the cell's mean, or its square; see `add_sums`."""
    for i in range(cells.shape[0]):
        c = cells[i]
        for k in range(offsets[i], offsets[i + 1]):
            if first[k] > until or last[k] < since:
                continue
            weight = 1.0
            if look_s == look_s:
                weight = stamps_s[min(last[k], until)] - stamps_s[max(first[k], since)] + look_s
            distance = abs(value[k] - mean[c])
            sum_deviation[c] += weight * (distance * distance if squared else distance)


@kernel
def add_logodds(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    since: int,
    until: int,
    lowest: float,
    highest: float,
    seen: NDArray[np.bool_],
    logodds: NDArray[np.float64],
) -> None:
    """Update each cell's log-odds by its intervals in time order, one measurement per scan they span."""
    for i in range(cells.shape[0]):
        c = cells[i]
        total = logodds[c]
        for k in range(offsets[i], offsets[i + 1]):
            if first[k] > until or last[k] < since:
                continue
            seen[c] = True
            n = min(last[k], until) - max(first[k], since) + 1
            total += n * np.log(value[k] / (1.0 - value[k]))
            total = min(max(total, lowest), highest)
        logodds[c] = total


@kernel
def mark_above(
    cells: NDArray[np.int32],
    offsets: NDArray[np.int64],
    first: NDArray[np.int32],
    last: NDArray[np.int32],
    value: NDArray[np.float32],
    since: int,
    until: int,
    above: float,
    found: NDArray[np.bool_],
) -> None:
    """Mark cells whose value was above `above` in an interval that the scans since..until saw."""
    for i in range(cells.shape[0]):
        for k in range(offsets[i], offsets[i + 1]):
            if value[k] > above and first[k] <= until and last[k] >= since:
                found[cells[i]] = True
                break
