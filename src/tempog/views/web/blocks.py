"""What is kept in memory of a history: of squares of 256 x 256 pixels, at every zoom, when each pixel was what."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.grid.history import OCCUPIED_ABOVE
from tempog.grid.segments import Runs
from tempog.sensing.tiles import TILE, TILE_BITS, TILE_CELLS, TileIndex
from tempog.views.web.kernels import count_intervals, newest_looks, pool_looks, pool_states, take_intervals

SIDE_BITS = 8
SIDE = 1 << SIDE_BITS  # pixels along one side of a block, and of a tile of the picture
PIXELS = SIDE * SIDE
MOST_ZOOMS = 12  # beyond a pixel of 200 m


class Cells(NamedTuple):
    """The intervals of a block's cells; those of pixel i are at ``offsets[i]:offsets[i + 1]``."""

    offsets: NDArray[np.int32]
    first: NDArray[np.int32]
    last: NDArray[np.int32]
    state: NDArray[np.uint8]

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for array in self)


class States(NamedTuple):
    """From which scan on each pixel's last known state was what."""

    offsets: NDArray[np.int32]
    since: NDArray[np.int32]
    state: NDArray[np.uint8]

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for array in self)


class Looks(NamedTuple):
    """From which scan to which each pixel was seen."""

    offsets: NDArray[np.int32]
    first: NDArray[np.int32]
    last: NDArray[np.int32]

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for array in self)


class Where(NamedTuple):
    """A block: of zoom z, where a pixel is 2**z cells wide, the one at a row and col, counted from the origin."""

    z: int
    row: int
    col: int

    @property
    def quarters(self) -> tuple[Where, Where, Where, Where]:
        """The four blocks of the zoom below that it shows, in the order of its pixels."""
        row, col = 2 * self.row, 2 * self.col
        a, b = Where(self.z - 1, row, col), Where(self.z - 1, row, col + 1)
        return a, b, Where(self.z - 1, row + 1, col), Where(self.z - 1, row + 1, col + 1)


