"""A TemporalGrid fed with given statements instead of scans, and its answers as plain dictionaries."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np

from strategies import Stream
from tempog.config import GridConfig, MapConfig
from tempog.grid import mapper
from tempog.grid.temporal_grid import TemporalGrid
from tempog.scans.scan import Scan
from tempog.sensing.evidence import Statements
from tempog.sensing.tiles import NO_CELL, TILE, CellBox
from tempog.store.live_map import LiveMap


class FedSensor:
    """Takes the place of a grid's sensor: says what the stream says, and claims the tiles that takes."""

    def __init__(self, stream: Stream) -> None:
        self.statements = iter(stream.statements)

    def sense(self, scan, tiles, surfaces):
        said = next(self.statements)
        numbers = [self._claim(tiles, row, col) for (row, col), _ in said]
        surfaces.reserve(tiles.n_cells, 0)
        probs = [prob for _, prob in said]
        return Statements(np.array(numbers, dtype=np.int32), np.array(probs, dtype=np.float32))

    @staticmethod
    def _claim(tiles, row, col):
        tiles.cover(CellBox(row, row, col, col), "a statement")
        if tiles.cell_number(row, col) == NO_CELL:
            tiles.reserve(1)
            tiles.directory[row // TILE - tiles.dir_row0, col // TILE - tiles.dir_col0] = tiles.n_tiles
            tiles.tile_rows[tiles.n_tiles] = row // TILE
            tiles.tile_cols[tiles.n_tiles] = col // TILE
            tiles.n_tiles += 1
        return tiles.cell_number(row, col)


def config_of(stream: Stream, resolution_m: float = GridConfig.resolution_m) -> MapConfig:
    """How `stream` is to be mapped."""
    return MapConfig(grid=GridConfig(resolution_m, gap_s=stream.gap_ns / 1e9, tolerance=stream.tolerance))


def empty_grid(stream: Stream, resolution_m: float = GridConfig.resolution_m) -> TemporalGrid:
    """A grid that listens to `stream`, whatever the time between its scans."""
    grid = TemporalGrid(config_of(stream, resolution_m))
    grid._mapper.sensor = FedSensor(stream)
    grid._mapper.gap_judged = True
    return grid


@contextmanager
def listening(stream: Stream) -> Iterator[None]:
    """Every map that begins to be mapped meanwhile listens to `stream`, one after the other.

    Their gap thresholds are judged by the scans unless they are told a scan period.
    """
    sensor = FedSensor(stream)
    with patch.object(mapper, "Sensor", lambda config: sensor):
        yield


def begin_session(grid: TemporalGrid) -> None:
    """No interval of `grid` reaches over this moment."""
    grid._mapper._session_start = grid.n_scans


def feed(grid: TemporalGrid | LiveMap, stamp_ns: int, x: float = 0.0, y: float = 0.0) -> None:
    """Integrate the stream's next scan."""
    grid.integrate(Scan(0.0, (x, y, 0.0), [], [], stamp_ns=stamp_ns))


def grid_of(stream: Stream, resolution_m: float = GridConfig.resolution_m) -> TemporalGrid:
    """The whole stream, integrated."""
    grid = empty_grid(stream, resolution_m)
    for stamp_ns in stream.stamps_ns:
        feed(grid, stamp_ns)
    return grid


def moment(stamp_ns: int) -> np.datetime64:
    """A stamp as a moment, exact to the nanosecond."""
    return np.datetime64(int(stamp_ns), "ns")


def as_dict(dense, extent, unknown=None):
    """``{(row, col): value}`` of the cells that are known."""
    known = ~np.isnan(dense) if unknown is None else dense != unknown
    return {
        (int(row) + extent.row0, int(col) + extent.col0): dense[row, col].item() for row, col in np.argwhere(known)
    }


def intervals_of(history, cell):
    """``[[start, stop, value], ...]`` of a lattice cell, as the oracle has it."""
    (x, y), *_ = history.tiles.spec.centres([cell[0]], [cell[1]])
    return [list(interval) for interval in history.history(x, y)]
