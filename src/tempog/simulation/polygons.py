"""Convex polygons: their outline as segments, the cells they cover, and how far they are from others."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import ConfigError, WorldError

Point = tuple[float, float]
Pose = tuple[float, float, float]

SMALLEST_AREA_M2 = 1e-6  # a wall below has no inside that anything could be kept out of
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


def placed(rectangle: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """A polygon of a thing's own frame, in the map frame."""
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    return np.asarray(rectangle @ np.array([[c, s], [-s, c]]) + (x, y))


def strip_corners(start: Point, end: Point, thickness_m: float) -> NDArray[np.float64]:
    """The corners of a strip with the given middle line, (4, 2) metres."""
    p, q = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    along = (q - p) / np.hypot(*(q - p))
    across = np.array([-along[1], along[0]]) * thickness_m / 2
    return np.array([p - across, q - across, q + across, p + across])


def check_wall(corners: tuple[Point, ...], key: str) -> None:
    """Raise WorldError for a wall that is no convex polygon with an inside."""
    points = np.array(corners, dtype=np.float64)
    sides = np.roll(points, -1, axis=0) - points
    following = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0]
    x, y = points.T
    area = abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2
    if not area >= SMALLEST_AREA_M2:
        raise WorldError(f"{key} at {middle_text(points)} has no area; wanted corners around one, in metres")
    if (turns < -1e-9).any() and (turns > 1e-9).any():
        raise WorldError(f"{key} at {middle_text(points)} is not convex; wanted it as several convex pieces")


def disc_gap(point: Point, corners: NDArray[np.float64]) -> float:
    """Distance from a point to a convex polygon; 0 inside. Metres."""
    return leg_gap(point, point, corners)


def leg_gap(start: Point, end: Point, corners: NDArray[np.float64]) -> float:
    """Distance between a straight way and a convex polygon; 0 if they meet. Metres."""
    a, b = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    sides = outline(corners)
    p, q = sides[:, :2], sides[:, 2:]
    side, way = q - p, b - a
    crossing = np.zeros(len(sides), dtype=bool)
    determinant = way[0] * side[:, 1] - way[1] * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((p - a)[:, 0] * side[:, 1] - (p - a)[:, 1] * side[:, 0]) / determinant
        v = ((p - a)[:, 0] * way[1] - (p - a)[:, 1] * way[0]) / determinant
        crossing = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    left = side[:, 0] * (a - p)[:, 1] - side[:, 1] * (a - p)[:, 0]
    if crossing.any() or (left >= 0).all() or (left <= 0).all():
        return 0.0
    gaps = [_point_gap(end_, p, side) for end_ in (a, b)]
    if way.any():
        gaps.append(np.array([_point_gap(corner, a[None], way[None]).min() for corner in p]))
    return float(min(gap.min() for gap in gaps))


def _point_gap(point: NDArray[np.float64], p: NDArray[np.float64], side: NDArray[np.float64]) -> NDArray[np.float64]:
    u = np.clip(((point - p) * side).sum(axis=1) / (side**2).sum(axis=1), 0.0, 1.0)
    return np.asarray(np.hypot(*(p + u[:, None] * side - point).T))


def middle_text(points: NDArray[np.float64]) -> str:
    x, y = points.mean(axis=0)
    return f"({x:.2f}, {y:.2f}) m"
