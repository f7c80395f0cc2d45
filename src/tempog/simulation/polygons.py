"""Convex polygons: their outline as segments, and the cells they cover."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import ConfigError

TOUCHING_M = 1e-9  # a polygon that reaches into a cell by less only touches it; far above rounding errors


def outline(corners: ArrayLike) -> NDArray[np.float64]:
    """The sides of a polygon, each from one corner to the next.

    Parameters
    ----------
    corners : (n_corners, 2) metres

    Returns
    -------
    (n_corners, 4) float64, metres
        x0, y0, x1, y1.
    """
    points = np.asarray(corners, dtype=np.float64)
    return np.hstack([points, np.roll(points, -1, axis=0)])


def covered_cells(corners: ArrayLike, resolution_m: float) -> NDArray[np.int64]:
    """The cells that a convex polygon covers at least in part.

    Parameters
    ----------
    corners : (n_corners, 2) metres
        In order around the polygon, either way.
    resolution_m : float, metres
        Side of a cell.

    Returns
    -------
    (n_cells, 2) int64
        [row, col] with row = floor(y / resolution_m) and col = floor(x / resolution_m), so they may be
        negative; sorted by row, then column.

    Raises
    ------
    ConfigError
        `resolution_m` is not above 0.

    Examples
    --------
    >>> covered_cells([(0.0, 0.0), (0.3, 0.0), (0.3, 0.1), (0.0, 0.1)], 0.1).tolist()
    [[0, 0], [0, 1], [0, 2]]
    """
    if not resolution_m > 0:
        raise ConfigError(f"resolution_m = {resolution_m!r} is no cell size; wanted metres above 0")
    points = np.asarray(corners, dtype=np.float64)
    low = np.floor((points.min(axis=0) - TOUCHING_M) / resolution_m).astype(np.int64)
    high = np.floor((points.max(axis=0) + TOUCHING_M) / resolution_m).astype(np.int64)
    rows, cols = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1]
    centre_x = (cols + 0.5) * resolution_m
    centre_y = (rows + 0.5) * resolution_m

    # Two convex shapes overlap unless a line parallel to one of their sides parts them.
    sides = np.roll(points, -1, axis=0) - points
    normals = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.hypot(sides[:, 0], sides[:, 1])[:, None]
    covered = np.ones(rows.shape, dtype=bool)
    for nx, ny in [(1.0, 0.0), (0.0, 1.0), *normals]:
        along = points @ (nx, ny)
        centre = centre_x * nx + centre_y * ny
        reach = resolution_m / 2 * (abs(nx) + abs(ny)) - TOUCHING_M
        covered &= (centre + reach > along.min()) & (centre - reach < along.max())
    return np.column_stack([rows[covered], cols[covered]])
