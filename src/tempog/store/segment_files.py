"""A segment's five tables: written, read, checked, and laid one over the other."""

from __future__ import annotations

import shutil
import uuid
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tempog.errors import MapError
from tempog.grid.intervals import NEVER
from tempog.grid.segments import Runs, add_spans, join
from tempog.sensing.surfaces import SurfaceMemory
from tempog.store.manifest import SEGMENTS, Segment, damaged, is_format_1, read_document
from tempog.store.references import Encoded, decode, encode
from tempog.store.tables import (
    COUNTED,
    MASKS,
    MOMENTS,
    REFERENCES,
    TABLES,
    ZSTD_LEVEL,
    Columns,
    masks_of,
    read_masks,
    read_table,
    sync_all,
    write_table,
)


class Hits(NamedTuple):
    """Hit-point statistics of some cells.

    Attributes
    ----------
    cells : (n,) int32
        Cell numbers, each once.
    counts : (n,) int32
    moments : (n, 5) float32
        As in `SurfaceMemory`.
    """

    cells: NDArray[np.int32]
    counts: NDArray[np.int32]
    moments: NDArray[np.float32]


NO_HITS = Hits(np.empty(0, np.int32), np.empty(0, np.int32), np.empty((0, len(MOMENTS)), np.float32))


class Content(NamedTuple):
    """What a segment's tables hold.

    Attributes
    ----------
    first_scan : int
    stamps_ns, poses : (n_scans,), (n_scans, 3)
    first_tile : int
        Number of the first tile that these scans saw first.
    tile_rows, tile_cols : (n_tiles,) int32
        Of these tiles.
    sealed : Runs
        Intervals that ended.
    open_runs : Runs
        One interval of each cell that was seen, or of all cells if `full`.
    hits : Hits
        Of cells that were hit, or of all if `full`.
    full : bool
    """

    first_scan: int
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    first_tile: int
    tile_rows: NDArray[np.int32]
    tile_cols: NDArray[np.int32]
    sealed: Runs
    open_runs: Runs
    hits: Hits
    full: bool

    @property
    def stop_ns(self) -> int:
        """Stamp of the last scan."""
        return int(self.stamps_ns[-1])


def write_segment(
    root: Path,
    content: Content,
    *,
    n_cells: int,
    level: int = ZSTD_LEVEL,
    groups: Sequence[NDArray[np.int32]] = (),
) -> Segment:
    """Write a segment to a new folder, which counts only once map.json names it.

    Intervals that cells of a group share are written once, by reference (paper, V.A).

    Raises
    ------
    OSError, pyarrow.ArrowException
        It could not be written; nothing of it is left.
    """
    name = f"{SEGMENTS}/{content.first_scan:010d}-{uuid.uuid4().hex[:8]}"
    folder = root / name
    try:
        folder.mkdir(parents=True)
        for table, columns in _columns(content, groups).items():
            write_table(folder / f"{table}.parquet", columns, level)
        sync_all([*folder.iterdir(), folder, folder.parent])
        n_bytes = sum(file.stat().st_size for file in folder.iterdir())
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return Segment(
        name,
        content.first_scan,
        len(content.stamps_ns),
        int(content.stamps_ns[0]),
        int(content.stamps_ns[-1]),
        content.sealed.n_intervals,
        n_cells,
        content.full,
        n_bytes,
    )


def _columns(content: Content, groups: Sequence[NDArray[np.int32]]) -> dict[str, Columns]:
    poses, hits = content.poses, content.hits
    by_cell = np.argsort(hits.cells)
    moments = {name: hits.moments[by_cell, k] for k, name in enumerate(MOMENTS)}
    scans = {"stamp_ns": content.stamps_ns, "x": poses[:, 0], "y": poses[:, 1], "theta": poses[:, 2]}
    return {
        "scans": {"scan": _numbers(content.first_scan, content.stamps_ns), **scans},
        "tiles": {
            "tile": _numbers(content.first_tile, content.tile_rows),
            "row": content.tile_rows,
            "col": content.tile_cols,
        },
        **(
            _referring_columns(content.sealed, groups) if groups else {"intervals": _interval_columns(content.sealed)}
        ),
        "open": _interval_columns(content.open_runs),
        "surfaces": {"cell": hits.cells[by_cell], "hits": hits.counts[by_cell], **moments},
    }


