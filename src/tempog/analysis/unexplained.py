"""Where known walls and places do not explain what scans say, for how long, and so which areas to look at again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tempog._arrays import grown
from tempog.sensing.grid_spec import Bounds
from tempog.sensing.tiles import TileIndex
from tempog.times import NS_PER_S

# A spell counts once it was looked at for so long; people pass through a cell of 5 cm in a fifth of that.
SPELL_SEEN_S = 1.0
LONGEST_LOOK_S = 0.3  # a look of a scanner that looks every few seconds proves no more than one of a fast one
# A place is taken for at least so long from first to last look, or again and again: as `long_stay_s` of the method.
STAY_S = 20.0
STAYS = 2
MOST_LESSONS = 20  # doublings of the patience with a cell, 2**20 * 20 s being most of a year
PIECE_M = 0.2  # cells this far apart belong together, and ...
SMALLEST_M = 0.3  # ... smaller groups of them are no door and no box
MARGIN_M = 0.25  # what belongs to them is as near as this
MERGE_M = 1.0  # areas nearer to each other are one: each costs a rim around it


class Unexplained:
    """For each cell of a tracker, how long scans have contradicted what is known of it.

    A few numbers per cell, whatever the time. While a scan contradicts it, a cell's bucket fills, while others do not
    it drains; full, it is the spell of something that stands there. Cells that an analysis has looked at in vain are
    given twice the time at each further try, so that no place is learned for ever.
    """

    def __init__(self) -> None:
        self._bucket_s = np.empty(0, dtype=np.float32)
        self._since_ns = np.empty(0, dtype=np.int64)
        self._counted = np.empty(0, dtype=np.bool_)
        self._spells = np.empty(0, dtype=np.int32)
        self._lessons = np.empty(0, dtype=np.uint8)
        self._due = np.empty(0, dtype=np.bool_)
        self._last_ns: int | None = None

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        parts = (self._bucket_s, self._since_ns, self._counted, self._spells, self._lessons, self._due)
        return sum(part.nbytes for part in parts)

    def look(self, stamp_ns: int, n_cells: int, cells: NDArray[np.int32], strange: NDArray[np.bool_]) -> None:
        """Take in which of the cells that a scan saw contradict what is known; `n_cells` there are in all."""
        if n_cells > len(self._due):
            room = n_cells + n_cells // 4
            self._bucket_s, self._since_ns = grown(self._bucket_s, room, fill=0), grown(self._since_ns, room, fill=0)
            self._spells, self._lessons = grown(self._spells, room, fill=0), grown(self._lessons, room, fill=0)
            self._counted, self._due = grown(self._counted, room, fill=False), grown(self._due, room, fill=False)
        look_s = 0.0
        if self._last_ns is not None:
            look_s = min((stamp_ns - self._last_ns) / NS_PER_S, LONGEST_LOOK_S)
        self._last_ns = stamp_ns
        drained = cells[~strange]
        drained = drained[self._bucket_s[drained] > 0]
        self._bucket_s[drained] -= look_s
        over = drained[self._bucket_s[drained] <= 0]
        self._bucket_s[over], self._counted[over] = 0.0, False
        odd = cells[strange]
        if not len(odd):
            return
        self._since_ns[odd[self._bucket_s[odd] <= 0]] = stamp_ns
        self._bucket_s[odd] = np.minimum(self._bucket_s[odd] + look_s, SPELL_SEEN_S)
        begun = odd[(self._bucket_s[odd] >= SPELL_SEEN_S) & ~self._counted[odd]]
        self._counted[begun] = True
        self._spells[begun] += 1
        standing = odd[self._counted[odd]]
        patience = np.exp2(self._lessons[standing].astype(np.float64))
        stayed = stamp_ns - self._since_ns[standing] >= STAY_S * NS_PER_S * patience
        self._due[standing[stayed | (self._spells[standing] >= STAYS * patience)]] = True

    def areas(self, tiles: TileIndex) -> list[Bounds]:
        """Rectangles around groups of cells that have been unexplained for long or repeatedly."""
        cells = np.flatnonzero(self._due).astype(np.int32)
        if not len(cells):
            return []
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        resolution_m = tiles.spec.resolution_m
        points = tiles.spec.centres(*tiles.rows_cols(cells))
        left, right = cKDTree(points).query_pairs(PIECE_M + 1e-9, output_type="ndarray").T
        linked = coo_array((np.ones(len(left), np.bool_), (left, right)), shape=(len(cells), len(cells)))
        n_groups, group = connected_components(linked, directed=False)
        low, high = np.full((n_groups, 2), np.inf), np.full((n_groups, 2), -np.inf)
        np.minimum.at(low, group, points)
        np.maximum.at(high, group, points)
        large = np.hypot(*(high - low + resolution_m).T) >= SMALLEST_M
        corners = zip(low[large].tolist(), high[large].tolist(), strict=True)
        return merged([Bounds(x0, x1, y0, y1).grown(MARGIN_M) for (x0, y0), (x1, y1) in corners])

    def learned(self, cells: NDArray[np.int32]) -> None:
        """Cells were analysed again: what was due is due again after twice the time, or twice as many spells."""
        cells = cells[cells < len(self._due)]
        due = cells[self._due[cells]]
        self._lessons[due] = np.minimum(self._lessons[due] + 1, MOST_LESSONS)
        self._due[due] = False


def merged(areas: list[Bounds]) -> list[Bounds]:
    """Rectangles, those that lie within `MERGE_M` of each other as one around both.

    >>> merged([Bounds(0, 1, 0, 1), Bounds(9, 10, 0, 1), Bounds(1.5, 2, 0, 3)])
    [Bounds(x_min=0, x_max=2, y_min=0, y_max=3), Bounds(x_min=9, x_max=10, y_min=0, y_max=1)]
    """
    apart: list[Bounds] = []
    for area in areas:
        while True:
            near = area.grown(MERGE_M)
            other = next((one for one in apart if _overlap(one, near)), None)
            if other is None:
                break
            apart.remove(other)
            area = Bounds(
                min(area.x_min, other.x_min),
                max(area.x_max, other.x_max),
                min(area.y_min, other.y_min),
                max(area.y_max, other.y_max),
            )
        apart.append(area)
    return sorted(apart)


def _overlap(one: Bounds, other: Bounds) -> bool:
    wide = one.x_min <= other.x_max and other.x_min <= one.x_max
    return wide and one.y_min <= other.y_max and other.y_min <= one.y_max
