"""A history that is answered by another one."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tempog.grid.history import CellPiece, History, Window
from tempog.grid.segments import Runs
from tempog.sensing.tiles import TileIndex
from tempog.times import Moment

if TYPE_CHECKING:
    from tempog.grid.area import Area


class Delegate(History):
    """Answers what the history `_whole` answers, which may be another one from question to question."""

    @property
    @abstractmethod
    def _whole(self) -> History: ...

    @property
    def tiles(self) -> TileIndex:  # type: ignore[override]
        """Which tile holds which cells."""
        return self._whole.tiles

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """``(n_scans,)`` stamp of each scan, ascending."""
        return self._whole.stamps_ns

    @property
    def poses(self) -> NDArray[np.float64]:
        """``(n_scans, 3)`` pose of the laser at each scan, map frame: x, y in metres, theta in radians."""
        return self._whole.poses

    @property
    def first_scan(self) -> int:
        """Number of the first scan of the period."""
        return self._whole.first_scan

    @property
    def last_scan(self) -> int:
        """Number of the last scan of the period."""
        return self._whole.last_scan

    @property
    def n_scans(self) -> int:
        """Scans in the period."""
        return self._whole.n_scans

    @property
    def n_intervals(self) -> int:
        """Intervals that were seen within the period."""
        return self._whole.n_intervals

    @property
    def n_cells(self) -> int:
        """Cells observed at least once within the period."""
        return self._whole.n_cells

    def runs(self) -> Iterator[Runs]:
        """All intervals, in sets from oldest to newest."""
        return self._whole.runs()

    def runs_within(self, first_scan: int, last_scan: int) -> Iterator[Runs]:
        """The intervals that the scans of a period saw, and others."""
        return self._whole.runs_within(first_scan, last_scan)

    def latest_runs(self, last_scan: int) -> Iterator[Runs]:
        """Each cell's latest interval that began by a scan, and others."""
        return self._whole.latest_runs(last_scan)

    def runs_of_tiles(
        self, tiles: NDArray[np.int32], first_scan: int | None = None, last_scan: int | None = None
    ) -> Iterator[Runs]:
        """The intervals of the cells of some tiles, of a period or all, and others."""
        return self._whole.runs_of_tiles(tiles, first_scan, last_scan)

    def runs_of_cell(self, cell: int) -> list[CellPiece]:
        """First scans, last scans and values of one cell's intervals, in pieces in time order."""
        return self._whole.runs_of_cell(cell)

    # What is held on to goes on with the history it was made of: another one may number cells and scans otherwise.

    def window(self, t0: Moment | None = None, t1: Moment | None = None) -> Window:
        """The history between two moments; see `History.window`."""
        return self._whole.window(t0, t1)

    def area(self, x_min: float, x_max: float, y_min: float, y_max: float) -> Area:
        """The history of one rectangle; see `History.area`."""
        return self._whole.area(x_min, x_max, y_min, y_max)
