"""Several histories as one: of robots that drove at the same time, of maps that are to be one, of chosen sessions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError
from tempog.grid.history import History
from tempog.grid.overlay import overlay
from tempog.grid.segments import Runs, of_tiles
from tempog.sensing.surfaces import SurfaceMemory, pooled
from tempog.sensing.tiles import TILE_CELLS, TileIndex


class Merged(History):
    """Histories of one site, put together scan by scan.

    Where several say something about a cell at one time, the one that began to say it later is believed, until it
    ends; see `overlay`.

    Parameters
    ----------
    parts : sequence of History
        Whole ones of one resolution, in one map frame. Of one that is being mapped, the scans until now count.
    kept : sequence of (n_scans,) bool, optional
        For each part, which scans count. No interval of it may be of scans that count and scans that do not.
        Default: all.

    Raises
    ------
    ConfigError
        Histories of different resolutions.
    """

    def __init__(self, parts: Sequence[History], kept: Sequence[NDArray[np.bool_]] | None = None) -> None:
        self.config = parts[0].config
        self._parts = list(parts)
        spec = parts[0].tiles.spec
        for part in parts:
            if part.tiles.spec != spec:
                raise ConfigError(
                    f"maps of {spec.resolution_m:g} m and {part.tiles.spec.resolution_m:g} m cells cannot become one;"
                    " map the logs again with one --resolution"
                )
        self._kept = list(kept) if kept is not None else [np.ones(len(p.stamps_ns), dtype=np.bool_) for p in parts]
        self.tiles, self._tile_of = _union([part.tiles for part in parts])
        stamps_ns = np.concatenate([part.stamps_ns[k] for part, k in zip(parts, self._kept, strict=True)])
        self._order = np.argsort(stamps_ns, kind="stable")
        self._stamps_ns = stamps_ns[self._order]
        numbers = np.empty(len(stamps_ns), dtype=np.int32)
        numbers[self._order] = np.arange(len(stamps_ns), dtype=np.int32)
        ends = np.cumsum([int(np.count_nonzero(k)) for k in self._kept])
        self._number_of = [np.full(len(k), -1, dtype=np.int32) for k in self._kept]
        for number_of, k, mine in zip(self._number_of, self._kept, np.split(numbers, ends[:-1]), strict=True):
            number_of[k] = mine
        self._latest: tuple[object, Runs] | None = None

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """``(n_scans,)`` stamp of each scan, ascending."""
        return self._stamps_ns

    @cached_property
    def poses(self) -> NDArray[np.float64]:
        """``(n_scans, 3)`` pose of the laser at each scan, map frame: x, y in metres, theta in radians."""
        poses = [part.poses[: len(kept)][kept] for part, kept in zip(self._parts, self._kept, strict=True)]
        return np.concatenate(poses)[self._order]

    @cached_property
    def surfaces(self) -> SurfaceMemory:
        """Where inside each cell the hits fell: of all scans of the parts, those that do not count too."""
        memories = []
        for part, tile_of in zip(self._parts, self._tile_of, strict=True):
            memory = getattr(part, "surfaces", None)
            if memory is not None:
                used = slice(0, memory.n_slots)
                cells = _renumbered(memory.cell_of_slot[used], tile_of)
                memories.append((cells, memory.hit_count[used], memory.moments[used]))
        return pooled(self.tiles.n_cells, memories)

    def runs(self) -> Iterator[Runs]:
        """All intervals."""
        return self.runs_within(0, len(self._stamps_ns) - 1)

    def runs_within(self, first_scan: int, last_scan: int) -> Iterator[Runs]:
        """The intervals that the scans of a period saw, and others."""
        yield self._known(("within", first_scan, last_scan), lambda: self._overlaid_within(first_scan, last_scan))

    def latest_runs(self, last_scan: int) -> Iterator[Runs]:
        """Each cell's latest interval that began by a scan, and others."""
        yield self._known(("latest", last_scan), lambda: self._overlaid_latest(last_scan))

    def runs_of_tiles(
        self, tiles: NDArray[np.int32], first_scan: int | None = None, last_scan: int | None = None
    ) -> Iterator[Runs]:
        """The intervals of the cells of some tiles, of a period or all."""
        first_scan = 0 if first_scan is None else first_scan
        last_scan = len(self._stamps_ns) - 1 if last_scan is None else last_scan
        sets = []
        for part, (history, tile_of) in enumerate(zip(self._parts, self._tile_of, strict=True)):
            wanted = np.flatnonzero(np.isin(tile_of, tiles)).astype(np.int32)
            # What the next scan begins ends what is believed instead of.
            period = self._of_part(part, first_scan, last_scan + 1)
            if len(wanted) and period is not None:
                all_count = bool((self._number_of[part] >= 0).all())
                found = history.runs_of_tiles(wanted, period[0] if all_count else 0, period[1])
                sets += [(part, of_tiles(runs, wanted)) for runs in found]
        yield self._overlaid(sets)

    def _of_part(self, part: int, first_scan: int, last_scan: int) -> tuple[int, int] | None:
        """The period of a part, by its own numbers, that reaches over a period; None if no scan of it counts."""
        number_of = self._number_of[part]
        mine = np.flatnonzero(number_of >= 0)
        if not len(mine):
            return None
        # An interval may reach over the period though no scan of its part is in it.
        since = max(int(np.searchsorted(number_of[mine], first_scan, side="right")) - 1, 0)
        until = min(int(np.searchsorted(number_of[mine], last_scan, side="left")), len(mine) - 1)
        return int(mine[since]), int(mine[until])

    def _overlaid_within(self, first_scan: int, last_scan: int) -> Runs:
        sets = []
        for part, history in enumerate(self._parts):
            period = self._of_part(part, first_scan, last_scan)
            if period is not None:
                sets += [(part, runs) for runs in history.runs_within(*period)]
        return self._overlaid(sets)

    def _overlaid_latest(self, last_scan: int) -> Runs:
        sets = []
        for part, number_of in enumerate(self._number_of):
            mine = np.flatnonzero((number_of >= 0) & (number_of <= last_scan))
            if len(mine):
                until = int(mine[-1])
                history, all_count = self._parts[part], len(mine) == until + 1
                found = history.latest_runs(until) if all_count else history.runs_within(0, until)
                sets += [(part, runs) for runs in found]
            # What the next scan begins ends what it is believed instead of.
            for following in np.flatnonzero(number_of == last_scan + 1).tolist():
                found = self._parts[part].latest_runs(following)
                sets += [(part, _begun_by(runs, following)) for runs in found]
        return self._overlaid(sets)

    def _overlaid(self, sets: list[tuple[int, Runs]]) -> Runs:
        """Intervals of several parts as one set, by the numbers of this history."""
        columns = []
        for part, runs in sets:
            number_of = self._number_of[part]
            if not len(number_of):
                continue
            newest = np.int32(len(number_of) - 1)  # the part may have been mapped on since
            first = number_of[np.minimum(runs.first, newest)]
            kept = (first >= 0) & (runs.first <= newest)
            cell = _renumbered(runs.cell[kept], self._tile_of[part])
            last = number_of[np.minimum(runs.last[kept], newest)]
            which = np.full(len(cell), part, dtype=np.int32)
            columns.append((cell, first[kept], last, runs.value[kept], which))
        cell, first, last = (np.concatenate([np.empty(0, np.int32), *(c[k] for c in columns)]) for k in range(3))
        value = np.concatenate([np.empty(0, np.float32), *(c[3] for c in columns)])
        which = np.concatenate([np.empty(0, np.int32), *(c[4] for c in columns)])
        order = np.lexsort((which, first, cell))
        rows = (cell[order], first[order], last[order], value[order])
        out_cell, out_first, out_last = np.empty((3, 2 * len(cell)), dtype=np.int32)
        out_value = np.empty(2 * len(cell), dtype=np.float32)
        n = overlay(*rows, out_cell, out_first, out_last, out_value)
        return Runs.of(out_cell[:n].copy(), out_first[:n].copy(), out_last[:n].copy(), out_value[:n].copy())

    def _known(self, key: object, make: Callable[[], Runs]) -> Runs:
        if self._latest is None or self._latest[0] != key:
            self._latest = (key, make())
        return self._latest[1]


