"""Whether walls are drawn over each other: they may meet and cross, but not lie along each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tempog.errors import WorldError
from tempog.simulation.polygons import middle_text

SLIM = 4.0  # a polygon this many times as long as wide runs somewhere; others are blocks
ALONG_RAD = math.radians(15.0)  # between walls that run the same way
ALONG_SHARE = 1.5  # of the thickness: so far may they overlap lengthwise; a bend takes a little more than once
WALL_M = 0.15  # how far blocks may reach into each other
ROUNDING_M = 1e-6


def check_overlaps(walls: Sequence[tuple[str, NDArray[np.float64]]]) -> None:
    """Raise WorldError if two convex walls, each a key and its corners (n_corners, 2), are drawn over each other.

    Slim walls that run the same way within 15 degrees may overlap by 1.5 times their thickness, as they do where
    a line bends. Others may cross. A block and something else may overlap by the thickness of the latter, or by
    0.15 m if both are blocks.
    """
    if len(walls) < 2:
        return
    low = np.array([corners.min(axis=0) for _, corners in walls])
    high = np.array([corners.max(axis=0) for _, corners in walls])
    near = ((low[:, None] < high[None] - ROUNDING_M) & (low[None] < high[:, None] - ROUNDING_M)).all(axis=2)
    shapes = [_shape(corners) for _, corners in walls]
    for i, j in np.argwhere(np.triu(near, 1)).tolist():
        common = overlap(walls[i][1], walls[j][1])
        if len(common) < 3:
            continue
        (heading, width, slim), (other_heading, other_width, other_slim) = shapes[i], shapes[j]
        where = f"around {middle_text(common)}"
        if slim and other_slim:
            turn = abs(math.remainder(heading - other_heading, math.pi))
            along = float(np.ptp(common @ (math.cos(heading), math.sin(heading))))
            if turn < ALONG_RAD and along > ALONG_SHARE * max(width, other_width) + ROUNDING_M:
                raise WorldError(
                    f"{walls[j][0]} lies along {walls[i][0]} for {along:.2f} m {where}; wanted walls that only meet"
                    " or cross"
                )
            continue
        allowed = min([own for own, is_slim in ((width, slim), (other_width, other_slim)) if is_slim] or [WALL_M])
        depth = _width(common)[0]
        if depth > allowed + ROUNDING_M:
            raise WorldError(
                f"{walls[j][0]} overlaps {walls[i][0]} by {depth:.2f} m {where}; wanted at most {allowed:g} m where a"
                " block is one of them"
            )


def overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """What two convex polygons have in common, (n_corners, 2); fewer than three corners if nothing."""
    x, y = b.T
    if x @ np.roll(y, -1) - y @ np.roll(x, -1) < 0:
        b = b[::-1]
    kept = [tuple(point) for point in a.tolist()]
    for (px, py), (qx, qy) in zip(b.tolist(), np.roll(b, -1, axis=0).tolist(), strict=True):
        sides = [(qx - px) * (y - py) - (qy - py) * (x - px) for x, y in kept]
        clipped = []
        for k, ((x1, y1), left) in enumerate(zip(kept, sides, strict=True)):
            (x0, y0), left_before = kept[k - 1], sides[k - 1]
            if (left > 0) != (left_before > 0):
                u = left_before / (left_before - left)
                clipped.append((x0 + u * (x1 - x0), y0 + u * (y1 - y0)))
            if left > 0:
                clipped.append((x1, y1))
        kept = clipped
    return np.array(kept).reshape(-1, 2)


def _shape(corners: NDArray[np.float64]) -> tuple[float, float, bool]:
    """Where a convex polygon runs (rad), how wide it is across, and whether it is slim."""
    width, heading = _width(corners)
    length = float(np.ptp(corners @ (math.cos(heading), math.sin(heading))))
    return heading, width, length >= SLIM * width


def _width(corners: NDArray[np.float64]) -> tuple[float, float]:
    """The least width of a convex polygon, and the direction across which it is measured (rad)."""
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*sides.T)
    sides = sides[lengths > ROUNDING_M]
    if not len(sides):
        return 0.0, 0.0
    normals = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.hypot(*sides.T)[:, None]
    widths = np.ptp(corners @ normals.T, axis=0)
    k = int(widths.argmin())
    return float(widths[k]), math.atan2(sides[k, 1], sides[k, 0])
