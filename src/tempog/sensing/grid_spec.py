"""The cell lattice: the only conversion between world and cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

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


class Bounds(NamedTuple):
    """A rectangle in the map frame, metres.

    >>> print(Bounds(0.0, 2.0, -1.0, 1.0).grown(0.5))
    x -0.50 to 2.50 m, y -1.50 to 1.50 m
    """

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    def __str__(self) -> str:
        return f"x {self.x_min:.2f} to {self.x_max:.2f} m, y {self.y_min:.2f} to {self.y_max:.2f} m"

    def grown(self, by_m: float) -> Bounds:
        """The rectangle with so much more on every side."""
        return Bounds(self.x_min - by_m, self.x_max + by_m, self.y_min - by_m, self.y_max + by_m)

    def holds(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of some points, (n, 2) metres, lie in it."""
        x, y = points[:, 0], points[:, 1]
        return np.asarray((x >= self.x_min) & (x <= self.x_max) & (y >= self.y_min) & (y <= self.y_max))


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
