"""The cell lattice: the only conversion between world and cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class GridSpec:
    """A lattice of square cells over the whole plane, with a cell corner at the map frame's origin.

    Cell ``[row, col]`` covers ``x`` in ``[col, col + 1) * resolution_m`` and ``y`` likewise by row; both may
    be negative. Row grows with y, col with x.

    >>> spec = GridSpec(resolution_m=0.5)
    >>> spec.cell_of(-0.1, 1.2)
    (2, -1)
    """

    resolution_m: float

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """``(row, col)`` of the cell that holds the point ``x, y`` (map frame, metres)."""
        return math.floor(y / self.resolution_m), math.floor(x / self.resolution_m)

    def centres(self, rows: ArrayLike, cols: ArrayLike) -> NDArray[np.float64]:
        """``(n, 2)`` metres: x and y of the cells' centres."""
        y = (np.asarray(rows, dtype=np.float64) + 0.5) * self.resolution_m
        x = (np.asarray(cols, dtype=np.float64) + 0.5) * self.resolution_m
        return np.stack([x, y], axis=-1)


@dataclass(frozen=True)
class Extent:
    """The rectangle of cells that an array ``[row, col]`` covers.

    Attributes
    ----------
    row0, col0 : int
        Cell of the array's element ``[0, 0]``, its south-west corner.
    n_rows, n_cols : int
    resolution_m : float
    """

    row0: int
    col0: int
    n_rows: int
    n_cols: int
    resolution_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """``(n_rows, n_cols)``."""
        return self.n_rows, self.n_cols

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(x_min, x_max, y_min, y_max)`` in metres, as Matplotlib's ``extent`` wants it."""
        return (
            self.col0 * self.resolution_m,
            (self.col0 + self.n_cols) * self.resolution_m,
            self.row0 * self.resolution_m,
            (self.row0 + self.n_rows) * self.resolution_m,
        )

    def index_of(self, x: float, y: float) -> tuple[int, int] | None:
        """Array index ``(row, col)`` of the point (map frame, metres); None outside."""
        row, col = GridSpec(self.resolution_m).cell_of(x, y)
        row, col = row - self.row0, col - self.col0
        inside = 0 <= row < self.n_rows and 0 <= col < self.n_cols
        return (row, col) if inside else None
