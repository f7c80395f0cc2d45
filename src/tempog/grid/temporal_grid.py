"""The temporal occupancy grid that is being mapped (paper, section III.B)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tempog.config import MapConfig, check_gap
from tempog.grid.history import CellPiece, History
from tempog.grid.intervals import NEVER
from tempog.grid.mapper import SEALED_BUFFER, Mapper
from tempog.grid.segments import Runs, SegmentStack
from tempog.scans.scan import Scan, scan_period_s


class TemporalGrid(History):
    """A grid with one time index per cell, built scan by scan.

    The area need not be known beforehand: memory follows what was seen. Not for use by several threads
    at once.

    Parameters
    ----------
    config : MapConfig, optional
    scan_period_s : float, seconds, optional
        Typical time between scans, where it is known; the gap threshold is then checked against it at once,
        and ten of them by default. Else it is checked against the first scans.

    Raises
    ------
    ConfigError
        A gap threshold shorter than the scan period.

    Attributes
    ----------
    surfaces : SurfaceMemory
        Where inside each cell the hits fell.
    poses : (n_scans, 3) float64
        x, y, theta of the laser in the map frame at each scan; metres and radians.

    Examples
    --------
    A wall 2 m ahead, then gone:

    >>> import numpy as np
    >>> from tempog import Scan, TemporalGrid
    >>> grid = TemporalGrid()
    >>> for t, distance in [(0.0, 2.0), (0.5, 2.0), (1.0, 3.0), (1.5, 3.0)]:
    ...     grid.integrate(Scan(t, pose=(0.02, 0.02, 0.0), angles=[0.0], ranges=[distance]))
    >>> [(i.start_ns / 1e9, i.stop_ns / 1e9, round(i.value, 2)) for i in grid.history(x=2.02, y=0.02)]
    [(0.0, 0.5, 0.9), (1.0, 1.5, 0.1)]
    """

    def __init__(self, config: MapConfig | None = None, *, scan_period_s: float = math.nan) -> None:
        self._mapper = Mapper(config, scan_period_s=scan_period_s)
        self.config = self._mapper.config
        self.tiles, self.surfaces = self._mapper.tiles, self._mapper.surfaces
        self._segments = SegmentStack()
        self._open_runs: Runs | None = None  # as asked for since the last scan

    def integrate(self, scan: Scan) -> None:
        """Add one scan to the history (Fig. 4).

        Raises
        ------
        ScanError
            The scan is earlier than the one before.
        ExtentError
            It lies so far off that the map would exceed `GridConfig.max_cells`.
        ConfigError
            The gap threshold turns out to be shorter than the time between scans.
        """
        self._mapper.integrate(scan)
        self._open_runs = None
        if self._mapper.n_sealed >= SEALED_BUFFER:
            self._sort_sealed()

    def integrate_many(self, scans: Iterable[Scan]) -> None:
        """Add scans in order; as `integrate` one by one, but a first sequence's scan period is judged beforehand."""
        if isinstance(scans, Sequence) and len(scans) > 1 and self.n_scans == 0 and not self._mapper.gap_judged:
            check_gap(self.gap_s, scan_period_s([scan.stamp_ns for scan in scans]))
            self._mapper.gap_judged = True
        for scan in scans:
            self.integrate(scan)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """``(n_scans,)`` stamp of each scan, ascending."""
        return self._mapper.stamps_ns

    @property
    def poses(self) -> NDArray[np.float64]:
        """``(n_scans, 3)`` pose of the laser at each scan, map frame: x, y in metres, theta in radians."""
        return self._mapper.poses

    @property
    def memory_bytes(self) -> int:
        """Bytes held by the map: cells, intervals, hit points and scans, with what is allocated for growth.

        Not counted are the buffers that working on one scan takes, and answers kept until the next scan.
        """
        return self._mapper.memory_bytes + self._segments.nbytes

    def runs(self) -> Iterator[Runs]:
        """All intervals, in sets from oldest to newest; the last set holds the open ones."""
        self._sort_sealed()
        yield from self._segments.settled()
        if self._open_runs is None:
            self._open_runs = self._mapper.open_runs()
        yield self._open_runs

    def runs_of_cell(self, cell: int) -> list[CellPiece]:
        """First scans, last scans and values of one cell's intervals, in pieces in time order."""
        self._sort_sealed()
        pieces = []
        for runs in self._segments.settled():
            where = runs.of_cell(cell)
            pieces.append((runs.first[where], runs.last[where], runs.value[where]))
        mapper = self._mapper
        if mapper.last[cell] != NEVER:
            where = slice(cell, cell + 1)
            pieces.append((mapper.first[where], mapper.last[where], mapper.value[where]))
        return pieces

    def _sort_sealed(self) -> None:
        """Move finished intervals into a sorted segment."""
        runs = self._mapper.take_sealed()
        if runs is not None:
            self._segments.push(runs)
