"""One rectangle of a history, as a history of its own: questions about it cost what it holds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tempog.errors import EmptyWindowError
from tempog.grid.history import CellPiece, History
from tempog.grid.segments import Runs
from tempog.sensing.grid_spec import Bounds
from tempog.sensing.tiles import TILE, TILE_BITS, TILE_CELLS, TileIndex


class Area(History):
    """The tiles of a history that a rectangle touches; made by `History.area`.

    Tiles that are claimed later are not in it. Numbers of cells are its own.
    """

    def __init__(self, whole: History, bounds: Bounds) -> None:
        tiles = whole.tiles
        side_m = TILE * tiles.spec.resolution_m
        used = slice(0, tiles.n_tiles)
        rows, cols = tiles.tile_rows[used], tiles.tile_cols[used]
        inside = (rows * side_m <= bounds.y_max) & ((rows + 1) * side_m > bounds.y_min)
        inside &= (cols * side_m <= bounds.x_max) & ((cols + 1) * side_m > bounds.x_min)
        if not inside.any():
            x_min, x_max, y_min, y_max = whole.extent.bounds
            raise EmptyWindowError(
                f"nothing was seen within {bounds}; the map covers {Bounds(x_min, x_max, y_min, y_max)}"
            )
        self._whole = whole
        self._kept = np.flatnonzero(inside).astype(np.int32)  # tile numbers of the whole
        self.config = whole.config
        self.tiles = TileIndex.from_tiles(tiles.spec, tiles.max_cells, rows[inside], cols[inside])

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps of all scans, those that saw nothing of the area too."""
        return self._whole.stamps_ns

    @property
    def poses(self) -> NDArray[np.float64]:
        """Poses at all scans, those that saw nothing of the area too."""
        return self._whole.poses

    @property
    def first_scan(self) -> int:
        """Number of the first scan of the period."""
        return self._whole.first_scan

    @property
    def last_scan(self) -> int:
        """Number of the last scan of the period."""
        return self._whole.last_scan

    def runs(self) -> Iterator[Runs]:
        """The intervals of the area's cells, in sets from oldest to newest."""
        for runs in self._whole.runs_of_cells(
            int(self._kept[0]) * TILE_CELLS, (int(self._kept[-1]) + 1) * TILE_CELLS
        ):
            # A tile's cells follow each other, and so do their intervals.
            first = np.searchsorted(runs.cells, self._kept * TILE_CELLS)
            end = np.searchsorted(runs.cells, (self._kept + 1) * TILE_CELLS)
            which = _ranges(first, end)
            moved = np.repeat((np.arange(len(self._kept), dtype=np.int32) - self._kept) * TILE_CELLS, end - first)
            lengths = runs.offsets[which + 1] - runs.offsets[which]
            offsets = np.concatenate([[0], np.cumsum(lengths)])
            where = _ranges(runs.offsets[first], runs.offsets[end])
            yield Runs(runs.cells[which] + moved, offsets, runs.first[where], runs.last[where], runs.value[where])

    def runs_of_cell(self, cell: int) -> list[CellPiece]:
        """First scans, last scans and values of one cell's intervals, in pieces in time order."""
        within = cell % TILE_CELLS
        return self._whole.runs_of_cell(int(self._kept[cell >> 2 * TILE_BITS]) * TILE_CELLS + within)


def _ranges(first: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.int64]:
    """All numbers from each first to before each end, one range after the other."""
    lengths = end - first
    before = np.cumsum(lengths) - lengths
    return np.asarray(np.arange(int(lengths.sum())) + np.repeat(first - before, lengths))
