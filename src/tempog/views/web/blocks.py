"""What is kept in memory of a history: of squares of 256 x 256 pixels, at every zoom, when each pixel was what."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.grid.history import OCCUPIED_ABOVE
from tempog.grid.segments import Runs
from tempog.sensing.tiles import TILE, TILE_BITS, TILE_CELLS, TileIndex
from tempog.views.web.kernels import (
    NEVER,
    NOTHING,
    count_intervals,
    last_looks_while_occupied,
    newest_looks,
    pool_largest,
    pool_looks,
    take_intervals,
)

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

Read = Callable[[NDArray[np.int32], NDArray[np.int32]], tuple[NDArray[np.int32], list[Runs]]]
"""Of the tiles at some rows and cols: their numbers, and intervals of their cells, with others; see `numbers_at`."""


def numbers_at(tiles: TileIndex, rows: NDArray[np.int32], cols: NDArray[np.int32]) -> NDArray[np.int32]:
    """Numbers of the tiles at some rows and cols, in tiles; NO_TILE where there is none."""
    return tiles.cell_numbers(rows << TILE_BITS, cols << TILE_BITS) >> 2 * TILE_BITS


class TilesOfBlocks:
    """Which tiles of a history make which block of the lowest zoom.

    Attributes
    ----------
    blocks : list of Where
    block_of_tile : (n_tiles,) int32
        By the number of each tile, its place in `blocks`.
    """

    def __init__(self, tiles: TileIndex) -> None:
        used = slice(0, tiles.n_tiles)
        self._rows, self._cols = tiles.tile_rows[used].copy(), tiles.tile_cols[used].copy()
        bits = SIDE_BITS - TILE_BITS
        places = np.stack([self._rows >> bits, self._cols >> bits], axis=-1)
        unique, block_of_tile = np.unique(places, axis=0, return_inverse=True)
        self.block_of_tile = block_of_tile.reshape(-1).astype(np.int32)
        self.blocks = [Where(0, row, col) for row, col in unique.tolist()]
        order = np.argsort(self.block_of_tile, kind="stable")
        ends = np.cumsum(np.bincount(self.block_of_tile, minlength=len(self.blocks)))
        self._tiles = dict(zip(self.blocks, np.split(order, ends[:-1]), strict=True)) if self.blocks else {}

    def positions(self, where: Where) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Rows and cols of a block's tiles, in tiles."""
        tiles = self._tiles[where]
        return self._rows[tiles], self._cols[tiles]


def _pixels(rows: NDArray[np.int32], cols: NDArray[np.int32]) -> NDArray[np.int32]:
    """``(n_tiles, 64)`` the pixel of each cell of tiles at some rows and cols, within its block."""
    within = np.arange(TILE_CELLS)[None, :]
    row = ((rows << TILE_BITS) & (SIDE - 1))[:, None] + within // TILE
    col = ((cols << TILE_BITS) & (SIDE - 1))[:, None] + within % TILE
    return np.ascontiguousarray(PIXEL_AT[row, col])


