"""Which reported configuration is which true place: the best one-to-one choice by overlap of their cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tempog.simulation.cell_sets import near

MATCH_IOU = 0.4  # a half of a place has 0.5, a third 0.33
PREFERENCE = 1e-6  # of an observable place over another one with the very same overlap


def tolerant_iou(cells: NDArray[np.int64], others: NDArray[np.int64]) -> float:
    """Overlap of two sets of cells, with a tolerance of one cell.

    i = (cells within a cell of the others + others within a cell of the cells) / 2,
    IoU = i / (n_cells + n_others - i); 0 if both are empty.

    >>> row = np.array([[0, col] for col in range(6)])
    >>> tolerant_iou(row, row + (1, 0)), round(tolerant_iou(row, row[:2]), 3)
    (1.0, 0.455)
    """
    both = (np.count_nonzero(near(cells, others)) + np.count_nonzero(near(others, cells))) / 2
    return float(both / (len(cells) + len(others) - both)) if both else 0.0


def match(
    reported: Sequence[NDArray[np.int64]], places: Sequence[NDArray[np.int64]], preferred: Sequence[bool]
) -> dict[int, tuple[int, float]]:
    """Match configurations with places, each with one at most: as many as possible, then of most total overlap.

    Parameters
    ----------
    reported, places : sequences of (n_cells, 2) int64
    preferred : sequence of bool
        Per place, whether to take it rather than another with the same overlap.

    Returns
    -------
    dict of configuration -> (place, IoU)
        Only pairs whose `tolerant_iou` is `MATCH_IOU` or more.
    """
    from scipy.optimize import linear_sum_assignment

    iou = np.zeros((len(reported), len(places)))
    for i, cells in enumerate(reported):
        for j, others in enumerate(places):
            if len(cells) and len(others) and _boxes_meet(cells, others):
                iou[i, j] = tolerant_iou(cells, others)
    allowed = iou >= MATCH_IOU
    # All overlap together weighs less than one more pair.
    second = (iou + PREFERENCE * np.asarray(preferred, dtype=np.float64)) / (2 + min(iou.shape))
    rows, cols = linear_sum_assignment(np.where(allowed, 1.0 + second, 0.0), maximize=True)
    return {int(i): (int(j), float(iou[i, j])) for i, j in zip(rows, cols, strict=True) if allowed[i, j]}


def _boxes_meet(cells: NDArray[np.int64], others: NDArray[np.int64]) -> bool:
    apart = np.maximum(cells.min(axis=0) - others.max(axis=0), others.min(axis=0) - cells.max(axis=0))
    return bool((apart <= 1).all())
