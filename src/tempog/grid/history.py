"""What can be asked of a history, whether it is being mapped, was opened from disk, or is one period of it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from tempog.config import DEFAULT_GAP_S, MapConfig
from tempog.errors import ConfigError, EmptyWindowError, MomentError, TimeError
from tempog.grid.presented import Presented
from tempog.grid.segments import Runs, count_overlapping, join, latest_states
from tempog.scans.scan import scan_period_s
from tempog.sensing.grid_spec import Bounds, Extent
from tempog.sensing.tiles import FARTHEST_CELL, NO_CELL, TILE, TILE_CELLS, TileIndex
from tempog.times import MAX_NS, NS_PER_S, Moment, format_moment, parse_moment

if TYPE_CHECKING:
    from tempog.grid.area import Area

CellPiece = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]
"""Of intervals of one cell: first scans, last scans, values."""

OCCUPIED_ABOVE = 0.5  # P(occupied) from which on a cell's state is called occupied


class Snapshot(NamedTuple):
    """The map at one moment.

    Attributes
    ----------
    value : (n_rows, n_cols) float32
        P(occupied); NaN where unknown.
    age_s : (n_rows, n_cols) float32, seconds
        Since the cell was last seen; 0 within an interval, NaN where unknown.
    extent : Extent
        Where the arrays lie in the map frame.
    stamp_ns : int
    """

    value: NDArray[np.float32]
    age_s: NDArray[np.float32]
    extent: Extent
    stamp_ns: int


class Interval(NamedTuple):
    """One state of one cell: from when it was seen to when it was seen last, in ns, and P(occupied)."""

    start_ns: int
    stop_ns: int
    value: float


@dataclass(frozen=True)
class CellHistory(Sequence[Interval]):
    """Every state one cell has had, in time order: a sequence of `Interval`.

    Attributes
    ----------
    start_ns, stop_ns : (n,) int64
        When each interval was first and last seen; nanoseconds of the log's clock.
    value : (n,) float32
        P(occupied).
    gap_s : float, seconds
        Time without a look from which on the cell counts as unseen (thres_1 of Fig. 4).
    """

    start_ns: NDArray[np.int64]
    stop_ns: NDArray[np.int64]
    value: NDArray[np.float32]
    gap_s: float

    def __len__(self) -> int:
        return len(self.value)

    @overload
    def __getitem__(self, index: int) -> Interval: ...
    @overload
    def __getitem__(self, index: slice) -> list[Interval]: ...
    def __getitem__(self, index: int | slice) -> Interval | list[Interval]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        return Interval(int(self.start_ns[index]), int(self.stop_ns[index]), float(self.value[index]))

    @property
    def gaps(self) -> NDArray[np.int64]:
        """``(n_gaps, 2)`` nanoseconds: periods between intervals in which the cell was not seen."""
        periods = np.stack([self.stop_ns[:-1], self.start_ns[1:]], axis=-1)
        return periods[periods[:, 1] - periods[:, 0] > min(self.gap_s * NS_PER_S, MAX_NS)]

    def at(self, stamp_ns: int) -> float | None:
        """P(occupied) at a moment; None where nothing was observed (a null interval in the paper's Fig. 1)."""
        k = int(np.searchsorted(self.start_ns, stamp_ns, side="right")) - 1
        return float(self.value[k]) if k >= 0 and stamp_ns <= self.stop_ns[k] else None


class Changes(NamedTuple):
    """Cells whose state differs between two moments.

    Attributes
    ----------
    points_map : (n, 2) metres
        x and y of the cells' centres.
    before, after : (n,) float32
        P(occupied) at the two moments.
    """

    points_map: NDArray[np.float64]
    before: NDArray[np.float32]
    after: NDArray[np.float32]


class History(Presented, ABC):
    """A temporal occupancy grid to ask questions of.

    Attributes
    ----------
    config : MapConfig
    tiles : TileIndex
    """

    config: MapConfig
    tiles: TileIndex

    @property
    @abstractmethod
    def stamps_ns(self) -> NDArray[np.int64]:
        """``(n_scans,)`` stamp of each scan, ascending."""

    @property
    @abstractmethod
    def poses(self) -> NDArray[np.float64]:
        """``(n_scans, 3)`` pose of the laser at each scan, map frame: x, y in metres, theta in radians."""

    @abstractmethod
    def runs(self) -> Iterator[Runs]:
        """All intervals, in sets from oldest to newest; per cell, later sets hold later intervals."""

    def runs_of_cell(self, cell: int) -> list[CellPiece]:
        """First scans, last scans and values of one cell's intervals, in pieces in time order."""
        sets = list(self.runs_of_tiles(np.array([cell // TILE_CELLS], dtype=np.int32)))
        where = [runs.of_cell(cell) for runs in sets]
        return [(runs.first[at], runs.last[at], runs.value[at]) for runs, at in zip(sets, where, strict=True)]

    # A history on disk answers these from a part of it.

    def runs_within(self, first_scan: int, last_scan: int) -> Iterator[Runs]:
        """The intervals that the scans of a period saw, ordered as in `runs`; others may be among them.

        One that goes on after the period may end anywhere after it.
        """
        return self.runs()

    def latest_runs(self, last_scan: int) -> Iterator[Runs]:
        """Each cell's latest interval that began by a scan, ordered as in `runs`; others may be among them."""
        return self.runs()

    def runs_of_tiles(
        self, tiles: NDArray[np.int32], first_scan: int | None = None, last_scan: int | None = None
    ) -> Iterator[Runs]:
        """The intervals of the cells of some tiles, ordered as in `runs`; others may be among them.

        Numbers of tiles ascend. Of a period, by default all of it, from the one that was each cell's latest at its
        first scan to the one that was at its last; one that goes on after the period may end anywhere after it.
        """
        return self.runs()

    def all_runs(self) -> Runs:
        """All intervals in one sorted set."""
        return join(list(self.runs()))

    # The period: a window narrows it.

    @property
    def first_scan(self) -> int:
        """Number of the first scan of the period."""
        return 0

    @property
    def last_scan(self) -> int:
        """Number of the last scan of the period."""
        return len(self.stamps_ns) - 1

    @property
    def n_scans(self) -> int:
        """Scans in the period."""
        return self.last_scan - self.first_scan + 1

    @property
    def start_ns(self) -> int:
        """Stamp of the first scan of the whole history, from which ``"+120"`` counts."""
        self.require_scans()
        return int(self.stamps_ns[0])

    @property
    def duration_s(self) -> float:
        """Seconds between the first and the last scan of the period."""
        if self.n_scans == 0:
            return 0.0
        return float(self.stamps_ns[self.last_scan] - self.stamps_ns[self.first_scan]) / NS_PER_S

    @property
    def scan_period_s(self) -> float:
        """Median seconds between scans; NaN for fewer than two."""
        return scan_period_s(self.stamps_ns)

    @property
    def gap_s(self) -> float:
        """Seconds without a look from which on a cell counts as unseen (thres_1 of Fig. 4)."""
        return DEFAULT_GAP_S if self.config.grid.gap_s is None else self.config.grid.gap_s

    @property
    def extent(self) -> Extent:
        """Where the arrays ``[row, col]`` that queries and analyses return lie in the map frame."""
        return self.tiles.extent

    def parse_moment(self, moment: Moment) -> int:
        """A moment in nanoseconds; see `tempog.times.parse_moment` for the forms."""
        return parse_moment(moment, self.start_ns)

    def format_moment(self, stamp_ns: int) -> str:
        """A stamp for people."""
        return format_moment(stamp_ns, self.start_ns)

    # Questions.

    def at(self, t: Moment, hold: float | None = None) -> Snapshot:
        """The map at a moment.

        Parameters
        ----------
        t : float, str, datetime or numpy.datetime64
            Seconds as in the log, ``"+120"`` seconds from the start, or ISO 8601.
        hold : float, seconds, optional
            A cell not observed at `t` keeps its last known state for so long (``inf``: for ever).
            Default: it is unknown.

        Returns
        -------
        Snapshot
            ``value`` and ``age_s``, both (n_rows, n_cols), NaN where unknown.

        Raises
        ------
        TimeError
            `t` is not a moment, or the grid has seen nothing yet.
        ConfigError
            A negative `hold`.
        """
        stamp_ns = self.parse_moment(t)
        extent = self.extent
        value, age_s = self._states(stamp_ns, 0.0 if hold is None else hold, self.tiles.dense_places(), extent.n_cols)
        return Snapshot(value.reshape(extent.shape), age_s.reshape(extent.shape), extent, stamp_ns)

    def window(self, t0: Moment | None = None, t1: Moment | None = None) -> Window:
        """The history between two moments, both included; every analysis takes it in place of the grid.

        Intervals that reach over a border belong to the window (paper, section IV.D).

        Parameters
        ----------
        t0, t1 : float, str, datetime or numpy.datetime64, optional
            Default: the beginning and the end.

        Raises
        ------
        EmptyWindowError
            No scan falls into the period.
        MomentError
            `t0` or `t1` is no moment, or `t1` comes before `t0`.
        """
        stamps = self.stamps_ns
        self.require_scans()
        start = self.parse_moment(t0) if t0 is not None else int(stamps[self.first_scan])
        stop = self.parse_moment(t1) if t1 is not None else int(stamps[self.last_scan])
        if start > stop and t0 is not None and t1 is not None:
            raise MomentError(
                f"the period from {self.format_moment(start)} to {self.format_moment(stop)} ends before it begins;"
                " exchange the two"
            )
        since = max(self.first_scan, int(np.searchsorted(stamps, start, side="left")))
        until = min(self.last_scan, int(np.searchsorted(stamps, stop, side="right")) - 1)
        if since > until:
            covered = " to ".join(self.format_moment(int(stamps[k])) for k in (self.first_scan, self.last_scan))
            raise EmptyWindowError(
                f"no scan between {self.format_moment(start)} and {self.format_moment(stop)};"
                f" the scans run from {covered}"
            )
        return Window(self, since, until)

    def area(self, x_min: float, x_max: float, y_min: float, y_max: float) -> Area:
        """The history of one rectangle, which every analysis takes in place of the grid.

        What it costs to ask follows what the rectangle holds, not the whole map.

        Parameters
        ----------
        x_min, x_max, y_min, y_max : float, metres
            In the map frame. All tiles of 8 x 8 cells that the rectangle touches belong to the area.

        Raises
        ------
        ConfigError
            The rectangle is none.
        EmptyWindowError
            Nothing was seen in there.

        Examples
        --------
        >>> from tempog import build_grid, map_dynamics
        >>> from tempog.simulation import corridor, simulate
        >>> grid = build_grid(simulate(corridor(), duration_s=20.0).scans)
        >>> door = grid.area(6.0, 8.0, 2.0, 4.0)
        >>> map_dynamics(grid).shape, map_dynamics(door).shape
        ((168, 264), (48, 48))
        """
        from tempog.grid.area import Area

        bounds = Bounds(x_min, x_max, y_min, y_max)
        if not (all(math.isfinite(side) for side in bounds) and x_min <= x_max and y_min <= y_max):
            raise ConfigError(f"{bounds} is no rectangle; wanted finite metres, each minimum at most its maximum")
        return Area(self, bounds)

    def history(self, x: float, y: float) -> CellHistory:
        """Every state of the cell at a point (map frame, metres); empty where nothing was ever observed.

        Intervals that reach over the period's borders are given whole. ConfigError for NaN and infinity.
        """
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ConfigError(f"({x}, {y}) is not a place; wanted finite metres in the map frame")
        cell = NO_CELL
        if max(abs(x), abs(y)) < FARTHEST_CELL * self.tiles.spec.resolution_m:
            cell = self.tiles.cell_number(*self.tiles.spec.cell_of(x, y))
        pieces = self.runs_of_cell(cell) if cell != NO_CELL else []
        first = np.concatenate([piece[0] for piece in pieces] or [np.empty(0, np.int32)])
        last = np.concatenate([piece[1] for piece in pieces] or [np.empty(0, np.int32)])
        value = np.concatenate([piece[2] for piece in pieces] or [np.empty(0, np.float32)])
        inside = (last >= self.first_scan) & (first <= self.last_scan)
        stamps = self.stamps_ns
        return CellHistory(stamps[first[inside]], stamps[last[inside]], value[inside], self.gap_s)

    def changes(self, t0: Moment, t1: Moment, hold: float = math.inf) -> Changes:
        """Cells that were occupied at one moment and free at the other.

        Parameters
        ----------
        t0, t1 : moments, see `at`
        hold : float, seconds
            How old the last look may be at each moment; by default the last known state counts however old.
        """
        before, _ = self._states(self.parse_moment(t0), hold)
        after, _ = self._states(self.parse_moment(t1), hold)
        known = ~np.isnan(before) & ~np.isnan(after)
        differs = known & ((before > OCCUPIED_ABOVE) != (after > OCCUPIED_ABOVE))
        cells = np.flatnonzero(differs).astype(np.int32)
        return Changes(self.tiles.spec.centres(*self.tiles.rows_cols(cells)), before[cells], after[cells])

    @property
    def n_intervals(self) -> int:
        """Intervals that were seen within the period."""
        return sum(
            int(count_overlapping(runs.first, runs.last, self.first_scan, self.last_scan)) for runs in self.runs()
        )

    @property
    def n_cells(self) -> int:
        """Cells observed at least once within the period."""
        if self.n_scans == 0:
            return 0
        value, _ = self._states(int(self.stamps_ns[self.last_scan]), math.inf)
        return int(np.count_nonzero(~np.isnan(value)))

    def _states(
        self, stamp_ns: int, hold_s: float, tile_places: NDArray[np.int64] | None = None, n_cols: int = TILE
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Value and age in seconds of every cell, by its number unless places are given; NaN where unknown."""
        if not hold_s >= 0:
            raise ConfigError(f"hold = {hold_s!r} is not a duration; wanted seconds, 0 or more")
        self.require_scans()
        stamps = self.stamps_ns
        until = min(self.last_scan, int(np.searchsorted(stamps, stamp_ns, side="right")) - 1)
        size = self.extent.n_rows * self.extent.n_cols
        if tile_places is None:
            tile_places, size = np.arange(self.tiles.n_tiles) * TILE_CELLS, self.tiles.n_cells
        value, age_s = (np.full(size, np.nan, dtype=np.float32) for _ in range(2))
        if until >= self.first_scan:
            hold_ns = min(hold_s * NS_PER_S, MAX_NS)
            oldest = int(np.searchsorted(stamps, max(stamp_ns - round(hold_ns), -MAX_NS), side="left"))
            # An interval that goes on after the moment counts as seen just then.
            ages_s = (np.maximum(stamp_ns - stamps, 0) / NS_PER_S).astype(np.float32)
            for runs in self.latest_runs(until):
                period = (self.first_scan, self.last_scan, until, oldest)
                latest_states(*runs, *period, ages_s, tile_places, n_cols, value, age_s)
        return value, age_s

    def require_scans(self) -> None:
        """TimeError if there are none."""
        if len(self.stamps_ns) == 0:
            raise TimeError("the grid holds no scans yet, so it has no times; integrate a scan first")


class Window(History):
    """One period of a history; made by `History.window`."""

    def __init__(self, whole: History, first_scan: int, last_scan: int) -> None:
        self._whole = whole
        self._first_scan = first_scan
        self._last_scan = last_scan
        self.config = whole.config
        self.tiles = whole.tiles

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps of all scans, those outside the period too."""
        return self._whole.stamps_ns

    @property
    def poses(self) -> NDArray[np.float64]:
        """Poses at all scans, those outside the period too."""
        return self._whole.poses

    def runs(self) -> Iterator[Runs]:
        """The intervals seen within the period, and others."""
        return self._whole.runs_within(self._first_scan, self._last_scan)

    def runs_within(self, first_scan: int, last_scan: int) -> Iterator[Runs]:
        """The intervals that the scans of a period saw, and others."""
        return self._whole.runs_within(first_scan, last_scan)

    def latest_runs(self, last_scan: int) -> Iterator[Runs]:
        """Each cell's latest interval that began by a scan, and others."""
        return self._whole.latest_runs(last_scan)

    def runs_of_tiles(
        self, tiles: NDArray[np.int32], first_scan: int | None = None, last_scan: int | None = None
    ) -> Iterator[Runs]:
        """The intervals of the cells of some tiles, by default within the period, and others."""
        first_scan = self._first_scan if first_scan is None else first_scan
        last_scan = self._last_scan if last_scan is None else last_scan
        return self._whole.runs_of_tiles(tiles, first_scan, last_scan)

    def runs_of_cell(self, cell: int) -> list[CellPiece]:
        """All intervals of one cell, those outside the period too."""
        return self._whole.runs_of_cell(cell)

    @property
    def first_scan(self) -> int:
        """Number of the first scan of the period."""
        return self._first_scan

    @property
    def last_scan(self) -> int:
        """Number of the last scan of the period."""
        return self._last_scan