class Blocks:
    """Blocks of a history at every zoom: made when first asked for, and kept while there is room.

    A block of a higher zoom is made of four of the one below, so that a picture of a whole site costs as much as
    one of a room.

    Parameters
    ----------
    tiles : TilesOfBlocks
    read : callable
        See `Read`.
    budget_bytes : int
        What may be kept. What one question needs is held meanwhile, even if it is more.
    """

    def __init__(self, tiles: TilesOfBlocks, read: Read, budget_bytes: int) -> None:
        self.budget_bytes = budget_bytes
        self.held_bytes = 0
        self._held: OrderedDict[tuple[str, Where], Cells | States | Looks] = OrderedDict()
        self._holding = threading.Lock()  # of all that follows
        self._in_work: dict[tuple[str, Where], threading.Event] = {}
        self._n_followed = 0
        self._all_read = threading.Event()
        self._all_read.set()
        self._newest: dict[Where, int] = {}  # the latest scan that saw a block, when it was made
        self._read, self._tiles = read, tiles
        self._known = _at_all_zooms(tiles.blocks)

    @property
    def where(self) -> list[Where]:
        """The blocks of the lowest zoom."""
        return self._tiles.blocks

    def follow(self, tiles: TilesOfBlocks, latest: Iterable[Runs]) -> list[Where]:
        """Go on with a history that grew by later scans; returns the blocks that have changed, which are forgotten.

        Parameters
        ----------
        tiles : TilesOfBlocks
        latest : iterable of Runs
            Each cell's latest interval, and others; by the numbers of `tiles`.
        """
        scans = np.full(len(tiles.blocks), -1, dtype=np.int32)
        for runs in latest:
            newest_looks(runs.cells, runs.offsets, runs.last, tiles.block_of_tile, scans)
        newest = dict(zip(tiles.blocks, scans.tolist(), strict=True))
        with self._holding:
            self._n_followed += 1
            self._tiles, self._known = tiles, _at_all_zooms(tiles.blocks)
            changed = [where for where, scan in newest.items() if scan != self._newest.pop(where, None)]
            self._newest = {where: newest[where] for where in set(newest) - set(changed)}
            gone = {Where(z, where.row >> z, where.col >> z) for where in changed for z in range(MOST_ZOOMS + 1)}
            for key in [key for key in self._held if key[1] in gone]:
                self.held_bytes -= self._held.pop(key).nbytes
        return changed

    def is_empty(self, where: Where) -> bool:
        """Whether nothing was seen there."""
        return where not in self._known

    def cells(self, where: Where) -> Cells:
        """The intervals of the cells of a block of zoom 0."""
        self._all_read.wait()
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

    def occupied(self, where: Where) -> Looks:
        """From which scan on the pixels of a block were seen occupied last at which; see the kernel."""
        if where not in self._known:
            return NO_LOOKS
        make = self._last_looks if where.z == 0 else self._pool_last_looks
        return self._kept("occupied", where, make)  # type: ignore[return-value]

    def take_all(self, read_all: Callable[[], tuple[TileIndex, list[Runs]]]) -> None:
        """Make all blocks of the lowest zoom at once; who asks for one meanwhile waits.

        Parameters
        ----------
        read_all : callable
            Gives all intervals, in sets from oldest to newest, and the tiles that they are numbered by.
        """
        self._all_read.clear()
        try:
            tiles, sets = read_all()

            def make(where: Where) -> Cells:
                rows, cols = self._tiles.positions(where)
                return _cells_of(rows, cols, numbers_at(tiles, rows, cols), sets)

            for where in self._tiles.blocks:
                self._kept("cells", where, make)
        finally:
            self._all_read.set()

    def _kept(
        self, kind: str, where: Where, make: Callable[[Where], Cells | States | Looks]
    ) -> Cells | States | Looks:
        """What is held, or else made now: by one thread, while others that want the same wait for it."""
        key = kind, where
        while True:
            with self._holding:
                found = self._held.get(key)
                if found is not None:
                    self._held.move_to_end(key)
                    return found
                others = self._in_work.get(key)
                if others is None:
                    done = self._in_work[key] = threading.Event()
                    made_of = self._n_followed
                    break
            others.wait()
        try:
            found = make(where)
            with self._holding:
                if made_of == self._n_followed:  # else it may be of before the history grew
                    self._hold(key, found)
            return found
        finally:
            with self._holding:
                del self._in_work[key]
            done.set()

    def _hold(self, key: tuple[str, Where], found: Cells | States | Looks) -> None:
        self._held[key] = found
        self.held_bytes += found.nbytes
        if isinstance(found, Cells):
            self._newest[key[1]] = int(found.last.max(initial=-1))
        while self.held_bytes > self.budget_bytes and len(self._held) > 1:
            self.held_bytes -= self._held.popitem(last=False)[1].nbytes

    def _read_cells(self, where: Where) -> Cells:
        rows, cols = self._tiles.positions(where)
        return _cells_of(rows, cols, *self._read(rows, cols))

    def _pool_states(self, where: Where) -> States:
        return States(*_pooled(pool_largest, [self.states(quarter) for quarter in where.quarters], NOTHING))

    def _pool_looks(self, where: Where) -> Looks:
        return Looks(*_pooled(pool_looks, [self.looks(quarter) for quarter in where.quarters]))

    def _last_looks(self, where: Where) -> Looks:
        cells = self.cells(where)
        offsets = np.zeros(PIXELS + 1, dtype=np.int32)
        since, last = np.empty_like(cells.first), np.empty_like(cells.last)
        n = last_looks_while_occupied(*cells, offsets, since, last)
        return Looks(offsets, since[:n].copy(), last[:n].copy())

    def _pool_last_looks(self, where: Where) -> Looks:
        return Looks(*_pooled(pool_largest, [self.occupied(quarter) for quarter in where.quarters], NEVER))


def _at_all_zooms(blocks: Iterable[Where]) -> set[Where]:
    """Some blocks of the lowest zoom, and those above that show them."""
    known = set(blocks)
    above = known
    for z in range(1, MOST_ZOOMS + 1):
        above = {Where(z, where.row >> 1, where.col >> 1) for where in above}
        known |= above
    return known


def _cells_of(
    rows: NDArray[np.int32], cols: NDArray[np.int32], numbers: NDArray[np.int32], sets: list[Runs]
) -> Cells:
    """The intervals of a block's tiles, at some rows and cols, by the numbers that the tiles have in some sets."""
    order = np.argsort(numbers)
    order = order[np.searchsorted(numbers, 0, sorter=order) :]  # without those that the history has not yet
    tiles, pixels = numbers[order], _pixels(rows[order], cols[order])
    places = np.zeros(PIXELS + 1, dtype=np.int64)
    for runs in sets:
        count_intervals(runs.cells, runs.offsets, tiles, pixels, places)
    np.cumsum(places, out=places)
    n = int(places[-1])
    offsets = places.astype(np.int32)
    first, last, state = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.uint8)
    for runs in sets:
        take_intervals(*runs, tiles, pixels, OCCUPIED_ABOVE, places, first, last, state)
    return Cells(offsets, first, last, state)


def _pooled(pool: Callable[..., int], quarters: Sequence[States | Looks], *more: int) -> tuple[NDArray[Any], ...]:
    """The lists of a block that a kernel, which may take more than them, makes of those of its quarters."""
    lengths: list[NDArray[np.int32]] = []
    columns: list[tuple[NDArray[Any], NDArray[Any]]] = []
    for quarter in quarters:
        offsets = np.zeros(PIXELS // 4 + 1, dtype=np.int32)
        scans, values = np.empty_like(quarter[1]), np.empty_like(quarter[2])
        n = pool(*quarter, *more, offsets, scans, values)
        lengths.append(np.diff(offsets))
        columns.append((scans[:n], values[:n]))
    offsets = np.append(0, np.cumsum(np.concatenate(lengths))).astype(np.int32)
    return offsets, *(np.concatenate([column[k] for column in columns]) for k in (0, 1))
