"""One scan to one statement per cell: hit, free, or nothing, a hit winning over free.

Two models share the interface. `literal` is the inverse sensor model of the scan alone, as the paper has
it. `surface` says less, and what it says holds up: a beam that grazes a wall crosses the rims of the
wall's cells, which the literal model calls free, so that walls flicker like doors.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.config import MapConfig
from tempog.errors import ExtentError
from tempog.scans.scan import Scan
from tempog.sensing import raycast
from tempog.sensing.cells import add_hit_points, claim_tiles_of_hits, number_cells
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import FARTHEST_CELL, TILE, TILE_CELLS, CellBox, TileIndex

LARGEST_FLOAT32 = float(np.finfo(np.float32).max)
NO_RETURN_CODES = {"never": raycast.NEVER, "always": raycast.ALWAYS, "neighbours": raycast.NEIGHBOURS}


class Statements(NamedTuple):
    """What one scan says.

    Attributes
    ----------
    cells : (n,) int32
        Numbers of the cells, each at most once.
    prob : (n,) float32
        P(occupied) by this scan alone.
    """

    cells: NDArray[np.int32]
    prob: NDArray[np.float32]


class Sensor:
    """Turns scans into statements by the configured model; owns the buffers that takes.

    Parameters
    ----------
    config : MapConfig
    """

    def __init__(self, config: MapConfig) -> None:
        self.config = config.sensing
        self.resolution_m = config.grid.resolution_m
        self._no_return = NO_RETURN_CODES[self.config.no_return]
        self._prob_hit = np.float32(self.config.prob_hit)
        self._prob_free = np.float32(self.config.prob_free)
        # Cells around the beams' bounds that protection and snapping may mark, and one for rounding.
        self._rim = math.ceil(max(self.config.protect_m, self.config.snap_m) / self.resolution_m) + 1
        self._state = np.empty(0, dtype=np.uint8)
        self._note = np.empty(0, dtype=np.int32)
        self._touched = np.empty(0, dtype=np.int32)
        self._path = np.empty(0, dtype=np.uint32)
        self._end_x = self._end_y = self._reach = np.empty(0)
        self._is_hit = np.empty(0, dtype=np.bool_)

    def sense(self, scan: Scan, tiles: TileIndex, surfaces: SurfaceMemory) -> Statements:
        """What `scan` says about which cells.

        Claims the tiles it needs in `tiles` and adds the hit points to `surfaces` afterwards, so that a scan
        is never judged by itself.

        Raises
        ------
        ExtentError
            The scan lies so far off that the map would exceed `GridConfig.max_cells`; nothing was changed.
        """
        config, resolution = self.config, self.resolution_m
        self._aim(scan)
        box = self._box
        if not tiles.covers(box):
            tiles.cover(box, f"{scan.label or 'the scan'} at {scan.t:.3f} s, pose ({scan.x:g}, {scan.y:g}),")
        n_rows, n_cols = box.row_max - box.row_min + 1, box.col_max - box.col_min + 1
        shift = (n_cols - 1).bit_length()
        window = n_rows << shift
        if window > len(self._state):
            self._state = np.empty(window, dtype=np.uint8)
            self._note = np.empty(window, dtype=np.int32)
            self._touched = np.empty(window + 1, dtype=np.int32)
        if n_rows + n_cols > len(self._path):
            self._path = np.empty(n_rows + n_cols, dtype=np.uint32)
        self._state[:window] = raycast.UNTOUCHED
        where = (box.row_min, box.col_min, shift, resolution)
        directory = (tiles.directory, tiles.dir_row0, tiles.dir_col0)
        surfaces.reserve(tiles.n_cells, 0)
        beams = (scan.x, scan.y, self._end_x, self._end_y, self._reach)
        if config.evidence == "literal":
            n_hits = raycast.mark_hits(self._end_x, self._end_y, self._is_hit, *where, self._state, self._touched)
            n = raycast.free_literal(*beams, *where, self._path, self._state, self._touched, n_hits)
        else:
            raycast.protect_surfaces(
                self._end_x,
                self._end_y,
                self._is_hit,
                *where,
                config.protect_m,
                config.bridge_m,
                config.collinear_m,
                self._state,
            )
            n_hits = raycast.mark_hits_at_surfaces(
                self._end_x,
                self._end_y,
                self._is_hit,
                *where,
                config.snap_m,
                config.surface_min_hits,
                *directory,
                surfaces.slot_of_cell,
                surfaces.hit_count,
                self._state,
                self._touched,
            )
            n = raycast.free_surface(
                *beams,
                self._is_hit,
                *where,
                config.free_margin_m,
                config.clear_behind_m,
                config.surface_min_hits,
                *directory,
                surfaces.slot_of_cell,
                surfaces.hit_count,
                surfaces.moments,
                surfaces.lines,
                self._path,
                self._state,
                self._note,
                self._touched,
                n_hits,
            )
        tiles.reserve(window // TILE_CELLS)
        cells = np.empty(n, dtype=np.int32)
        tiles.n_tiles = number_cells(
            self._touched,
            n,
            box.row_min,
            box.col_min,
            shift,
            *directory,
            tiles.tile_rows,
            tiles.tile_cols,
            tiles.n_tiles,
            cells,
        )
        if config.evidence == "surface":
            # A stray hit counts for another cell, but is remembered where it fell.
            tiles.n_tiles = claim_tiles_of_hits(
                self._end_x,
                self._end_y,
                self._is_hit,
                resolution,
                *directory,
                tiles.tile_rows,
                tiles.tile_cols,
                tiles.n_tiles,
            )
        surfaces.reserve(tiles.n_cells, len(self._is_hit))
        surfaces.n_slots = add_hit_points(
            self._end_x,
            self._end_y,
            self._is_hit,
            resolution,
            *directory,
            surfaces.slot_of_cell,
            surfaces.cell_of_slot,
            surfaces.hit_count,
            surfaces.moments,
            surfaces.lines,
            config.evidence == "surface",
            surfaces.n_slots,
        )
        prob = np.full(n, self._prob_free, dtype=np.float32)
        prob[:n_hits] = self._prob_hit
        return Statements(cells, prob)

    def _aim(self, scan: Scan) -> None:
        """Fill the beam buffers and `_box`, the cells the scan may touch, aligned to tiles."""
        n_beams = len(scan.ranges)
        if n_beams != len(self._is_hit):
            self._end_x, self._end_y, self._reach = (np.empty(n_beams) for _ in range(3))
            self._is_hit = np.empty(n_beams, dtype=np.bool_)
        farthest_m = FARTHEST_CELL * self.resolution_m
        if max(abs(scan.x), abs(scan.y)) + self.config.max_range_m > farthest_m:
            raise ExtentError(
                f"{scan.label or 'the scan'} at {scan.t:.3f} s has pose ({scan.x:g}, {scan.y:g});"
                f" wanted coordinates within ±{farthest_m:.3g} m. Is it corrupt? Leave the scan out (--skip-bad, or"
                " skip_far=True in Python), or shift the log's origin."
            )
        x_min, x_max, y_min, y_max = raycast.aim(
            scan.angles,
            scan.ranges,
            scan.x,
            scan.y,
            scan.theta,
            float(np.float32(min(scan.max_range, LARGEST_FLOAT32))),  # a reading equal to it is a float32
            self.config.max_range_m,
            self._no_return,
            self.config.evidence == "surface",
            self._end_x,
            self._end_y,
            self._reach,
            self._is_hit,
        )
        rim, resolution = self._rim, self.resolution_m
        self._box = CellBox(
            (math.floor(y_min / resolution) - rim) // TILE * TILE,
            (math.floor(y_max / resolution) + rim) // TILE * TILE + TILE - 1,
            (math.floor(x_min / resolution) - rim) // TILE * TILE,
            (math.floor(x_max / resolution) + rim) // TILE * TILE + TILE - 1,
        )