def _union(indices: Sequence[TileIndex]) -> tuple[TileIndex, list[NDArray[np.int32]]]:
    """All tiles of several indices, and for each index the new number of each of its tiles."""
    rows = np.concatenate([tiles.tile_rows[: tiles.n_tiles] for tiles in indices])
    cols = np.concatenate([tiles.tile_cols[: tiles.n_tiles] for tiles in indices])
    _, at, which = np.unique(np.stack([rows, cols], axis=-1), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(at)  # in the order they come, so that those of the first part keep their numbers
    numbers = np.empty(len(at), dtype=np.int32)
    numbers[order] = np.arange(len(at), dtype=np.int32)
    at = at[order]
    max_cells = max(tiles.max_cells for tiles in indices)
    union = TileIndex.from_tiles(indices[0].spec, max_cells, rows[at], cols[at])
    ends = np.cumsum([tiles.n_tiles for tiles in indices])
    return union, np.split(numbers[which.reshape(-1)], ends[:-1])


def _renumbered(cells: NDArray[np.int32], tile_of: NDArray[np.int32]) -> NDArray[np.int32]:
    return (tile_of[cells // TILE_CELLS] * TILE_CELLS + cells % TILE_CELLS).astype(np.int32)


def _begun_by(runs: Runs, scan: int) -> Runs:
    which = runs.first == scan
    return Runs.of(runs.cell[which], runs.first[which], runs.last[which], runs.value[which])
