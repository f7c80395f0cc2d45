"""The temporal occupancy grid that is being mapped (paper, section III.B)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tempog._arrays import grown
from tempog.config import DEFAULT_GAP, DEFAULT_GAP_S, MapConfig, check_gap, parse_gap
from tempog.errors import ConfigError, ScanError
from tempog.grid.history import History
from tempog.grid.intervals import NEVER, extend_or_seal, sort_by_cell
from tempog.grid.segments import Runs, SegmentStack
from tempog.scans.scan import Scan, scan_period_s
from tempog.sensing.evidence import Sensor
from tempog.sensing.grid_spec import GridSpec
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import TileIndex
from tempog.times import MAX_NS, NS_PER_S

SEALED_BUFFER = 2**19  # intervals; 8 MB are sorted into a segment at a time, in some milliseconds
SCANS_TO_JUDGE_GAP = 10  # enough steps for a median


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
        config = config or MapConfig()
        if not isinstance(config, MapConfig):
            raise ConfigError(f"config is a {type(config).__name__}; wanted MapConfig(sensing=..., grid=...)")
        gap_s = config.grid.gap_s
        if gap_s is None:
            gap_s = parse_gap(DEFAULT_GAP, scan_period_s) if scan_period_s > 0 else DEFAULT_GAP_S
        check_gap(gap_s, scan_period_s)
        self.config = replace(config, grid=replace(config.grid, gap_s=gap_s))
        self._gap_judged = scan_period_s > 0
        self._gap_ns = round(min(gap_s * NS_PER_S, MAX_NS))
        self.tiles = TileIndex(GridSpec(self.config.grid.resolution_m), self.config.grid.max_cells)
        self.surfaces = SurfaceMemory()
        self._sensor = Sensor(self.config)
        self._tolerance = np.float32(self.config.grid.tolerance)
        self._stamps_ns = np.empty(0, dtype=np.int64)
        self._poses = np.empty((0, 3))
        self._n_scans = 0
        # The open interval of every cell.
        self._first = np.empty(0, dtype=np.int32)
        self._last = np.empty(0, dtype=np.int32)
        self._value = np.empty(0, dtype=np.float32)
        # Finished intervals: first in the order they ended, then sorted.
        self._sealed_cell = np.empty(0, dtype=np.int32)
        self._sealed_first = np.empty(0, dtype=np.int32)
        self._sealed_last = np.empty(0, dtype=np.int32)
        self._sealed_value = np.empty(0, dtype=np.float32)
        self._n_sealed = 0
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
        if self._n_scans and scan.stamp_ns < self._stamps_ns[self._n_scans - 1]:
            earlier_s = (int(self._stamps_ns[self._n_scans - 1]) - scan.stamp_ns) / NS_PER_S
            raise ScanError(
                f"{scan.label or 'the scan'} at {scan.t:.3f} s is {earlier_s:.3f} s earlier than the one before;"
                " a history is written in time order: sort the scans first"
            )
        if self._n_scans == SCANS_TO_JUDGE_GAP and not self._gap_judged:
            check_gap(self.gap_s, scan_period_s(self.stamps_ns))
            self._gap_judged = True
        statements = self._sensor.sense(scan, self.tiles, self.surfaces)
        self._open_runs = None
        self._append_scan(scan)
        self._reserve(len(statements.cells))
        number = self._n_scans - 1
        oldest = int(np.searchsorted(self.stamps_ns, max(scan.stamp_ns - self._gap_ns, -MAX_NS), side="left"))
        self._n_sealed = extend_or_seal(
            *statements,
            number,
            oldest,
            self._tolerance,
            self._first,
            self._last,
            self._value,
            self._sealed_cell,
            self._sealed_first,
            self._sealed_last,
            self._sealed_value,
            self._n_sealed,
        )
        if self._n_sealed >= SEALED_BUFFER:
            self._sort_sealed()

    def integrate_many(self, scans: Iterable[Scan]) -> None:
        """Add scans in order; as `integrate` one by one, but a first sequence's scan period is judged beforehand."""
        if isinstance(scans, Sequence) and len(scans) > 1 and self._n_scans == 0 and not self._gap_judged:
            check_gap(self.gap_s, scan_period_s([scan.stamp_ns for scan in scans]))
            self._gap_judged = True
        for scan in scans:
            self.integrate(scan)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """``(n_scans,)`` stamp of each scan, ascending."""
        return self._stamps_ns[: self._n_scans]

    @property
    def poses(self) -> NDArray[np.float64]:
        """``(n_scans, 3)`` pose of the laser at each scan, map frame: x, y in metres, theta in radians."""
        return self._poses[: self._n_scans]

    @property
    def memory_bytes(self) -> int:
        """Bytes held by the map: cells, intervals, hit points and scans, with what is allocated for growth.

        Not counted are the buffers that working on one scan takes, and answers kept until the next scan.
        """
        cells = self._first.nbytes + self._last.nbytes + self._value.nbytes
        sealed = (
            self._sealed_cell.nbytes
            + self._sealed_first.nbytes
            + self._sealed_last.nbytes
            + self._sealed_value.nbytes
        )
        scans = self._stamps_ns.nbytes + self._poses.nbytes
        return cells + sealed + scans + self._segments.nbytes + self.tiles.nbytes + self.surfaces.nbytes

    def runs(self) -> Iterator[Runs]:
        """All intervals, in sets from oldest to newest; the last set holds the open ones."""
        self._sort_sealed()
        yield from self._segments.settled()
        if self._open_runs is None:
            used = slice(0, self.tiles.n_cells)
            cells = np.flatnonzero(self._last[used] != NEVER).astype(np.int32)
            offsets = np.arange(len(cells) + 1, dtype=np.int64)
            self._open_runs = Runs(cells, offsets, self._first[cells], self._last[cells], self._value[cells])
        yield self._open_runs

    def runs_of_cell(self, cell: int) -> list[tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]]:
        """First scans, last scans and values of one cell's intervals, in pieces in time order."""
        self._sort_sealed()
        pieces = []
        for runs in self._segments.settled():
            where = runs.of_cell(cell)
            pieces.append((runs.first[where], runs.last[where], runs.value[where]))
        if self._last[cell] != NEVER:
            where = slice(cell, cell + 1)
            pieces.append((self._first[where], self._last[where], self._value[where]))
        return pieces

    def _append_scan(self, scan: Scan) -> None:
        if self._n_scans == len(self._stamps_ns):
            self._stamps_ns = grown(self._stamps_ns, 2 * self._n_scans + 64)
            self._poses = grown(self._poses, 2 * self._n_scans + 64)
        self._stamps_ns[self._n_scans] = scan.stamp_ns
        self._poses[self._n_scans] = scan.x, scan.y, scan.theta
        self._n_scans += 1

    def _reserve(self, n_statements: int) -> None:
        n_cells = self.tiles.n_cells
        if n_cells > len(self._last):
            n_cells += n_cells // 4
            self._first = grown(self._first, n_cells)
            self._last = grown(self._last, n_cells, fill=NEVER)
            self._value = grown(self._value, n_cells)
        needed = self._n_sealed + n_statements
        if needed > len(self._sealed_cell):
            capacity = max(needed, min(2 * needed, SEALED_BUFFER))
            self._sealed_cell = grown(self._sealed_cell, capacity)
            self._sealed_first = grown(self._sealed_first, capacity)
            self._sealed_last = grown(self._sealed_last, capacity)
            self._sealed_value = grown(self._sealed_value, capacity)

    def _sort_sealed(self) -> None:
        """Move finished intervals into a sorted segment."""
        if self._n_sealed:
            sorted_runs = sort_by_cell(
                self.tiles.n_cells,
                self._n_sealed,
                self._sealed_cell,
                self._sealed_first,
                self._sealed_last,
                self._sealed_value,
            )
            self._segments.push(Runs(*sorted_runs))
            self._n_sealed = 0
