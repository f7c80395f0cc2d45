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

    def around(self, other: Extent) -> Extent:
        """The smallest extent that holds both; one without cells adds nothing.

        >>> Extent(0, 0, 2, 3, 0.1).around(Extent(-1, 1, 1, 4, 0.1))
        Extent(row0=-1, col0=0, n_rows=3, n_cols=5, resolution_m=0.1)
        """
        if not (self.n_rows and other.n_rows):
            return self if self.n_rows else other
        row0, col0 = min(self.row0, other.row0), min(self.col0, other.col0)
        n_rows = max(self.row0 + self.n_rows, other.row0 + other.n_rows) - row0
        n_cols = max(self.col0 + self.n_cols, other.col0 + other.n_cols) - col0
        return Extent(row0, col0, n_rows, n_cols, self.resolution_m)

    def part_of(self, other: Extent) -> tuple[slice, slice]:
        """Where in an array over another extent the cells lie that both have.

        >>> Extent(0, 0, 2, 3, 0.1).part_of(Extent(-1, 1, 2, 9, 0.1))
        (slice(1, 2, None), slice(0, 2, None))
        """
        return (
            _part(self.row0, self.n_rows, other.row0, other.n_rows),
            _part(self.col0, self.n_cols, other.col0, other.n_cols),
        )

    def index_of(self, x: float, y: float) -> tuple[int, int] | None:
        """Array index ``(row, col)`` of the point (map frame, metres); None outside."""
        row, col = GridSpec(self.resolution_m).cell_of(x, y)
        row, col = row - self.row0, col - self.col0
        inside = 0 <= row < self.n_rows and 0 <= col < self.n_cols
        return (row, col) if inside else None


def _part(begin: int, n: int, other_begin: int, n_other: int) -> slice:
    first, end = max(begin - other_begin, 0), min(begin + n - other_begin, n_other)
    return slice(first, max(first, end))
