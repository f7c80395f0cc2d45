"""Sparse storage of cells: tiles of 8 x 8, numbered in the order they were first seen.

A cell's number is ``tile * 64 + (row % 8) * 8 + (col % 8)``; per-cell arrays are indexed by it, so memory
follows the area that was seen, wherever in the world it lies. The directory, a dense array of tile numbers
over the bounding rectangle, turns a cell into its tile with one look-up.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tempog._arrays import grown
from tempog.errors import ExtentError
from tempog.sensing.grid_spec import Extent, GridSpec

T = TypeVar("T", bound=np.generic)

TILE_BITS = 3
TILE = 1 << TILE_BITS  # cells along one side
TILE_CELLS = TILE * TILE
NO_TILE = -1
NO_CELL = -1
FARTHEST_CELL = 2**30  # cells from the origin; row and col stay int32 with room to spare


class CellBox(NamedTuple):
    """Inclusive bounds of a rectangle of cells."""

    row_min: int
    row_max: int
    col_min: int
    col_max: int


class TileIndex:
    """Which tile holds which cells; grows as new ones are claimed.

    Attributes
    ----------
    directory : (n, m) int32
        Tile number at [tile row - dir_row0, tile col - dir_col0], or NO_TILE.
    tile_rows, tile_cols : (capacity,) int32
        Position of each tile, in tiles; the first `n_tiles` are in use.
    """

    def __init__(self, spec: GridSpec, max_cells: int) -> None:
        self.spec = spec
        self.max_cells = max_cells
        self.covered = CellBox(2**31, -(2**31), 2**31, -(2**31))  # in tiles; empty
        self.directory: NDArray[np.int32] = np.full((0, 0), NO_TILE, dtype=np.int32)
        self.dir_row0 = 0
        self.dir_col0 = 0
        self.n_tiles = 0
        self.tile_rows: NDArray[np.int32] = np.empty(0, dtype=np.int32)
        self.tile_cols: NDArray[np.int32] = np.empty(0, dtype=np.int32)

    @classmethod
    def from_tiles(
        cls, spec: GridSpec, max_cells: int, tile_rows: NDArray[np.int32], tile_cols: NDArray[np.int32]
    ) -> TileIndex:
        """An index of known tiles, in the order of their numbers."""
        index = cls(spec, max_cells)
        index.tile_rows = np.ascontiguousarray(tile_rows, dtype=np.int32)
        index.tile_cols = np.ascontiguousarray(tile_cols, dtype=np.int32)
        index.n_tiles = len(tile_rows)
        if index.n_tiles:
            extent = index.extent
            row_max, col_max = extent.row0 + extent.n_rows - 1, extent.col0 + extent.n_cols - 1
            index.cover(CellBox(extent.row0, row_max, extent.col0, col_max), "the saved map")
        return index

    @property
    def n_cells(self) -> int:
        """Cells in all tiles, seen or not: the length of per-cell arrays."""
        return self.n_tiles * TILE_CELLS

    @property
    def nbytes(self) -> int:
        """Bytes of the directory and the tiles' positions."""
        return self.directory.nbytes + self.tile_rows.nbytes + self.tile_cols.nbytes

    @property
    def extent(self) -> Extent:
        """Bounding rectangle of the tiles."""
        if self.n_tiles == 0:
            return Extent(0, 0, 0, 0, self.spec.resolution_m)
        rows, cols = self.tile_rows[: self.n_tiles], self.tile_cols[: self.n_tiles]
        row0, col0 = int(rows.min()), int(cols.min())
        n_rows, n_cols = int(rows.max()) - row0 + 1, int(cols.max()) - col0 + 1
        return Extent(row0 * TILE, col0 * TILE, n_rows * TILE, n_cols * TILE, self.spec.resolution_m)

    def covers(self, box: CellBox) -> bool:
        """Whether the directory reaches over `box` already."""
        covered = self.covered
        return (
            covered.row_min <= box.row_min >> TILE_BITS
            and box.row_max >> TILE_BITS <= covered.row_max
            and covered.col_min <= box.col_min >> TILE_BITS
            and box.col_max >> TILE_BITS <= covered.col_max
        )

    def cover(self, box: CellBox, label: str) -> None:
        """Make the directory reach over `box`; claims no tile.

        Raises
        ------
        ExtentError
            The bounding rectangle of all boxes covered so far would exceed `max_cells`.
        """
        wanted = CellBox(*(bound >> TILE_BITS for bound in box))
        old = self.covered
        union = CellBox(
            min(old.row_min, wanted.row_min),
            max(old.row_max, wanted.row_max),
            min(old.col_min, wanted.col_min),
            max(old.col_max, wanted.col_max),
        )
        n_rows, n_cols = union.row_max - union.row_min + 1, union.col_max - union.col_min + 1
        if n_rows * n_cols * TILE_CELLS > self.max_cells:
            self._refuse(n_rows, n_cols, label)
        self.covered = union
        n, m = self.directory.shape
        fits_rows = self.dir_row0 <= union.row_min and union.row_max < self.dir_row0 + n
        fits_cols = self.dir_col0 <= union.col_min and union.col_max < self.dir_col0 + m
        if not (fits_rows and fits_cols):
            self._relay(union, n_rows // 4 + 4, n_cols // 4 + 4)

    def _relay(self, union: CellBox, slack_rows: int, slack_cols: int) -> None:
        """Lay the directory anew over `union`, with room to grow on every side."""
        row0, col0 = union.row_min - slack_rows, union.col_min - slack_cols
        shape = union.row_max + slack_rows + 1 - row0, union.col_max + slack_cols + 1 - col0
        self.directory = np.full(shape, NO_TILE, dtype=np.int32)
        self.dir_row0, self.dir_col0 = row0, col0
        used = slice(0, self.n_tiles)
        self.directory[self.tile_rows[used] - row0, self.tile_cols[used] - col0] = np.arange(
            self.n_tiles, dtype=np.int32
        )

    def _refuse(self, n_rows: int, n_cols: int, label: str) -> None:
        side_m = TILE * self.spec.resolution_m
        raise ExtentError(
            f"{label} would stretch the map to {n_cols * side_m:.4g} m x {n_rows * side_m:.4g} m,"
            f" {n_rows * n_cols * TILE_CELLS:.3g} cells (allowed: {self.max_cells:.3g})."
            " Is its pose corrupt? Then leave the scan out (--skip-bad; skip_far=True in Python). If the site really"
            " is this large, use a coarser --resolution, or raise --max-cells (max_cells in Python)."
        )

    def reserve(self, n_more: int) -> None:
        """Room for the positions of `n_more` tiles."""
        needed = self.n_tiles + n_more
        if needed > len(self.tile_rows):
            capacity = max(needed, 2 * self.n_tiles)
            self.tile_rows = grown(self.tile_rows, capacity)
            self.tile_cols = grown(self.tile_cols, capacity)

    def cell_number(self, row: int, col: int) -> int:
        """Number of the cell, or NO_CELL where no tile holds it."""
        r, c = (row >> TILE_BITS) - self.dir_row0, (col >> TILE_BITS) - self.dir_col0
        n, m = self.directory.shape
        if not (0 <= r < n and 0 <= c < m) or self.directory[r, c] == NO_TILE:
            return NO_CELL
        return int(self.directory[r, c]) * TILE_CELLS + (row % TILE) * TILE + col % TILE

    def cell_numbers(self, rows: NDArray[np.int32], cols: NDArray[np.int32]) -> NDArray[np.int32]:
        """Number of each cell, NO_CELL where no tile holds it; `cell_number` for many."""
        numbers = np.full(len(rows), NO_CELL, dtype=np.int32)
        r, c = (rows >> TILE_BITS) - self.dir_row0, (cols >> TILE_BITS) - self.dir_col0
        n, m = self.directory.shape
        known = (r >= 0) & (r < n) & (c >= 0) & (c < m)
        known[known] = self.directory[r[known], c[known]] != NO_TILE
        tiles = self.directory[r[known], c[known]]
        numbers[known] = tiles * TILE_CELLS + (rows[known] & (TILE - 1)) * TILE + (cols[known] & (TILE - 1))
        return numbers

    def rows_cols(self, cells: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Lattice row and col of each numbered cell."""
        tiles, within = cells >> (2 * TILE_BITS), cells & (TILE_CELLS - 1)
        rows = self.tile_rows[tiles] * TILE + (within >> TILE_BITS)
        cols = self.tile_cols[tiles] * TILE + (within & (TILE - 1))
        return rows.astype(np.int32), cols.astype(np.int32)

    def dense_places(self) -> NDArray[np.int64]:
        """``(n_tiles,)`` where each tile's south-western cell lies in a flattened array over `extent`."""
        extent = self.extent
        rows = self.tile_rows[: self.n_tiles].astype(np.int64) * TILE - extent.row0
        cols = self.tile_cols[: self.n_tiles].astype(np.int64) * TILE - extent.col0
        places: NDArray[np.int64] = rows * extent.n_cols + cols
        return places

    def to_dense(self, per_cell: NDArray[T], fill: float) -> NDArray[T]:
        """Lay a per-cell array out as ``[row, col]`` over `extent`."""
        extent = self.extent
        dense = np.full((extent.n_rows // TILE, TILE, extent.n_cols // TILE, TILE), fill, dtype=per_cell.dtype)
        r = self.tile_rows[: self.n_tiles] - extent.row0 // TILE
        c = self.tile_cols[: self.n_tiles] - extent.col0 // TILE
        dense[r, :, c, :] = per_cell[: self.n_cells].reshape(-1, TILE, TILE)
        return dense.reshape(extent.shape)

    def from_dense(self, dense: NDArray[T]) -> NDArray[T]:
        """The reverse of `to_dense`: ``(n_cells,)``, by cell number."""
        extent = self.extent
        tiled = dense.reshape(extent.n_rows // TILE, TILE, extent.n_cols // TILE, TILE)
        r = self.tile_rows[: self.n_tiles] - extent.row0 // TILE
        c = self.tile_cols[: self.n_tiles] - extent.col0 // TILE
        per_cell: NDArray[T] = tiled[r, :, c, :].reshape(-1)
        return per_cell
