"""A history whose intervals are given, and one written to segments as small as wanted."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import numpy as np

from oracle.overlay import overlay
from tempog.config import MapConfig
from tempog.grid.history import CellPiece, History
from tempog.grid.segments import Runs
from tempog.sensing.grid_spec import GridSpec
from tempog.sensing.tiles import TILE, TileIndex
from tempog.store.rewrite import contents_of
from tempog.store.segment_files import write_segment
from tempog.store.strand import Strand


@contextlib.contextmanager
def a_folder() -> Iterator[Path]:
    """A folder, on a disk that need not be waited for."""
    folder = Path(tempfile.mkdtemp())
    try:
        with patch.object(os, "fsync", lambda descriptor: None):
            yield folder
    finally:
        shutil.rmtree(folder)


class FixedHistory(History):
    """Intervals ``{(row, col): [(first, last, value), ...]}`` of lattice cells in some tiles, ``(row, col)`` too."""

    def __init__(self, config: MapConfig, tiles: set, stamps_ns, poses, intervals: dict) -> None:
        self.config = config
        self._stamps_ns, self._poses = stamps_ns, poses
        rows, cols = np.array(sorted(tiles), dtype=np.int32).reshape(-1, 2).T
        self.tiles = TileIndex.from_tiles(
            GridSpec(config.grid.resolution_m), config.grid.max_cells, rows.copy(), cols.copy()
        )
        rows = [(self.tiles.cell_number(*cell), *interval) for cell, found in intervals.items() for interval in found]
        cell, first, last, value = (np.array([row[k] for row in sorted(rows)]) for k in range(4))
        self._runs = Runs.of(*(column.astype(np.int32) for column in (cell, first, last)), value.astype(np.float32))

    @property
    def stamps_ns(self):
        return self._stamps_ns

    @property
    def poses(self):
        return self._poses

    def runs(self) -> Iterator[Runs]:
        yield self._runs

    def runs_of_cell(self, cell: int) -> list[CellPiece]:
        where = self._runs.of_cell(cell)
        return [(self._runs.first[where], self._runs.last[where], self._runs.value[where])]


def tiles_of(history: History) -> set[tuple[int, int]]:
    """Rows and cols of a history's tiles."""
    used = slice(0, history.tiles.n_tiles)
    return set(zip(history.tiles.tile_rows[used].tolist(), history.tiles.tile_cols[used].tolist(), strict=True))


def cells_of(history: History) -> dict[tuple[int, int], list[tuple[int, int, float]]]:
    """The intervals of each lattice cell, by scan numbers."""
    runs = history.all_runs()
    rows, cols = history.tiles.rows_cols(runs.cell)
    found: dict = {}
    columns = (rows, cols, runs.first, runs.last, runs.value)
    for row, col, *interval in zip(*(column.tolist() for column in columns), strict=True):
        found.setdefault((row, col), []).append(tuple(interval))
    assert all((row // TILE, col // TILE) in tiles_of(history) for row, col in found)
    return found


def strand_of_small_segments(history: History, folder: Path, most_intervals: int) -> Strand:
    """A history, rewritten to segments of at most so many intervals."""
    contents = contents_of(history, most_intervals)
    return Strand(
        folder, [write_segment(folder, content, n_cells=n_cells) for content, n_cells in contents], history.config
    )


def slowly_merged(grids: list[History], kept: list[np.ndarray] | None = None) -> FixedHistory:
    """What `Merged` should be, by the oracle, one cell after the other."""
    kept = [np.ones(grid.n_scans, dtype=bool) for grid in grids] if kept is None else kept
    scans = sorted(
        (int(grid.stamps_ns[k]), number, k)
        for number, grid in enumerate(grids)
        for k in range(grid.n_scans)
        if kept[number][k]
    )
    new = {(number, k): i for i, (_, number, k) in enumerate(scans)}
    parts = [
        {
            cell: [
                (new[number, a], new[number, b], value) for a, b, value in intervals if kept[number][a : b + 1].all()
            ]
            for cell, intervals in cells_of(grid).items()
        }
        for number, grid in enumerate(grids)
    ]
    cells = {cell: overlay([part.get(cell, []) for part in parts]) for cell in set().union(*parts)}
    return FixedHistory(
        grids[0].config,
        set().union(*map(tiles_of, grids)),
        np.array([stamp_ns for stamp_ns, _, _ in scans], dtype=np.int64),
        np.array([grids[number].poses[k] for _, number, k in scans]),
        cells,
    )
