"""Which places block a way: a closed leaf does, one that stands open hardly ever."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.sensing.grid_spec import Extent

WAY_M = 0.3  # a way is at least so wide; slits beside a leaf's hinge are narrower
AROUND_M = 0.4  # how far from a place both sides of it are looked for; farther away there may be another way
SIDE_M2 = 0.05  # of floor that a side has at least


class _Part(NamedTuple):
    """A rectangle of a map's array."""

    rows: slice
    cols: slice


def blocks_way(floor: NDArray[np.bool_], cells: NDArray[np.int32], extent: Extent) -> bool:
    """Whether something that stands at a place parts floor around it that is connected without it.

    Parameters
    ----------
    floor : (n_rows, n_cols) bool
        Cells that are free if nothing stands there.
    cells : (n, 2) int32
        Lattice row and col of the place's cells.
    extent : Extent
        Where `floor` lies.

    Notes
    -----
    Floor counts from `WAY_M` of width on, and `AROUND_M` around the place; so a detour through another door does not.

    Examples
    --------
    A wall with a gap of 1 m, and what stands in the gap, or in front of it:

    >>> floor = np.ones((40, 40), dtype=bool)
    >>> floor[20, :15] = floor[20, 25:] = False
    >>> extent = Extent(0, 0, 40, 40, 0.1)
    >>> closed = np.array([(20, col) for col in range(15, 25)], dtype=np.int32)
    >>> blocks_way(floor, closed, extent), blocks_way(floor, closed - (8, 4), extent)
    (True, False)
    """
    from scipy.ndimage import distance_transform_edt, label

    margin = math.ceil(AROUND_M / extent.resolution_m)
    part, inside = _around(cells, extent, margin)
    free = floor[part.rows, part.cols]
    closed = free.copy()
    closed[inside[:, 0], inside[:, 1]] = False
    if not free.any():
        return False
    half_width = WAY_M / 2 / extent.resolution_m

    def wide(cells_free: NDArray[np.bool_]) -> NDArray[np.bool_]:
        # Beyond the part nobody knows: its rim is taken for floor that goes on.
        away = distance_transform_edt(np.pad(cells_free, 1, constant_values=True))[1:-1, 1:-1]
        return np.asarray(cells_free & (away > half_width)) if not cells_free.all() else cells_free

    before, _ = label(wide(free))
    after, n_after = label(wide(closed))
    least = max(1, round(SIDE_M2 / extent.resolution_m**2))
    sides: dict[int, int] = {}
    for side in range(1, n_after + 1):
        where = after == side
        if int(where.sum()) >= least:
            was = int(before[where].max())
            sides[was] = sides.get(was, 0) + 1
    return max(sides.values(), default=0) > 1


def _around(cells: NDArray[np.int32], extent: Extent, margin: int) -> tuple[_Part, NDArray[np.int64]]:
    """The part of an array around some cells, and where in it they lie."""
    at = cells.astype(np.int64) - (extent.row0, extent.col0)
    low = np.maximum(at.min(axis=0) - margin, 0)
    high = np.minimum(at.max(axis=0) + margin + 1, extent.shape)
    inside = at[((at >= low) & (at < high)).all(axis=1)] - low
    return _Part(slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))), inside
