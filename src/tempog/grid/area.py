"""One rectangle of a history, as a history of its own: questions about it cost what it holds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tempog.errors import EmptyWindowError
from tempog.grid.history import CellPiece, History
from tempog.grid.segments import Runs, of_tiles
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
        return self.runs_of_tiles(self._all_tiles)

    def runs_within(self, first_scan: int, last_scan: int) -> Iterator[Runs]:
        """The intervals that the scans of a period saw, and others."""
        return self.runs_of_tiles(self._all_tiles, first_scan, last_scan)

    def latest_runs(self, last_scan: int) -> Iterator[Runs]:
        """Each cell's latest interval that began by a scan, and others."""
        return self.runs_of_tiles(self._all_tiles, last_scan, last_scan)

    def runs_of_tiles(
        self, tiles: NDArray[np.int32], first_scan: int | None = None, last_scan: int | None = None
    ) -> Iterator[Runs]:
        """The intervals of the cells of some of its tiles, of a period or all, and others."""
        of_whole = self._kept[tiles]
        for runs in self._whole.runs_of_tiles(of_whole, first_scan, last_scan):
            found = of_tiles(runs, of_whole)
            here = tiles[np.searchsorted(of_whole, found.cells >> 2 * TILE_BITS)]
            yield found._replace(cells=here * TILE_CELLS + (found.cells & (TILE_CELLS - 1)))

    @property
    def _all_tiles(self) -> NDArray[np.int32]:
        return np.arange(self.tiles.n_tiles, dtype=np.int32)

    def runs_of_cell(self, cell: int) -> list[CellPiece]:
        """First scans, last scans and values of one cell's intervals, in pieces in time order."""
        within = cell % TILE_CELLS
        return self._whole.runs_of_cell(int(self._kept[cell >> 2 * TILE_BITS]) * TILE_CELLS + within)