def _spread(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Their bits with a zero before each."""
    spread = np.zeros_like(numbers)
    for bit in range(SIDE_BITS):
        spread |= ((numbers >> bit) & 1) << 2 * bit
    return spread


_ALONG = _spread(np.arange(SIDE))
PIXEL_AT = ((_ALONG[:, None] << 1) | _ALONG[None, :]).astype(np.int32)
"""``(256, 256)`` number of the pixel at a row and col within its block; row 0 is the southern one."""
PLACES = np.empty(PIXELS, dtype=np.int32)
"""Where each pixel lies in a picture, whose first row is the northern one."""
PLACES[PIXEL_AT[::-1].ravel()] = np.arange(PIXELS, dtype=np.int32)
_NO_OFFSETS = np.zeros(PIXELS + 1, dtype=np.int32)
_NO_SCANS = np.empty(0, dtype=np.int32)
NO_STATES = States(_NO_OFFSETS, _NO_SCANS, np.empty(0, dtype=np.uint8))
NO_LOOKS = Looks(_NO_OFFSETS, _NO_SCANS, _NO_SCANS)

Read = Callable[[NDArray[np.int32]], Iterable[Runs]]
"""Gives the intervals of the cells of some tiles, whose numbers ascend, and others; see `History.runs_of_tiles`."""


class TilesOfBlocks:
    """Which tiles of the history make which block of the lowest zoom.

    Attributes
    ----------
    blocks : list of Where
    """

    def __init__(self, tiles: TileIndex) -> None:
        used = slice(0, tiles.n_tiles)
        self.rows, self.cols = tiles.tile_rows[used].copy(), tiles.tile_cols[used].copy()
        bits = SIDE_BITS - TILE_BITS
        places = np.stack([self.rows >> bits, self.cols >> bits], axis=-1)
        unique, block_of_tile = np.unique(places, axis=0, return_inverse=True)
        self.block_of_tile = block_of_tile.reshape(-1).astype(np.int32)
        self.blocks = [Where(0, row, col) for row, col in unique.tolist()]
        order = np.argsort(self.block_of_tile, kind="stable").astype(np.int32)
        ends = np.cumsum(np.bincount(self.block_of_tile, minlength=len(self.blocks)))
        self._tiles = dict(zip(self.blocks, np.split(order, ends[:-1]), strict=True)) if self.blocks else {}

    def tiles(self, where: Where) -> NDArray[np.int32]:
        """Numbers of a block's tiles, ascending."""
        return self._tiles[where]

    def pixels(self, where: Where) -> NDArray[np.int32]:
        """``(n_tiles, 64)`` the pixel of each cell of a block's tiles."""
        tiles = self._tiles[where]
        row = ((self.rows[tiles] * TILE) & (SIDE - 1))[:, None] + np.arange(TILE_CELLS)[None, :] // TILE
        col = ((self.cols[tiles] * TILE) & (SIDE - 1))[:, None] + np.arange(TILE_CELLS)[None, :] % TILE
        return np.ascontiguousarray(PIXEL_AT[row, col])


class Blocks:
    """Blocks of a history at every zoom: made when first asked for, and kept while there is room.

    A block of a higher zoom is made of four of the one below, so that a picture of a whole site costs as much as
    one of a room.

    Parameters
    ----------
    tiles : TileIndex
    read : callable
        See `Read`.
    budget_bytes : int
        What may be kept. What one question needs is held meanwhile, even if it is more.
    """

    def __init__(self, tiles: TileIndex, read: Read, budget_bytes: int) -> None:
        self.budget_bytes = budget_bytes
        self.held_bytes = 0
        self._held: OrderedDict[tuple[str, Where], Cells | States | Looks] = OrderedDict()
        self._holding, self._making = threading.Lock(), threading.RLock()
        self._newest: dict[Where, int] = {}  # the latest scan that saw a block, when it was made
        self._follow(tiles, read)

    def _follow(self, tiles: TileIndex, read: Read) -> None:
        self._read, self._tiles = read, TilesOfBlocks(tiles)
        known: set[Where] = set(self._tiles.blocks)
        self._known = set(known)
        for z in range(1, MOST_ZOOMS + 1):
            known = {Where(z, where.row >> 1, where.col >> 1) for where in known}
            self._known |= known

    @property
    def where(self) -> list[Where]:
        """The blocks of the lowest zoom."""
        return self._tiles.blocks

    def follow(self, tiles: TileIndex, read: Read, latest: Iterable[Runs]) -> list[Where]:
        """Go on with a history that grew by later scans; returns the blocks that have changed, which are forgotten.

        Parameters
        ----------
        latest : iterable of Runs
            Each cell's latest interval, and others.
        """
        with self._making:
            self._follow(tiles, read)
            newest = self._newest_of(latest)
            changed = [where for where, scan in newest.items() if scan != self._newest.pop(where, None)]
            self._newest = {where: newest[where] for where in set(newest) - set(changed)}
            gone = {Where(z, where.row >> z, where.col >> z) for where in changed for z in range(MOST_ZOOMS + 1)}
            with self._holding:
                for key in [key for key in self._held if key[1] in gone]:
                    self.held_bytes -= self._held.pop(key).nbytes
        return changed

    def _newest_of(self, sets: Iterable[Runs]) -> dict[Where, int]:
        newest = np.full(len(self._tiles.blocks), -1, dtype=np.int32)
        for runs in sets:
            newest_looks(runs.cells, runs.offsets, runs.last, self._tiles.block_of_tile, newest)
        return dict(zip(self._tiles.blocks, newest.tolist(), strict=True))

    def is_empty(self, where: Where) -> bool:
        """Whether nothing was seen there."""
        return where not in self._known

    def cells(self, where: Where) -> Cells:
        """The intervals of the cells of a block of zoom 0."""
        return self._kept("cells", where, self._read_cells)  # type: ignore[return-value]

    def states(self, where: Where) -> States:
        """When the pixels of a block were in which state."""
        if where not in self._known:
            return NO_STATES
        if where.z == 0:
            cells = self.cells(where)
            return States(cells.offsets, cells.first, cells.state)
        return self._kept("states", where, self._pool_states)  # type: ignore[return-value]

    def looks(self, where: Where) -> Looks:
        """When the pixels of a block were seen."""
        if where not in self._known:
            return NO_LOOKS
        if where.z == 0:
            cells = self.cells(where)
            return Looks(cells.offsets, cells.first, cells.last)
        return self._kept("looks", where, self._pool_looks)  # type: ignore[return-value]

    def take_all(self, read_all: Callable[[], Iterable[Runs]]) -> None:
        """Make all blocks of the lowest zoom at once; who asks for one meanwhile waits.

        Parameters
        ----------
        read_all : callable
            Gives all intervals, in sets from oldest to newest.
        """
        with self._making:
            sets = list(read_all())
            for where in self._tiles.blocks:
                self._kept("cells", where, lambda where: self._cells_of(where, sets))

    def _kept(
        self, kind: str, where: Where, make: Callable[[Where], Cells | States | Looks]
    ) -> Cells | States | Looks:
        key = kind, where
        found = self._recalled(key)
        if found is not None:
            return found
        with self._making:
            found = self._recalled(key)
            if found is None:
                found = make(where)
                with self._holding:
                    self._held[key] = found
                    self.held_bytes += found.nbytes
                    while self.held_bytes > self.budget_bytes and len(self._held) > 1:
                        self.held_bytes -= self._held.popitem(last=False)[1].nbytes
        return found

    def _recalled(self, key: tuple[str, Where]) -> Cells | States | Looks | None:
        with self._holding:
            found = self._held.get(key)
            if found is not None:
                self._held.move_to_end(key)
            return found

    def _read_cells(self, where: Where) -> Cells:
        return self._cells_of(where, list(self._read(self._tiles.tiles(where))))

    def _cells_of(self, where: Where, sets: list[Runs]) -> Cells:
        tiles, pixels = self._tiles.tiles(where), self._tiles.pixels(where)
        places = np.zeros(PIXELS + 1, dtype=np.int64)
        for runs in sets:
            count_intervals(runs.cells, runs.offsets, tiles, pixels, places)
        np.cumsum(places, out=places)
        n = int(places[-1])
        offsets = places.astype(np.int32)
        first, last, state = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.uint8)
        for runs in sets:
            take_intervals(*runs, tiles, pixels, OCCUPIED_ABOVE, places, first, last, state)
        self._newest[where] = int(last.max(initial=-1))
        return Cells(offsets, first, last, state)

    def _pool_states(self, where: Where) -> States:
        parts = [_pooled_states(self.states(quarter)) for quarter in where.quarters]
        offsets = _joined_offsets([part.offsets for part in parts])
        since, state = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
        return States(offsets, since, state)

    def _pool_looks(self, where: Where) -> Looks:
        parts = [_pooled_looks(self.looks(quarter)) for quarter in where.quarters]
        offsets = _joined_offsets([part.offsets for part in parts])
        first, last = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
        return Looks(offsets, first, last)


def _pooled_states(states: States) -> States:
    offsets = np.zeros(PIXELS // 4 + 1, dtype=np.int32)
    since, state = np.empty_like(states.since), np.empty_like(states.state)
    n = pool_states(*states, offsets, since, state)
    return States(offsets, since[:n], state[:n])


def _pooled_looks(looks: Looks) -> Looks:
    offsets = np.zeros(PIXELS // 4 + 1, dtype=np.int32)
    first, last = np.empty_like(looks.first), np.empty_like(looks.last)
    n = pool_looks(*looks, offsets, first, last)
    return Looks(offsets, first[:n], last[:n])


def _joined_offsets(parts: list[NDArray[np.int32]]) -> NDArray[np.int32]:
    lengths = np.concatenate([[0], *(np.diff(part) for part in parts)])
    return np.cumsum(lengths).astype(np.int32)
