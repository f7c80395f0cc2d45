"""Scans to intervals: the open interval of every cell, and those that ended (paper, Fig. 4)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog._arrays import grown
from tempog.config import DEFAULT_GAP, DEFAULT_GAP_S, MapConfig, check_gap, parse_gap
from tempog.errors import ConfigError, ScanError
from tempog.grid.intervals import NEVER, extend_or_seal, sort_by_cell
from tempog.grid.segments import Runs
from tempog.scans.scan import Scan, scan_period_s
from tempog.sensing.evidence import Sensor
from tempog.sensing.grid_spec import GridSpec
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import TileIndex
from tempog.times import MAX_NS, NS_PER_S

SEALED_BUFFER = 2**19  # intervals; 8 MB are sorted into a segment at a time, in some milliseconds
SCANS_TO_JUDGE_GAP = 10  # enough steps for a median


class MapState(NamedTuple):
    """What mapping goes on from.

    Attributes
    ----------
    tiles : TileIndex
    surfaces : SurfaceMemory
    open_runs : Runs
        The open interval of every cell that was ever seen.
    n_scans : int
        How many scans were integrated.
    session_start : int
        First scan of the session that goes on; `n_scans` if a new one begins.
    stamps_ns, poses : (n,), (n, 3)
        The latest scans, those within the gap threshold at least; none where a new session begins.
    """

    tiles: TileIndex
    surfaces: SurfaceMemory
    open_runs: Runs
    n_scans: int
    session_start: int
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]


class Mapper:
    """Integrates scans; answers no questions. `TemporalGrid` and `LiveMap` keep what it finishes.

    Parameters
    ----------
    config : MapConfig, optional
    scan_period_s : float, seconds, optional
        See `TemporalGrid`.
    state : MapState, optional
        Go on from there. Scans are numbered on; no interval reaches over the begin of a session.

    Attributes
    ----------
    config : MapConfig
        With the gap threshold that is used.
    tiles : TileIndex
    surfaces : SurfaceMemory
    n_scans : int
        Scans integrated, those before `state` too.
    first_kept : int
        Number of the scan that `stamps_ns` and `poses` begin with.
    n_sealed : int
        Finished intervals that were not taken yet.
    """

    def __init__(
        self, config: MapConfig | None = None, *, scan_period_s: float = math.nan, state: MapState | None = None
    ) -> None:
        config = config or MapConfig()
        if not isinstance(config, MapConfig):
            raise ConfigError(f"config is a {type(config).__name__}; wanted MapConfig(sensing=..., grid=...)")
        gap_s = config.grid.gap_s
        if gap_s is None:
            gap_s = parse_gap(DEFAULT_GAP, scan_period_s) if scan_period_s > 0 else DEFAULT_GAP_S
        check_gap(gap_s, scan_period_s)
        self.config = replace(config, grid=replace(config.grid, gap_s=gap_s))
        self.gap_s = gap_s
        self.gap_judged = scan_period_s > 0
        self._gap_ns = round(min(gap_s * NS_PER_S, MAX_NS))
        self.sensor = Sensor(self.config)
        self._tolerance = np.float32(self.config.grid.tolerance)
        self.tiles = TileIndex(GridSpec(self.config.grid.resolution_m), self.config.grid.max_cells)
        self.surfaces = SurfaceMemory()
        self.n_scans = self.first_kept = self._session_start = 0
        self._stamps_ns = np.empty(0, dtype=np.int64)
        self._poses = np.empty((0, 3))
        # The open interval of every cell.
        self.first = np.empty(0, dtype=np.int32)
        self.last = np.empty(0, dtype=np.int32)
        self.value = np.empty(0, dtype=np.float32)
        # Finished intervals in the order they ended.
        self._sealed_cell = np.empty(0, dtype=np.int32)
        self._sealed_first = np.empty(0, dtype=np.int32)
        self._sealed_last = np.empty(0, dtype=np.int32)
        self._sealed_value = np.empty(0, dtype=np.float32)
        self.n_sealed = 0
        if state is not None:
            self._go_on(state)

    def _go_on(self, state: MapState) -> None:
        self.tiles, self.surfaces = state.tiles, state.surfaces
        self.n_scans, self._session_start = state.n_scans, state.session_start
        self.first_kept = state.n_scans - len(state.stamps_ns)
        self._stamps_ns, self._poses = state.stamps_ns, state.poses
        self._reserve(0)
        cells = state.open_runs.cells
        self.first[cells], self.last[cells] = state.open_runs.first, state.open_runs.last
        self.value[cells] = state.open_runs.value

    def integrate(self, scan: Scan) -> None:
        """Add one scan (Fig. 4); see `TemporalGrid.integrate`."""
        stamps_ns = self.stamps_ns
        if len(stamps_ns) and scan.stamp_ns < stamps_ns[-1]:
            earlier_s = (int(stamps_ns[-1]) - scan.stamp_ns) / NS_PER_S
            raise ScanError(
                f"{scan.label or 'the scan'} at {scan.t:.3f} s is {earlier_s:.3f} s earlier than the one before;"
                " a history is written in time order: sort the scans first"
            )
        if not self.gap_judged and self.n_scans - self._session_start >= SCANS_TO_JUDGE_GAP:
            check_gap(self.gap_s, scan_period_s(stamps_ns))
            self.gap_judged = True
        statements = self.sensor.sense(scan, self.tiles, self.surfaces)
        self._append_scan(scan)
        self._reserve(len(statements.cells))
        recent = int(np.searchsorted(self.stamps_ns, max(scan.stamp_ns - self._gap_ns, -MAX_NS), side="left"))
        self.n_sealed = extend_or_seal(
            *statements,
            self.n_scans - 1,
            max(self.first_kept + recent, self._session_start),
            self._tolerance,
            self.first,
            self.last,
            self.value,
            self._sealed_cell,
            self._sealed_first,
            self._sealed_last,
            self._sealed_value,
            self.n_sealed,
        )

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps of the scans from `first_kept` on, ascending."""
        return self._stamps_ns[: self.n_scans - self.first_kept]

    @property
    def poses(self) -> NDArray[np.float64]:
        """Poses of the laser at the scans from `first_kept` on, (n, 3)."""
        return self._poses[: self.n_scans - self.first_kept]

    @property
    def memory_bytes(self) -> int:
        """Bytes held, with what is allocated for growth; not the buffers that working on one scan takes."""
        cells = (self.first, self.last, self.value)
        sealed = (self._sealed_cell, self._sealed_first, self._sealed_last, self._sealed_value)
        arrays = (*cells, *sealed, self._stamps_ns, self._poses)
        return sum(array.nbytes for array in arrays) + self.tiles.nbytes + self.surfaces.nbytes

    def open_runs(self, since: int = 0) -> Runs:
        """The open intervals of the cells that were seen by scan `since` or later."""
        used = slice(0, self.tiles.n_cells)
        cells = np.flatnonzero(self.last[used] >= since).astype(np.int32)
        offsets = np.arange(len(cells) + 1, dtype=np.int64)
        return Runs(cells, offsets, self.first[cells], self.last[cells], self.value[cells])

    def take_sealed(self) -> Runs | None:
        """The finished intervals, sorted by cell; None if there are none. They are no longer here afterwards."""
        if not self.n_sealed:
            return None
        sealed = (self._sealed_cell, self._sealed_first, self._sealed_last, self._sealed_value)
        runs = Runs(*sort_by_cell(self.tiles.n_cells, self.n_sealed, *sealed))
        self.n_sealed = 0
        return runs

    def forget_scans(self, before: int) -> None:
        """Let go of the stamps and poses of scans before a number, as far as mapping does not need them."""
        stamps_ns = self.stamps_ns
        if not len(stamps_ns):
            return
        kept = int(np.searchsorted(stamps_ns, max(int(stamps_ns[-1]) - self._gap_ns, -MAX_NS), side="left"))
        kept = max(0, min(kept, before - self.first_kept, len(stamps_ns) - SCANS_TO_JUDGE_GAP))
        self._stamps_ns, self._poses = stamps_ns[kept:].copy(), self.poses[kept:].copy()
        self.first_kept += kept

    def _append_scan(self, scan: Scan) -> None:
        n = self.n_scans - self.first_kept
        if n == len(self._stamps_ns):
            self._stamps_ns = grown(self._stamps_ns, 2 * n + 64)
            self._poses = grown(self._poses, 2 * n + 64)
        self._stamps_ns[n] = scan.stamp_ns
        self._poses[n] = scan.x, scan.y, scan.theta
        self.n_scans += 1

    def _reserve(self, n_statements: int) -> None:
        n_cells = self.tiles.n_cells
        if n_cells > len(self.last):
            n_cells += n_cells // 4
            self.first = grown(self.first, n_cells)
            self.last = grown(self.last, n_cells, fill=NEVER)
            self.value = grown(self.value, n_cells)
        needed = self.n_sealed + n_statements
        if needed > len(self._sealed_cell):
            capacity = max(needed, min(2 * needed, SEALED_BUFFER))
            self._sealed_cell = grown(self._sealed_cell, capacity)
            self._sealed_first = grown(self._sealed_first, capacity)
            self._sealed_last = grown(self._sealed_last, capacity)
            self._sealed_value = grown(self._sealed_value, capacity)