def _referring_columns(runs: Runs, groups: Sequence[NDArray[np.int32]]) -> dict[str, Columns]:
    encoded = encode(runs, groups)
    span = encoded.entry_last - encoded.entry_first
    timelines = {"group": encoded.entry_group, "first_scan": encoded.entry_first, "span": span}
    n_bytes = -(-np.bincount(encoded.member_group)[encoded.entry_group] // 8)
    rest = Runs.of(encoded.cell, encoded.first, encoded.last, encoded.value)
    return {
        "intervals": _interval_columns(rest),
        "members": {"cell": encoded.member, "group": encoded.member_group},
        "timelines": timelines | {"prob": encoded.entry_value, MASKS: masks_of(encoded.entry_members, n_bytes)},
    }


def _numbers(first: int, rows: NDArray[Any]) -> NDArray[np.int32]:
    return np.arange(first, first + len(rows), dtype=np.int32)


def _interval_columns(runs: Runs) -> Columns:
    return {"cell": runs.cell, "first_scan": runs.first, "span": runs.last - runs.first, "prob": runs.value}


class SegmentFiles:
    """Reads one segment of the map at `root`; every file that cannot be used is a MapError."""

    def __init__(self, root: Path, segment: Segment) -> None:
        self.root = root
        self.segment = segment

    def require_files(self) -> None:
        """MapError if one is missing."""
        for table in TABLES:
            if not (self._path(table)).is_file() and not (table == "open" and self._format_1):
                raise self._damaged(f"{table}.parquet is missing")

    def scans(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Stamps and poses."""
        columns = self._read("scans")
        stamps_ns = columns["stamp_ns"]
        if len(stamps_ns) != self.segment.n_scans:
            raise self._damaged(f"scans.parquet holds {len(stamps_ns)} scans, map.json says {self.segment.n_scans}")
        if np.any(np.diff(stamps_ns) < 0):
            raise self._damaged("the stamps of its scans are out of order")
        return stamps_ns, np.stack([columns["x"], columns["y"], columns["theta"]], axis=-1)

    def tiles(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Rows and cols of the tiles it adds."""
        columns = self._read("tiles")
        return columns["row"], columns["col"]

    def sealed(self, tiles: NDArray[np.int32] | None = None) -> Runs:
        """Intervals that ended; of the cells of some tiles, or a little more, or of all."""
        runs = self._runs("intervals", tiles)
        if self._path("members").is_file():
            return self._with_shared(runs)
        if not self._format_1:
            return runs
        going_on = np.zeros(runs.n_intervals, dtype=np.bool_)
        going_on[runs.offsets[1:] - 1] = True
        return _kept(runs, ~going_on)

    def open_runs(self, tiles: NDArray[np.int32] | None = None) -> Runs:
        """The interval that may go on, of each cell that was seen; of all, or of some tiles' cells and others."""
        if self._format_1:
            runs = self._runs("intervals", tiles)
            latest = runs.offsets[1:] - 1
            offsets = np.arange(len(runs.cells) + 1, dtype=np.int64)
            return Runs(runs.cells, offsets, runs.first[latest], runs.last[latest], runs.value[latest])
        runs = self._runs("open", tiles)
        if len(runs.cells) != runs.n_intervals:
            raise self._damaged("open.parquet holds several intervals of one cell")
        return runs

    def hits(self) -> Hits:
        """Where inside the cells hits fell."""
        columns = self._read("surfaces")
        return Hits(columns["cell"], columns["hits"], np.stack([columns[name] for name in MOMENTS], axis=-1))

    def content(self, *, sealed: bool = True, latest: bool = True) -> Content:
        """All of it; or without intervals that ended, or without the cells' latest intervals and statistics."""
        first_scan, full = self.segment.first_scan, self.segment.full
        intervals = self.sealed() if sealed else join([]), self.open_runs() if latest else join([])
        hits = self.hits() if latest else NO_HITS
        return Content(first_scan, *self.scans(), self._first_tile(), *self.tiles(), *intervals, hits, full)

    def _with_shared(self, rest: Runs) -> Runs:
        """Intervals with those that are kept by reference; of members, all of these."""
        members, shared = (
            self._read("members", REFERENCES["members"]),
            self._read("timelines", REFERENCES["timelines"]),
        )
        first, last = shared["first_scan"], shared["first_scan"] + shared["span"]
        try:
            masks = read_masks(self._path("timelines"))
            entries = shared["group"], first, last, shared["prob"]
            runs = decode(Encoded(rest.cell, *rest[2:], members["cell"], members["group"], *entries, masks))
        except (OSError, pa.ArrowException, KeyError, ValueError, IndexError) as error:
            raise self._damaged(f"timelines.parquet: {error}") from error
        return Runs(runs.cells.astype(np.int32), runs.offsets.astype(np.int64), *runs[2:])

    def _first_tile(self) -> int:
        if self._format_1:
            return 0
        numbers = self._read("tiles", {"tile": TABLES["tiles"]["tile"]})["tile"]
        return int(numbers[0]) if len(numbers) else 0

    @property
    def _format_1(self) -> bool:
        return is_format_1(self.segment.name)

    def _runs(self, table: str, tiles: NDArray[np.int32] | None = None) -> Runs:
        columns = self._read(table, tiles=tiles)
        cell, first, span = columns["cell"], columns["first_scan"], columns["span"]
        last = np.empty_like(first)
        end_scan = self.segment.end_scan if table == "intervals" else 2**31 - 1
        ascend, within = add_spans(cell, first, span, end_scan, last)
        if not within:
            raise self._damaged(f"{table}.parquet points at scans that do not exist")
        if not ascend:
            raise self._damaged(f"{table}.parquet is not sorted by cell")
        return Runs.of(cell, first, last, columns["prob"])

    def _path(self, table: str) -> Path:
        return self.root / self.segment.name / f"{table}.parquet"

    def _read(
        self, table: str, wanted: dict[str, Any] | None = None, tiles: NDArray[np.int32] | None = None
    ) -> Columns:
        if wanted is None:
            wanted = {name: kind for name, kind in TABLES[table].items() if name not in COUNTED}
        try:
            return read_table(self._path(table), wanted, tiles)
        except (OSError, pa.ArrowException, KeyError, ValueError) as error:
            raise self._damaged(f"{table}.parquet: {error}") from error

    def _damaged(self, what: str) -> MapError:
        if not (self.root / self.segment.name).is_dir():
            with suppress(MapError):
                if self.segment.name not in str(read_document(self.root)):
                    return MapError(f"{self.root}: the map was rewritten since it was opened; open it again")
        return damaged(self.root, f"{Path(self.segment.name).name}/{what}")


def _kept(runs: Runs, kept: NDArray[np.bool_]) -> Runs:
    """Those intervals of a set that are kept."""
    return Runs.of(runs.cell[kept], runs.first[kept], runs.last[kept], runs.value[kept])


def overlaid_runs(sets: Sequence[Runs]) -> Runs:
    """One interval per cell: that of the last set that has the cell."""
    sets = [runs for runs in sets if len(runs.cells)] or list(sets[:1])
    if len(sets) == 1:
        return sets[0]
    begin = min((int(runs.cells[0]) for runs in sets), default=0)
    n_cells = max((int(runs.cells[-1]) + 1 for runs in sets), default=0) - begin
    first, value = np.empty(n_cells, dtype=np.int32), np.empty(n_cells, dtype=np.float32)
    last = np.full(n_cells, NEVER, dtype=np.int32)
    for runs in sets:
        at = runs.cells - begin
        first[at], last[at], value[at] = runs.first, runs.last, runs.value
    seen = np.flatnonzero(last != NEVER)
    offsets = np.arange(len(seen) + 1, dtype=np.int64)
    return Runs((seen + begin).astype(np.int32), offsets, first[seen], last[seen], value[seen])


def overlaid_hits(sets: Sequence[Hits]) -> Hits:
    """The statistics of each cell by the last set that has it."""
    n_cells = max((int(hits.cells.max()) + 1 for hits in sets if len(hits.cells)), default=0)
    counts, moments = np.zeros(n_cells, dtype=np.int32), np.empty((n_cells, len(MOMENTS)), dtype=np.float32)
    for hits in sets:
        counts[hits.cells], moments[hits.cells] = hits.counts, hits.moments
    cells = np.flatnonzero(counts).astype(np.int32)
    return Hits(cells, counts[cells], moments[cells])


def hits_of(surfaces: SurfaceMemory, changed_since: NDArray[np.int32] | None = None) -> Hits:
    """A surface memory's statistics; or of the cells whose hit count is another than it was."""
    used = surfaces.hit_count[: surfaces.n_slots]
    slots = np.arange(surfaces.n_slots)
    if changed_since is not None:
        known = np.zeros_like(used)
        known[: len(changed_since)] = changed_since
        slots = np.flatnonzero(used != known)
    return Hits(surfaces.cell_of_slot[slots], used[slots].copy(), surfaces.moments[slots])


def joined(contents: Sequence[Content]) -> Content:
    """What several segments that follow each other come to as one."""
    full_from = max((k for k, one in enumerate(contents) if one.full), default=0)
    latest = contents[full_from:]
    return Content(
        contents[0].first_scan,
        np.concatenate([one.stamps_ns for one in contents]),
        np.concatenate([one.poses for one in contents]),
        next((one.first_tile for one in contents if len(one.tile_rows)), 0),
        np.concatenate([one.tile_rows for one in contents]),
        np.concatenate([one.tile_cols for one in contents]),
        join([one.sealed for one in contents]),
        overlaid_runs([one.open_runs for one in latest]),
        overlaid_hits([one.hits for one in latest]),
        any(one.full for one in contents),
    )
