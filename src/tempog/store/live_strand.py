"""A strand that is being mapped: segments on disk, what is on its way there, and the mapper's own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.grid.history import History
from tempog.grid.intervals import NEVER
from tempog.grid.mapper import Mapper
from tempog.grid.segments import Runs, join
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import TileIndex
from tempog.store.strand import Strand


class Pending(NamedTuple):
    """Intervals that ended by some scan, and are not known to be on disk."""

    end_scan: int
    sealed: Runs


class LiveStrand(History):
    """Answers from `disk` what is there, and the rest from memory.

    Parameters
    ----------
    disk : Strand
    mapper : Mapper
        Numbers its scans as the strand does.
    """

    def __init__(self, disk: Strand, mapper: Mapper) -> None:
        self.disk = disk
        self.mapper = mapper
        self.config = mapper.config
        self.pending: list[Pending] = []
        self._fresh: list[Runs] = []

    @property
    def base(self) -> int:
        """Number on disk of the strand's first scan."""
        return self.disk.base

    @property
    def tiles(self) -> TileIndex:  # type: ignore[override]
        """Which tile holds which cells."""
        return self.mapper.tiles

    @property
    def surfaces(self) -> SurfaceMemory:
        """Where inside each cell the hits fell."""
        return self.mapper.surfaces

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """``(n_scans,)`` stamp of each scan, ascending."""
        return np.concatenate([self.disk.stamps_ns, self.mapper.stamps_ns[self._on_disk :]])

    @property
    def poses(self) -> NDArray[np.float64]:
        """``(n_scans, 3)`` pose of the laser at each scan, map frame: x, y in metres, theta in radians."""
        return np.concatenate([self.disk.poses, self.mapper.poses[self._on_disk :]])

    @property
    def n_scans(self) -> int:
        """Number of scans."""
        return self.mapper.n_scans - self.disk.base

    @property
    def last_scan(self) -> int:
        """Number of the last scan."""
        return self.n_scans - 1

    def runs(self) -> Iterator[Runs]:
        """All intervals, from oldest to newest."""
        yield from self.disk.sealed_runs()
        yield from self._tail()

    def runs_within(self, first_scan: int, last_scan: int) -> Iterator[Runs]:
        """The intervals that the scans of a period saw, and others."""
        segments = self.disk.segments
        if not segments:
            yield from self._tail()
            return
        since, until = self.disk.segments_within(first_scan, last_scan)
        if until < len(segments):
            yield from self.disk.runs_within(first_scan, last_scan)
            return
        if first_scan < segments[-1].end_scan - self.disk.base:
            yield from self.disk.sealed_runs(since)
        yield from self._tail()

    def latest_runs(self, last_scan: int) -> Iterator[Runs]:
        """Each cell's latest interval that began by a scan, and others."""
        segments = self.disk.segments
        if not segments:
            yield from self._tail()
            return
        since, until = self.disk.segments_within(last_scan, last_scan)
        if until < len(segments):
            yield from self.disk.latest_runs(last_scan)
            return
        if last_scan < segments[-1].end_scan - self.disk.base:
            yield from self.disk.sealed_runs(since)
        yield from self._tail()

    def runs_of_tiles(
        self, tiles: NDArray[np.int32], first_scan: int | None = None, last_scan: int | None = None
    ) -> Iterator[Runs]:
        """The intervals of the cells of some tiles, of a period or all, and others."""
        first_scan = 0 if first_scan is None else first_scan
        last_scan = self.last_scan if last_scan is None else last_scan
        segments = self.disk.segments
        since, until = self.disk.segments_within(first_scan, last_scan) if segments else (0, 0)
        if until < len(segments):
            yield from self.disk.runs_of_tiles(tiles, first_scan, last_scan)
            return
        if segments and first_scan < segments[-1].end_scan - self.disk.base:
            yield from self.disk.sealed_of_tiles(tiles, since)
        yield from self._tail()

    @property
    def n_cells(self) -> int:
        """Cells observed at least once."""
        return int(np.count_nonzero(self.mapper.last[: self.tiles.n_cells] != NEVER))

    @property
    def n_intervals(self) -> int:
        """Number of intervals."""
        in_memory = sum(runs.n_intervals for runs in self._tail())
        return sum(segment.n_intervals for segment in self.disk.segments) + in_memory

    @property
    def memory_bytes(self) -> int:
        """Bytes held: by the mapper, by what is on its way to the disk, and by what was read from it."""
        sets = [one.sealed for one in self.pending] + self._fresh
        return self.mapper.memory_bytes + self.disk.held_bytes + sum(runs.nbytes for runs in sets)

    def take_fresh(self) -> Runs:
        """What ended since the last time; it is pending from now on."""
        self._sort()
        taken = join(self._fresh) if self._fresh else join([])
        self._fresh = []
        self.pending.append(Pending(self.mapper.n_scans, taken))
        return taken

    @property
    def n_fresh(self) -> int:
        """Intervals that ended and are not pending yet."""
        return self.mapper.n_sealed + sum(runs.n_intervals for runs in self._fresh)

    @property
    def _on_disk(self) -> int:
        """How many of the mapper's stamps are on disk, too."""
        segments = self.disk.segments
        return (segments[-1].end_scan if segments else self.disk.base) - self.mapper.first_kept

    def _tail(self) -> list[Runs]:
        """Intervals that are not on disk, then those that may go on."""
        self._sort()
        sets = [*(one.sealed for one in self.pending), *self._fresh, self.mapper.open_runs()]
        return [self.disk.rebased(runs) for runs in sets]

    def _sort(self) -> None:
        runs = self.mapper.take_sealed()
        if runs is not None:
            self._fresh.append(runs)
