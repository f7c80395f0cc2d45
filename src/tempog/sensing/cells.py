"""Kernels from a scan's window to numbered cells: claim their tiles, and remember where in them the hits fell.

As in `raycast`: metres, no validation, and a window whose rows are 2**shift entries apart.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel

# Half of the length of hit points that are spread evenly over a cell, in standard deviations, is sqrt(3).
EXTENT_SIGMAS = 1.8
# ... and never less than this to either side, m: identical hit points still have a beam's width.
MIN_EXTENT = 0.003


@kernel
def number_cells(
    touched: NDArray[np.int32],
    n_touched: int,
    row0: int,
    col0: int,
    shift: int,
    directory: NDArray[np.int32],
    dir_row0: int,
    dir_col0: int,
    tile_rows: NDArray[np.int32],
    tile_cols: NDArray[np.int32],
    n_tiles: int,
    cells: NDArray[np.int32],
) -> int:
    """Window cells to cell numbers, claiming tiles as needed; returns the new `n_tiles`.

    cells (n_touched or more,) int32   [written]
    directory, tile_rows, tile_cols    [updated]; room for one new tile per tile of the window
    """
    mask = (1 << shift) - 1
    for i in range(n_touched):
        k = np.int64(touched[np.uint64(i)])
        row, col = (k >> shift) + row0, (k & mask) + col0
        r, c = np.uint64((row >> 3) - dir_row0), np.uint64((col >> 3) - dir_col0)
        tile = directory[r, c]
        if tile < 0:
            tile = np.int32(n_tiles)
            directory[r, c] = tile
            tile_rows[n_tiles] = row >> 3
            tile_cols[n_tiles] = col >> 3
            n_tiles += 1
        cells[np.uint64(i)] = tile * 64 + (row & 7) * 8 + (col & 7)
    return n_tiles


@kernel
def claim_tiles_of_hits(
    end_x: NDArray[np.float64],
    end_y: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    resolution: float,
    directory: NDArray[np.int32],
    dir_row0: int,
    dir_col0: int,
    tile_rows: NDArray[np.int32],
    tile_cols: NDArray[np.int32],
    n_tiles: int,
) -> int:
    """See that every hit has a tile, stated or not; returns the new `n_tiles`. As `number_cells`."""
    for i in range(end_x.shape[0]):
        if is_hit[i]:
            tile_row = math.floor(end_y[i] / resolution) >> 3
            tile_col = math.floor(end_x[i] / resolution) >> 3
            if directory[tile_row - dir_row0, tile_col - dir_col0] < 0:
                directory[tile_row - dir_row0, tile_col - dir_col0] = n_tiles
                tile_rows[n_tiles], tile_cols[n_tiles] = tile_row, tile_col
                n_tiles += 1
    return n_tiles


@kernel
def add_hit_points(
    end_x: NDArray[np.float64],
    end_y: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    resolution: float,
    directory: NDArray[np.int32],
    dir_row0: int,
    dir_col0: int,
    slot_of_cell: NDArray[np.int32],
    cell_of_slot: NDArray[np.int32],
    hit_count: NDArray[np.int32],
    moments: NDArray[np.float32],
    lines: NDArray[np.float32],
    keeps_lines: bool,
    n_slots: int,
) -> int:
    """Add each hit to its cell's count, mean and covariance (Welford 1962); returns the new `n_slots`.

    moments (capacity, 5) float32: mean x, mean y (metres from the cell's centre), then the population
    covariance xx, xy, yy (m²)   [updated]; room for one new slot per hit
    lines (capacity, 3) float32: the line through the hit points, along the larger axis of their covariance:
    its direction, or zeros where the points are one, and how far the points reach to either side (m)
    [updated if `keeps_lines`]
    """
    for i in range(end_x.shape[0]):
        if not is_hit[i]:
            continue
        row, col = math.floor(end_y[i] / resolution), math.floor(end_x[i] / resolution)
        tile = directory[(row >> 3) - dir_row0, (col >> 3) - dir_col0]
        cell = tile * 64 + (row & 7) * 8 + (col & 7)
        slot = slot_of_cell[cell]
        if slot < 0:
            slot = np.int32(n_slots)
            slot_of_cell[cell] = slot
            cell_of_slot[slot] = cell
            hit_count[slot] = 0
            for m in range(5):
                moments[slot, m] = 0.0
            n_slots += 1
        hit_count[slot] += 1
        weight = 1.0 / hit_count[slot]
        dx = end_x[i] - (col + 0.5) * resolution - moments[slot, 0]
        dy = end_y[i] - (row + 0.5) * resolution - moments[slot, 1]
        moments[slot, 0] += dx * weight
        moments[slot, 1] += dy * weight
        rest = 1.0 - weight
        moments[slot, 2] += (dx * dx * rest - moments[slot, 2]) * weight
        moments[slot, 3] += (dx * dy * rest - moments[slot, 3]) * weight
        moments[slot, 4] += (dy * dy * rest - moments[slot, 4]) * weight
        if not keeps_lines:
            continue
        lines[slot, 0], lines[slot, 1], lines[slot, 2] = _line(moments[slot, 2], moments[slot, 3], moments[slot, 4])
    return n_slots


@kernel
def find_lines(moments: NDArray[np.float32], lines: NDArray[np.float32]) -> None:
    """The lines that `add_hit_points` keeps, worked out from the moments; to the last bit.

    moments (n_slots, 5), lines (n_slots, 3)   [lines written]
    """
    for slot in range(moments.shape[0]):
        lines[slot, 0], lines[slot, 1], lines[slot, 2] = _line(moments[slot, 2], moments[slot, 3], moments[slot, 4])


@kernel
def _line(cov_xx: np.float32, cov_xy: np.float32, cov_yy: np.float32) -> tuple[float, float, float]:
    """Direction of the larger axis of a covariance, or zeros, and how far the points reach to either side, metres."""
    xx, xy, yy = np.float64(cov_xx), np.float64(cov_xy), np.float64(cov_yy)
    half = 0.5 * (xx - yy)
    root = math.sqrt(half * half + xy * xy)
    ex, ey = half + root, xy
    if half < 0:
        ex, ey = xy, root - half
    norm = math.hypot(ex, ey)
    if norm > 0:
        ex, ey = ex / norm, ey / norm
    return ex, ey, EXTENT_SIGMAS * math.sqrt(max(0.5 * (xx + yy) + root, 0.0)) + MIN_EXTENT
