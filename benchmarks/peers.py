"""What tempog is timed against, each written the ordinary way.

- `LogOddsGrid`: the classic occupancy grid without any history, in Numba like ours.
- `OctoMap`: the usual C++ library, through pyoctomap.
- `DictionaryGrid`: the same history as ours, as a dictionary of lists in plain Python.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog import Scan
from tempog._jit import kernel

# OctoMap's defaults (Hornung et al. 2013).
LOGODDS_HIT = np.float32(0.85)
LOGODDS_FREE = np.float32(-0.4)
LOGODDS_LOWEST = np.float32(-2.0)
LOGODDS_HIGHEST = np.float32(3.5)


@kernel
def add_scan(
    angles: NDArray[np.float64],
    ranges: NDArray[np.float32],
    x: float,
    y: float,
    theta: float,
    row0: int,
    col0: int,
    n_cols: int,
    resolution: float,
    hit: np.float32,
    free: np.float32,
    lowest: np.float32,
    highest: np.float32,
    logodds: NDArray[np.float32],
) -> None:
    """Walk every beam (Amanatides and Woo 1987): the cells it leaves are freer, the one it ends in is hit."""
    start_x, start_y = x / resolution - col0, y / resolution - row0
    start = int(start_y) * n_cols + int(start_x)
    for i in range(angles.shape[0]):
        length = float(ranges[i])
        if not length > 0:  # also leaves NaN out
            continue
        direction = theta + angles[i]
        ux, uy = math.cos(direction), math.sin(direction)
        next_x, next_y, per_col, per_row = math.inf, math.inf, math.inf, math.inf
        step_x, step_y = 1, n_cols
        if ux > 0:
            per_col = resolution / ux
            next_x = (int(start_x) + 1 - start_x) * per_col
        elif ux < 0:
            step_x = -1
            per_col = -resolution / ux
            next_x = (start_x - int(start_x)) * per_col
        if uy > 0:
            per_row = resolution / uy
            next_y = (int(start_y) + 1 - start_y) * per_row
        elif uy < 0:
            step_y = -n_cols
            per_row = -resolution / uy
            next_y = (start_y - int(start_y)) * per_row
        k = start
        while min(next_x, next_y) <= length:
            logodds[k] = max(logodds[k] + free, lowest)
            if next_x < next_y:
                k += step_x
                next_x += per_col
            else:
                k += step_y
                next_y += per_row
        logodds[k] = min(logodds[k] + hit, highest)


class LogOddsGrid:
    """A dense occupancy grid over bounds that are known beforehand.

    Parameters
    ----------
    bounds : (x_min, x_max, y_min, y_max), metres
    resolution_m : float, metres
    """

    def __init__(self, bounds: tuple[float, float, float, float], resolution_m: float) -> None:
        col0, col1, row0, row1 = (math.floor(bound / resolution_m) for bound in bounds)
        self.row0, self.col0 = row0 - 1, col0 - 1  # a rim of one cell, for rounding
        self.resolution_m = resolution_m
        self.logodds = np.zeros((row1 - row0 + 3, col1 - col0 + 3), dtype=np.float32)
        self._flat = self.logodds.reshape(-1)

    def integrate(self, scan: Scan) -> None:
        """Add one scan: one kernel call."""
        add_scan(
            scan.angles,
            scan.ranges,
            scan.x,
            scan.y,
            scan.theta,
            self.row0,
            self.col0,
            self.logodds.shape[1],
            self.resolution_m,
            LOGODDS_HIT,
            LOGODDS_FREE,
            LOGODDS_LOWEST,
            LOGODDS_HIGHEST,
            self._flat,
        )


class OctoMap:
    """OctoMap, one layer of voxels.

    Parameters
    ----------
    resolution_m, max_range_m : float, metres

    Raises
    ------
    ImportError
        pyoctomap is not installed.
    """

    def __init__(self, resolution_m: float, max_range_m: float) -> None:
        import pyoctomap

        self.tree = pyoctomap.OcTree(resolution_m)
        self.max_range_m = max_range_m

    def integrate(self, points_map: NDArray[np.float64], origin: NDArray[np.float64]) -> None:
        """Add one scan, given as its end points; leaves the inner nodes for later."""
        self.tree.insertPointCloud(points_map, origin, self.max_range_m, True)

    def finish(self) -> None:
        """Update the inner nodes, once after all scans."""
        self.tree.updateInnerOccupancy()


class DictionaryGrid:
    """Every cell's list of [first stamp, last stamp, value], after Fig. 4 of the paper.

    Parameters
    ----------
    resolution_m : float, metres
    gap_ns : int, nanoseconds
    tolerance, prob_hit, prob_free : float
    """

    def __init__(self, resolution_m: float, gap_ns: int, tolerance: float, prob_hit: float, prob_free: float) -> None:
        self.resolution_m = resolution_m
        self.gap_ns = gap_ns
        self.tolerance = tolerance
        self.prob_hit = prob_hit
        self.prob_free = prob_free
        self.history: dict[tuple[int, int], list[tuple[int, int, float]]] = {}

    @property
    def n_intervals(self) -> int:
        """Intervals of all cells."""
        return sum(len(intervals) for intervals in self.history.values())

    def integrate(self, scan: Scan) -> None:
        """Add one scan; a hit wins over free."""
        hits, free = set(), set()
        for angle, length in zip(scan.angles.tolist(), scan.ranges.tolist(), strict=True):
            if length > 0:
                direction = scan.theta + angle
                x = scan.x + length * math.cos(direction)
                y = scan.y + length * math.sin(direction)
                hits.add((math.floor(y / self.resolution_m), math.floor(x / self.resolution_m)))
                free.update(self._cells_left(scan, x, y, length))
        for cell in hits:
            self._observe(cell, scan.stamp_ns, self.prob_hit)
        for cell in free - hits:
            self._observe(cell, scan.stamp_ns, self.prob_free)

    def _cells_left(self, scan: Scan, end_x: float, end_y: float, length: float) -> list[tuple[int, int]]:
        """Cells that the beam leaves before its end (Amanatides and Woo 1987)."""
        x, y = scan.x / self.resolution_m, scan.y / self.resolution_m
        row, col = math.floor(y), math.floor(x)
        step_col, next_x, per_col = _pace(x, col, (end_x - scan.x) / length, self.resolution_m)
        step_row, next_y, per_row = _pace(y, row, (end_y - scan.y) / length, self.resolution_m)
        cells = []
        while min(next_x, next_y) <= length:
            cells.append((row, col))
            if next_x < next_y:
                col += step_col
                next_x += per_col
            else:
                row += step_row
                next_y += per_row
        return cells

    def _observe(self, cell: tuple[int, int], stamp_ns: int, prob: float) -> None:
        """Fig. 4: extend the cell's last interval, or begin another."""
        intervals = self.history.setdefault(cell, [])
        if intervals:
            first, last, value = intervals[-1]
            if last >= stamp_ns - self.gap_ns and abs(prob - value) <= self.tolerance:
                intervals[-1] = (first, stamp_ns, value)
                return
        intervals.append((stamp_ns, stamp_ns, prob))


def _pace(start: float, cell: int, component: float, resolution_m: float) -> tuple[int, float, float]:
    """Step, distance to the first border and distance between borders along one axis."""
    if component > 0:
        per_cell = resolution_m / component
        return 1, (cell + 1 - start) * per_cell, per_cell
    if component < 0:
        per_cell = -resolution_m / component
        return -1, (start - cell) * per_cell, per_cell
    return 0, math.inf, math.inf
