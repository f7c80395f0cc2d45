"""Sets of cells as sorted arrays (n_cells, 2) of [row, col], and which of them are near others."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import ConfigError

COLS = 2**32  # more columns than any map has, so that a cell's key is one int64
FARTHEST_CELL = 2**30


def cells_at(points_map: ArrayLike, resolution_m: float) -> NDArray[np.int64]:
    """The cell each point (n, 2) of x, y lies in; (n, 2) [row, col], in the order of the points.

    >>> cells_at([(0.12, -0.01), (0.0, 0.05)], 0.05).tolist()
    [[-1, 2], [1, 0]]
    """
    if not resolution_m > 0:
        raise ConfigError(f"resolution_m = {resolution_m!r} is no cell size; wanted metres above 0")
    points = np.asarray(points_map, dtype=np.float64).reshape(-1, 2)
    cells = np.floor(points[:, ::-1] / resolution_m)
    if not (abs(cells) < FARTHEST_CELL).all():  # also catches NaN
        x, y = points[~(abs(cells) < FARTHEST_CELL).all(axis=1)][0]
        raise ConfigError(f"there is no cell at ({x:g}, {y:g}) m; wanted coordinates of a map, in metres")
    return cells.astype(np.int64)


def cell_keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number per cell that sorts like (row, col)."""
    keys: NDArray[np.int64] = cells[:, 0] * COLS + cells[:, 1]
    return keys


def unique_cells(*several: NDArray[np.int64]) -> NDArray[np.int64]:
    """All cells of some arrays, sorted, each once.

    >>> unique_cells(np.array([[1, 0], [-1, -3]]), np.array([[1, 0]])).tolist()
    [[-1, -3], [1, 0]]
    """
    keys = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *map(cell_keys, several)]))
    cols = (keys + COLS // 2) % COLS - COLS // 2
    return np.column_stack([(keys - cols) // COLS, cols])


def contained(cells: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Per cell, whether it is one of the others."""
    return np.isin(cell_keys(cells), cell_keys(others))


def near(cells: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Per cell, whether it or one of its eight neighbours is one of the others.

    >>> near(np.array([[0, 0], [0, 3]]), np.array([[1, 1]])).tolist()
    [True, False]
    """
    around = [cell_keys(others) + row * COLS + col for row in (-1, 0, 1) for col in (-1, 0, 1)]
    return np.isin(cell_keys(cells), np.concatenate(around))
