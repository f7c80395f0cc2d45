"""What the server knows of the map that it shows: the newest version, and what was worked out for it."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import OrderedDict
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.errors import TempogError
from tempog.grid.history import History
from tempog.grid.segments import Runs
from tempog.methods import Method
from tempog.sensing.grid_spec import Extent
from tempog.sensing.tiles import NO_TILE, TileIndex
from tempog.times import NS_PER_S
from tempog.views.web.blocks import MOST_ZOOMS, SIDE, Blocks, TilesOfBlocks, Where, numbers_at
from tempog.views.web.finding import Finder, Findings
from tempog.views.web.layers import Theme, palette
from tempog.views.web.png import encode_png
from tempog.views.web.prepared import Prepared, prepare, visits_codes
from tempog.views.web.sources import Source
from tempog.views.web.tiles import (
    Codes,
    MomentScans,
    Pyramid,
    age_codes,
    fade_s,
    occupancy_codes,
    scans_at,
    seen_codes,
)

BLOCK_BYTES = 768 * 2**20  # of blocks in memory: a site of 4 million cells with 20 intervals each
PICTURE_BYTES = 64 * 2**20  # of encoded tiles: some thousand
BYTES_PER_INTERVAL = 9
OPEN_S = 30.0  # that the whole map stays open for the next long question
LEAST_AGAIN_S = 20.0  # between two times that something of the whole map is worked out
SHARE_OF_TIME = 0.05  # of the time spent on that, at most

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Version:
    """A version of the map.

    Attributes
    ----------
    name : str
    stamps_ns : (n_scans,) int64
    extent : Extent
    n_cells, n_intervals : int
    n_zooms : int
        At the highest one, the whole map fits into few tiles.
    """

    name: str
    stamps_ns: NDArray[np.int64]
    extent: Extent
    n_cells: int
    n_intervals: int
    n_zooms: int

    @property
    def start_ns(self) -> int:
        """Stamp of the first scan; 0 without one."""
        return int(self.stamps_ns[0]) if len(self.stamps_ns) else 0

    @property
    def duration_s(self) -> float:
        """From the first scan to the last."""
        return float(self.stamps_ns[-1] - self.stamps_ns[0]) / NS_PER_S if len(self.stamps_ns) else 0.0


class AskedTile(NamedTuple):
    """A tile that somebody wants; `key` tells it from all that look different."""

    layer: str
    where: Where
    theme: Theme
    moment: MomentScans | None
    key: tuple[Any, ...]


class Pictures:
    """Encoded tiles, the latest asked for, up to a number of bytes."""

    def __init__(self, budget_bytes: int) -> None:
        self.budget_bytes, self.held_bytes = budget_bytes, 0
        self._held: OrderedDict[object, bytes] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: object) -> bytes | None:
        """A tile, if it is there."""
        with self._lock:
            found = self._held.get(key)
            if found is not None:
                self._held.move_to_end(key)
            return found

    def put(self, key: object, picture: bytes) -> None:
        """Keep a tile."""
        with self._lock:
            if key not in self._held:
                self._held[key] = picture
                self.held_bytes += len(picture)
            while self.held_bytes > self.budget_bytes:
                self.held_bytes -= len(self._held.popitem(last=False)[1])


class Model:
    """The map of a source, in the form that pictures and answers are made from.

    Parameters
    ----------
    source : Source
    method : str
        How objects are found, see `find_objects`.
    block_bytes, picture_bytes : int
        What may be held of blocks and of encoded tiles.

    Attributes
    ----------
    version : Version
        The newest one.
    blocks : Blocks
    finder : Finder
    asking : threading.Lock
        Held while `whole` is asked something.
    """

    def __init__(
        self,
        source: Source,
        method: Method = "evidence",
        *,
        block_bytes: int = BLOCK_BYTES,
        picture_bytes: int = PICTURE_BYTES,
    ) -> None:
        self.source = source
        self.finder = Finder(source, method)
        self.pictures = Pictures(picture_bytes)
        self._block_bytes = block_bytes
        self.asking = threading.Lock()
        self._changing = threading.Lock()  # never held while something is read: requests wait for it
        self._opening = threading.Lock()
        self._prepared: Future[Prepared] | None = None
        self._ready: Prepared | None = None
        self._prepared_s, self._preparing_took_s = -math.inf, 0.0
        self._walked: tuple[str, Pyramid, int] | None = None
        self._moving: tuple[str, Blocks] | None = None
        self._opened: History | None = None
        self._opened_name, self._opened_s = "", time.monotonic()
        with source.lock:
            self.version, self._config = self._version_now(), source.history().config
            tiles = TilesOfBlocks(source.history().tiles)
        self.blocks = Blocks(tiles, self._read, block_bytes)

    # The map.

    def look(self) -> bool:
        """See whether the map grew, and follow it if so."""
        if not self.source.look():
            return False
        with self.source.lock:
            history = self.source.history()
            before, now = self.version, self._version_now()
            same, self._config = history.config == self._config, history.config
            tiles = TilesOfBlocks(history.tiles)
            latest = list(history.latest_runs(history.last_scan)) if history.n_scans else []
        n = len(before.stamps_ns)
        if same and len(now.stamps_ns) > n and np.array_equal(now.stamps_ns[:n], before.stamps_ns):
            self.blocks.follow(tiles, latest)
        else:  # its scans are numbered anew, or the map was made anew of the same scans
            self.blocks = Blocks(tiles, self._read, self._block_bytes)
        self.version = now
        return True

    def tidy(self) -> None:
        """Let go of what was opened for a long question, if that was a while ago."""
        with self._opening:
            if time.monotonic() - self._opened_s > OPEN_S:
                self._opened = None

    def whole(self) -> History:
        """The map for long questions: of the newest version or, while it is being mapped, what was committed of it.

        What it reads stays in memory until nobody asked for a while.
        """
        return self._whole(self.version.name)

    def _whole(self, name: str) -> History:
        with self._opening:
            if self._opened is None or self._opened_name != name:
                self._opened, self._opened_name = self.source.apart(), name
            self._opened_s = time.monotonic()
            return self._opened

    def _version_now(self) -> Version:
        source = self.source
        history = source.history()
        extent = history.extent
        side = max(extent.n_rows, extent.n_cols, 1)
        n_zooms = min(max(math.ceil(math.log2(side / SIDE)), 0), MOST_ZOOMS) + 1
        # Strands that are merged are read for this, and should be let go of.
        counted = history if source.live else self._whole(source.version)
        counts = counted.n_cells, counted.n_intervals
        return Version(source.version, history.stamps_ns.copy(), extent, *counts, n_zooms)

    def _read(self, rows: NDArray[np.int32], cols: NDArray[np.int32]) -> tuple[NDArray[np.int32], list[Runs]]:
        """What `Blocks` reads; numbers and intervals of one moment, as both may change while a robot maps."""
        with self.source.lock:
            history = self.source.history()
            numbers = numbers_at(history.tiles, rows, cols)
            return numbers, list(history.runs_of_tiles(np.sort(numbers[numbers != NO_TILE])))

    def warm_up(self) -> None:
        """Compile the kernels, read the map and begin to find objects; in a thread of its own."""
        threading.Thread(target=self._warm_up, name="tempog reads the map", daemon=True).start()

    def _warm_up(self) -> None:
        try:
            # All at once is read faster, but a robot that maps would have to wait until it is done.
            if not self.source.live and self.version.n_intervals * BYTES_PER_INTERVAL < self._block_bytes:
                self.blocks.take_all(self._read_all)
            moment = self.moment(self.version.duration_s, math.inf)
            for where in {Where(z, w.row >> z, w.col >> z) for w in self.blocks.where for z in [self.top_zoom]}:
                occupancy_codes(self.blocks, where, moment)
                age_codes(self.blocks, where, moment)
            self.prepared().exception()
        except (TempogError, OSError, MemoryError) as error:
            _log.warning("the map could not be read ahead: %s", error)
        finally:
            self.finder.start()

    def _read_all(self) -> tuple[TileIndex, list[Runs]]:
        with self.source.lock:
            history = self.source.history()
            if len(self.whole().stamps_ns) == len(history.stamps_ns):
                history = self.whole()  # which is let go of, and is the same unless it grew just now
            return history.tiles, list(history.runs())

    @property
    def top_zoom(self) -> int:
        """The highest zoom."""
        return self.version.n_zooms - 1

    def moment(self, t: float, hold_s: float) -> MomentScans:
        """A moment, in seconds since the first scan, by the numbers of scans."""
        version = self.version
        return scans_at(version.stamps_ns, self.stamp_ns(t), hold_s, fade_s(version.duration_s))

    def stamp_ns(self, t: float) -> int:
        """A moment in nanoseconds; the farthest that can be said for one out of range."""
        return int(min(max(self.version.start_ns + round(t * NS_PER_S), -(2**62)), 2**62))

    # Layers of the whole period.

    def prepared(self) -> Future[Prepared]:
        """What is worked out for the whole map; of an earlier version, while that is not long ago."""
        with self._changing:
            now_s = time.monotonic()
            patience_s = max(LEAST_AGAIN_S, self._preparing_took_s / SHARE_OF_TIME)
            done = self._prepared is not None and self._prepared.done()
            old = self._ready is None or self._ready.version != self.version.name
            if self._prepared is None or (done and old and now_s - self._prepared_s > patience_s):
                future: Future[Prepared] = Future()
                self._prepared, self._prepared_s = future, now_s
                threading.Thread(target=self._prepare, args=[future], name="tempog prepares", daemon=True).start()
            if self._ready is not None and not self._prepared.done():
                ready: Future[Prepared] = Future()
                ready.set_result(self._ready)
                return ready
            return self._prepared

    def _prepare(self, future: Future[Prepared]) -> None:
        version = self.version
        begin_s = time.monotonic()
        try:
            with self.asking:
                prepared = prepare(self.whole(), version.n_zooms, version.name)
        except Exception as error:  # whoever waits for it is told
            future.set_exception(error)
            return
        self._preparing_took_s = time.monotonic() - begin_s
        self._ready = prepared
        future.set_result(prepared)

    # What follows from the objects.

    def findings(self) -> Findings | None:
        """The objects, if they are found; of an earlier version of the map, while that is not long ago."""
        finder = self.finder
        findings = finder.findings
        patience_s = max(LEAST_AGAIN_S, finder.took_s / SHARE_OF_TIME)
        is_old = finder.state in ("ready", "failed") and finder.tried != self.version.name
        if finder.state == "idle" or (is_old and time.monotonic() - finder.ended_s > patience_s):
            finder.start()
        return findings

    def walked(self) -> tuple[Pyramid, int] | None:
        """Where people walk, and how often the cell was come to where most walk; None before it is known."""
        findings = self.findings()
        if findings is None:
            return None
        if self._walked is None or self._walked[0] != findings.version:
            most = max(int(findings.n_visits.max(initial=0)), 1)
            pyramid = Pyramid.of(visits_codes(findings.n_visits, most), findings.found.extent, self.version.n_zooms)
            self._walked = findings.version, pyramid, most
        return self._walked[1], self._walked[2]

    def moving(self) -> Blocks | None:
        """When something on the move was where; None before it is known."""
        findings = self.findings()
        if findings is None:
            return None
        if self._moving is None or self._moving[0] != findings.version:
            moving, tiles = [findings.moving], findings.found.history.tiles

            def read(rows: NDArray[np.int32], cols: NDArray[np.int32]) -> tuple[NDArray[np.int32], list[Runs]]:
                return numbers_at(tiles, rows, cols), moving

            self._moving = findings.version, Blocks(TilesOfBlocks(tiles), read, self._block_bytes // 8)
        return self._moving[1]

    # Pictures.

    def tile(self, layer: str, where: Where, theme: Theme, t: float | None, hold_s: float) -> bytes:
        """A tile as PNG; the empty one where there is nothing to show."""
        asked = self.asked(layer, where, theme, t, hold_s)
        return self.recalled(asked) or self.rendered(asked)

    def asked(self, layer: str, where: Where, theme: Theme, t: float | None, hold_s: float) -> AskedTile:
        """A tile of this version, at a moment in seconds since the first scan; by default at the last scan."""
        version = self.version
        moment = None
        key: tuple[Any, ...] = (version.name, layer, where, theme)
        if layer in ("occupancy", "age", "people-now"):
            moment = self.moment(version.duration_s if t is None else t, hold_s)
            key += (moment.until, moment.oldest) if layer != "age" else (moment.until, *moment.ages.tolist())
        if layer in ("people", "people-now"):
            findings = self.findings()
            key += (findings.version if findings else None,)
        elif moment is None:
            key += (self._ready.version if self._ready else None,)
        return AskedTile(layer, where, theme, moment, key)

    def recalled(self, asked: AskedTile) -> bytes | None:
        """A tile, if it takes no work."""
        if self.blocks.is_empty(asked.where):
            return EMPTY_TILE
        return self.pictures.get(asked.key)

    def rendered(self, asked: AskedTile) -> bytes:
        """A tile that is made now; those of the whole period wait until that is `prepared`."""
        codes = self._codes(asked.layer, asked.where, asked.moment)
        picture = EMPTY_TILE if codes is None else encode_png(codes, palette(asked.layer, asked.theme))
        self.pictures.put(asked.key, picture)
        return picture

    def spanned(self, asked: AskedTile, n_cols: int, n_rows: int) -> bytes:
        """Several tiles as one picture, which is not kept: the one asked for, and those to the east and the north."""
        whole = np.zeros((n_rows * SIDE, n_cols * SIDE), dtype=np.uint8)
        z, south, west = asked.where
        for row in range(n_rows):
            top = (n_rows - 1 - row) * SIDE
            for col in range(n_cols):
                codes = self._codes(asked.layer, Where(z, south + row, west + col), asked.moment)
                if codes is not None:
                    whole[top : top + SIDE, col * SIDE : (col + 1) * SIDE] = codes
        return encode_png(whole, palette(asked.layer, asked.theme))

    def _codes(self, layer: str, where: Where, moment: MomentScans | None) -> Codes | None:
        if layer == "people":
            walked = self.walked()
            return walked[0].codes(where) if walked is not None and where.z < len(walked[0].levels) else None
        if moment is None:
            layers = self.prepared().result().layers
            return layers[layer].codes(where) if where.z < len(layers[layer].levels) else None
        if layer == "occupancy":
            return occupancy_codes(self.blocks, where, moment)
        if layer == "age":
            return age_codes(self.blocks, where, moment)
        moving = self.moving()
        return seen_codes(moving, where, moment.until) if moving is not None else None

    def is_settled(self, layer: str) -> bool:
        """Whether a layer's tiles are those of this version, and not of an earlier one that stands in for it."""
        if layer in ("people", "people-now"):
            return self.finder.findings is not None and self.finder.findings.version == self.version.name
        if layer in ("static", "dynamics"):
            return self._ready is not None and self._ready.version == self.version.name
        return True

    def close(self) -> None:
        """Stop what runs in the background."""
        self.finder.close()


EMPTY_TILE = encode_png(np.zeros((SIDE, SIDE), dtype=np.uint8), [(0, 0, 0, 0)])
