"""Kernel: which cells do beams cross, and in which period?"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel


@kernel
def count_crossings(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
    reach: NDArray[np.float64],
    period: NDArray[np.int64],
    low: NDArray[np.float64],
    side: float,
    middle: NDArray[np.float64],
    radius: float,
    crossed: NDArray[np.bool_],
    n_beams: NDArray[np.int64],
) -> None:
    """Mark the cells that beams cross and end behind, for each period; count the beams that cross any.

    x, y, cos, sin, reach  (n_scans, n_beams)    float64  where a beam starts, its direction, its length
    period                 (n_scans,)            int64    which period a scan belongs to; negative: none
    low                    (n_cells, 2)          float64  x, y of each cell's lower left corner
    side                                         float64  of a cell
    middle, radius         (2,)                  float64  a circle around all cells
    crossed                (n_periods, n_cells)  bool                                        [updated]
    n_beams                (n_periods,)          int64                                       [updated]

    A beam that only touches a cell's corner or border does not cross it.
    """
    for i in range(x.shape[0]):
        p = period[i]
        if p < 0:
            continue
        for j in range(x.shape[1]):
            c = cos[i, j]
            s = sin[i, j]
            to_x = middle[0] - x[i, j]
            to_y = middle[1] - y[i, j]
            if abs(c * to_y - s * to_x) > radius:
                continue
            ahead = c * to_x + s * to_y
            if ahead < -radius or ahead - radius > reach[i, j]:
                continue
            crosses = False
            for k in range(low.shape[0]):
                enter = 0.0
                leave = math.inf
                near_x = low[k, 0] - x[i, j]
                near_y = low[k, 1] - y[i, j]
                if c != 0.0:
                    a = near_x / c
                    b = (near_x + side) / c
                    enter = max(enter, min(a, b))
                    leave = min(leave, max(a, b))
                elif near_x >= 0.0 or near_x + side <= 0.0:
                    continue
                if s != 0.0:
                    a = near_y / s
                    b = (near_y + side) / s
                    enter = max(enter, min(a, b))
                    leave = min(leave, max(a, b))
                elif near_y >= 0.0 or near_y + side <= 0.0:
                    continue
                if enter < leave < reach[i, j]:
                    crossed[p, k] = True
                    crosses = True
            if crosses:
                n_beams[p] += 1
