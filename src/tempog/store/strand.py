"""A history in segments that follow each other in time: reads what a question needs, and no more."""

from __future__ import annotations

import bisect
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tempog.config import MapConfig
from tempog.errors import ConfigError, ExtentError, MapError
from tempog.grid.history import History
from tempog.grid.merged import Merged
from tempog.grid.segments import Runs, of_tiles
from tempog.sensing.grid_spec import GridSpec
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import TileIndex
from tempog.store.manifest import Manifest, Segment, damaged
from tempog.store.segment_files import SegmentFiles, overlaid_hits, overlaid_runs
from tempog.times import MAX_NS, NS_PER_S

HELD_INTERVALS = 2**28  # 3.5 GB; what was read is kept for the next question up to here
HELD_PARTS = 2**10  # of segments that were not read as a whole, of so few tiles each that they take some kilobytes
MOST_TILES_HELD = 16
SHARE_OF_MANY = 0.25  # of all cells: from there on reading parts of files is no gain
HELD_STATES = 4  # states of all cells between segments: for questions that go back and forth


class Strand(History):
    """Segments on disk as a history; answers what a `TemporalGrid` answers.

    Parameters
    ----------
    root : path
        The map's directory.
    segments : sequence of Segment
        In time order.
    config : MapConfig

    Attributes
    ----------
    base : int
        Number on disk of its first scan; here it is 0.
    held_since_ns : int
        What is read of segments that ended before is let go of after the question. Default: nothing is.
    longest_gap_s : float, seconds
        Of the gap thresholds that its sessions were mapped with.
    """

    def __init__(self, root: Path, segments: Sequence[Segment], config: MapConfig) -> None:
        self.root = root
        self.segments = list(segments)
        self.config = config
        self.held_since_ns = -MAX_NS
        self.longest_gap_s = self.gap_s
        self._held: OrderedDict[str, Runs] = OrderedDict()
        self._held_scans: dict[str, tuple[NDArray[np.int64], NDArray[np.float64]]] = {}
        self._held_parts: OrderedDict[tuple[str, bytes], Runs] = OrderedDict()
        self._known_states: OrderedDict[str, Runs] = OrderedDict()
        self.base = self.segments[0].first_scan if self.segments else 0
        for segment in self.segments:
            SegmentFiles(root, segment).require_files()
        if any(a.end_scan != b.first_scan for a, b in zip(self.segments, self.segments[1:], strict=False)):
            raise damaged(root, "map.json names segments that do not follow each other")

    @cached_property
    def tiles(self) -> TileIndex:  # type: ignore[override]
        """Which tile holds which cells."""
        parts = [SegmentFiles(self.root, segment).tiles() for segment in self.segments]
        rows, cols = (np.concatenate([np.empty(0, np.int32), *(part[k] for part in parts)]) for k in (0, 1))
        try:
            return TileIndex.from_tiles(
                GridSpec(self.config.grid.resolution_m), self.config.grid.max_cells, rows, cols
            )
        except (ConfigError, ExtentError) as error:
            raise damaged(self.root, str(error)) from error

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """``(n_scans,)`` stamp of each scan, ascending."""
        return self._scans[0]

    @property
    def poses(self) -> NDArray[np.float64]:
        """``(n_scans, 3)`` pose of the laser at each scan, map frame: x, y in metres, theta in radians."""
        return self._scans[1]

    @property
    def n_scans(self) -> int:
        """Number of scans."""
        return sum(segment.n_scans for segment in self.segments)

    @cached_property
    def _scans(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        parts = [self._scans_of(segment) for segment in self.segments]
        stamps_ns = np.concatenate([np.empty(0, np.int64), *(part[0] for part in parts)])
        if np.any(np.diff(stamps_ns) < 0):
            raise damaged(self.root, "the stamps of its scans are out of order")
        return stamps_ns, np.concatenate([np.empty((0, 3)), *(part[1] for part in parts)])

    def _scans_of(self, segment: Segment) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        if segment.name not in self._held_scans:
            scans = SegmentFiles(self.root, segment).scans()
            if segment.stop_ns < self.held_since_ns:
                return scans
            self._held_scans[segment.name] = scans
        return self._held_scans[segment.name]

    @cached_property
    def surfaces(self) -> SurfaceMemory:
        """Where inside each cell the hits fell; read when first asked for."""
        since = self._full_by(len(self.segments))
        parts = [SegmentFiles(self.root, segment).hits() for segment in self.segments[since:]]
        for part in parts:
            self._require_cells(part.cells)
        return SurfaceMemory.of(self.tiles.n_cells, *overlaid_hits(parts))

    # Intervals.

    def runs(self) -> Iterator[Runs]:
        """All intervals: those that ended, segment by segment, then those that may go on."""
        yield from self.sealed_runs()
        yield self.state_after(len(self.segments))

    def sealed_runs(self, since: int = 0, until: int | None = None) -> Iterator[Runs]:
        """Intervals that ended, segment by segment; of all, or from one to before another."""
        for segment in self.segments[since:until]:
            yield self._sealed(segment)

    def runs_within(self, first_scan: int, last_scan: int) -> Iterator[Runs]:
        """The intervals that the scans of a period saw, and others."""
        since, until = self.segments_within(first_scan, last_scan)
        yield from self.sealed_runs(since, until)
        yield self.state_after(until)

    def latest_runs(self, last_scan: int) -> Iterator[Runs]:
        """Each cell's latest interval that began by a scan, and others."""
        # What went on before the moment went on until these segments' end, or ended in one of them.
        yield from self.runs_within(last_scan, last_scan)

    def runs_of_tiles(
        self, tiles: NDArray[np.int32], first_scan: int | None = None, last_scan: int | None = None
    ) -> Iterator[Runs]:
        """The intervals of the cells of some tiles, of a period or all, and others."""
        since, until = 0, len(self.segments)
        if until and (first_scan, last_scan) != (None, None):
            last_scan = self.n_scans - 1 if last_scan is None else last_scan
            since, until = self.segments_within(first_scan or 0, last_scan)
        yield from self.sealed_of_tiles(tiles, since, until)
        is_known = until == 0 or self.segments[until - 1].name in self._known_states
        if is_known or self._are_many(tiles):
            yield self.state_after(until)
        else:
            latest = self.segments[until - 1]
            yield self._part(f"{latest.name}/open", latest, tiles, partial(self._overlaid_open, until))

    def sealed_of_tiles(self, tiles: NDArray[np.int32], since: int = 0, until: int | None = None) -> Iterator[Runs]:
        """Those that ended of the cells of some tiles, and others; from one segment to before another."""
        if self._are_many(tiles):
            yield from self.sealed_runs(since, until)
            return
        for segment in self.segments[since:until]:
            files = SegmentFiles(self.root, segment)
            held = self._held.get(segment.name)
            yield held or self._part(segment.name, segment, tiles, files.sealed)

    def _are_many(self, tiles: NDArray[np.int32]) -> bool:
        """Whether tiles are so much of the map that all is read, and kept for the next question."""
        return len(tiles) > SHARE_OF_MANY * self.tiles.n_tiles

    def state_after(self, n_segments: int) -> Runs:
        """Of each cell the interval that might go on when so many segments had ended."""
        if n_segments == 0:
            return overlaid_runs([])
        name = self.segments[n_segments - 1].name
        if name not in self._known_states:
            self._known_states[name] = self._checked(self._overlaid_open(n_segments))
            while len(self._known_states) > HELD_STATES:
                self._known_states.popitem(last=False)
        self._known_states.move_to_end(name)
        return self._known_states[name]

    @property
    def n_intervals(self) -> int:
        """Number of intervals."""
        return sum(segment.n_intervals for segment in self.segments) + self.n_cells

    @property
    def n_cells(self) -> int:
        """Cells observed at least once."""
        return self.segments[-1].n_cells if self.segments else 0

    def segments_within(self, first_scan: int, last_scan: int) -> tuple[int, int]:
        """Which segments, from the first to before the last, say all about the scans of a period.

        An interval that is interrupted for less than the gap threshold may go on in a segment that begins so much
        later.
        """
        ends = [segment.end_scan - self.base for segment in self.segments]
        since = min(bisect.bisect_right(ends, first_scan), len(ends) - 1)
        until = min(bisect.bisect_right(ends, last_scan), len(ends) - 1) + 1
        gap_ns = round(min(self.longest_gap_s * NS_PER_S, MAX_NS))
        latest_ns = int(self.stamps_ns[min(max(last_scan, 0), self.n_scans - 1)]) + gap_ns
        while until < len(ends) and self.segments[until].start_ns <= latest_ns:
            until += 1
        return since, until

    def replace_segments(self, segments: Sequence[Segment]) -> None:
        """Go on with other segments of the same scans and more; what is known of those that stay is kept."""
        self.segments = list(segments)
        for name in ("_scans", "surfaces", "tiles"):
            self.__dict__.pop(name, None)
        self.let_go()

    def hold(self, segment: Segment, sealed: Runs) -> None:
        """Keep a segment's intervals, given by raw scan numbers, in memory as if they had been read."""
        if segment.stop_ns >= self.held_since_ns:
            self._held[segment.name] = self.rebased(sealed)

    def let_go(self) -> None:
        """Forget what is known of segments that ended before `held_since_ns`, or are not of this strand any more."""
        kept = {segment.name for segment in self.segments if segment.stop_ns >= self.held_since_ns}
        for held in (self._held, self._held_scans):
            for name in [name for name in held if name not in kept]:
                del held[name]
        self._known_states.clear()
        self._held_parts.clear()

    @property
    def held_bytes(self) -> int:
        """Bytes of the intervals and scans that are held in memory."""
        sets = (*self._held.values(), *self._held_parts.values(), *self._known_states.values())
        return sum(held.nbytes for held in sets) + sum(
            part.nbytes for scans in self._held_scans.values() for part in scans
        )

    def _sealed(self, segment: Segment) -> Runs:
        if segment.name in self._held:
            self._held.move_to_end(segment.name)
            return self._held[segment.name]
        runs = self._checked(SegmentFiles(self.root, segment).sealed())
        if segment.stop_ns >= self.held_since_ns:
            self._held[segment.name] = runs
            while len(self._held) > 1 and sum(held.n_intervals for held in self._held.values()) > HELD_INTERVALS:
                self._held.popitem(last=False)
        return runs

    def _part(self, name: str, segment: Segment, tiles: NDArray[np.int32], read: Callable[..., Runs]) -> Runs:
        """What is read of some tiles; kept, as the next question is often about them."""
        key = name, tiles.tobytes()
        if key in self._held_parts:
            self._held_parts.move_to_end(key)
            return self._held_parts[key]
        runs = of_tiles(self._checked(read(tiles)), tiles)
        if len(tiles) <= MOST_TILES_HELD and segment.stop_ns >= self.held_since_ns:
            self._held_parts[key] = runs
            while len(self._held_parts) > HELD_PARTS:
                self._held_parts.popitem(last=False)
        return runs

    def _overlaid_open(self, n_segments: int, tiles: NDArray[np.int32] | None = None) -> Runs:
        """The intervals that might go on when so many segments had ended; of all cells, or some tiles' at least."""
        since = self._full_by(n_segments)
        sets = [SegmentFiles(self.root, segment).open_runs(tiles) for segment in self.segments[since:n_segments]]
        for runs in sets:
            self._require_cells(runs.cells)
        return overlaid_runs(sets)

    def _full_by(self, n_segments: int) -> int:
        """The last of the first `n_segments` whose tables hold all cells."""
        return max((k for k in range(n_segments) if self.segments[k].full), default=0)

    def _require_cells(self, cells: NDArray[np.int32]) -> None:
        if len(cells) and not 0 <= cells.min() <= cells.max() < self.tiles.n_cells:
            raise damaged(self.root, "a table points at a cell that does not exist")

    def _checked(self, runs: Runs) -> Runs:
        self._require_cells(runs.cells[-1:])
        runs = self.rebased(runs)
        if len(runs.last) and (runs.last.max() >= self.n_scans or runs.first.min() < 0):
            raise damaged(self.root, "an interval points at a scan that does not exist")
        return runs

    def rebased(self, runs: Runs) -> Runs:
        """Intervals by the numbers that scans have now, from those that they have on disk."""
        return runs._replace(first=runs.first - self.base, last=runs.last - self.base) if self.base else runs


def strand_of(root: Path, manifest: Manifest, number: int) -> Strand:
    """A strand of a map; an empty one if there is none of that number yet."""
    segments = manifest.strands[number] if number < len(manifest.strands) else []
    strand = Strand(root, segments, MapConfig.from_dict(manifest.config))
    gaps = [session.config["grid"]["gap_s"] for session in manifest.sessions]
    strand.longest_gap_s = max((gap_s for gap_s in gaps if gap_s is not None), default=strand.gap_s)
    return strand


def strands_of(root: Path, manifest: Manifest) -> list[Strand]:
    """All strands of a map."""
    return [strand_of(root, manifest, number) for number in range(len(manifest.strands))]


def as_one(root: Path, manifest: Manifest, strands: Sequence[History]) -> History:
    """Strands as one history; an empty one if there are none. MapError if they lie too far apart."""
    if not strands:
        return Strand(root, [], MapConfig.from_dict(manifest.config))
    if len(strands) == 1:
        return strands[0]
    try:
        return Merged(strands)
    except ExtentError as error:
        raise MapError(
            f"{root}: what the robots saw lies too far apart to be one map; are their poses in one frame? What one of"
            " them saw can be asked for: --robot NAME, --session ID (robots=, sessions= in Python)"
        ) from error
