"""Known objects, followed scan by scan: where each is now, what just moved, who walks by. In bounded memory."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog._arrays import grown
from tempog.analysis.configurations import PlaceState
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.high_dynamic import HighDynamic, near_cells
from tempog.analysis.static import CellClass
from tempog.errors import ConfigError, ScanError
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.scans.scan import Scan
from tempog.sensing.evidence import Sensor
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import TileIndex
from tempog.times import NS_PER_S

NOWHERE = -1  # a cell that belongs to no place
UNKNOWN, FREE, OCCUPIED = -1, 0, 1
NAMES: dict[int, PlaceState] = {FREE: "free", OCCUPIED: "occupied"}
MOST_SECONDS = 3600.0


class PlaceEvent(NamedTuple):
    """A place of an object was found in another state than before, or seen for the first time.

    `confidence` is the share of the place's cells seen that say so, in the scan that settled it.
    """

    stamp_ns: int
    object_id: int
    configuration_id: int
    state: Literal["occupied", "free"]
    confidence: float


class ObjectTracker:
    """Keeps the states of known objects while scans come in.

    Memory grows with the area that is driven through, not with time: no history is kept.

    Parameters
    ----------
    found : FoundObjects
        What to follow, from `find_objects`; its settings of `seen_share` and `near_m` hold here, too.
    confirm_s : float, seconds
        For how long a place must be seen in another state before it counts: a door takes a second to swing, and
        people lean into doorways.

    Raises
    ------
    ConfigError
        `confirm_s` is negative or too long.

    Examples
    --------
    >>> from tempog import build_grid, find_objects
    >>> from tempog.simulation import corridor, simulate
    >>> scans = simulate(corridor()).scans
    >>> tracker = ObjectTracker(find_objects(build_grid(scans)))
    >>> events = [event for scan in scans for event in tracker.update(scan)]
    >>> tracker.where(1), tracker.state(1), [event.state for event in events if event.configuration_id == 1][-2:]
    (1, 'occupied', ['free', 'occupied'])
    """

    def __init__(self, found: FoundObjects, confirm_s: float = 0.5) -> None:
        if not 0 <= confirm_s <= MOST_SECONDS:
            raise ConfigError(f"confirm_s = {confirm_s!r} cannot work; wanted seconds from 0 to {MOST_SECONDS:g}")
        history, tiles = found.history, found.history.tiles
        self.found = found
        self._confirm_ns = round(confirm_s * NS_PER_S)
        self._sensor = Sensor(history.config)
        used = slice(0, tiles.n_tiles)
        self.tiles = TileIndex.from_tiles(tiles.spec, tiles.max_cells, tiles.tile_rows[used], tiles.tile_cols[used])
        self.surfaces = SurfaceMemory()
        near_m = found.settings.near_m
        static = tiles.from_dense(found.walls) == CellClass.STATIC
        self._near_static = near_cells(history, static, near_m)
        self._place = np.full(tiles.n_cells, NOWHERE, dtype=np.int32)
        self._near_place = np.full(tiles.n_cells, NOWHERE, dtype=np.int32)
        for k, place in enumerate(found.configurations):
            mine = np.zeros(tiles.n_cells, dtype=np.bool_)
            mine[[tiles.cell_number(row, col) for row, col in place.cells.tolist()]] = True
            self._place[mine] = k
            self._near_place[near_cells(history, mine, near_m) & (self._near_place == NOWHERE)] = k
        self._owner = {place.id: one.id for one in found.objects for place in one.configurations}
        self._size = np.array([len(place.cells) for place in found.configurations], dtype=np.int64)
        n_places = len(found.configurations)
        self._state, self._doubted = (np.full(n_places, UNKNOWN, dtype=np.int8) for _ in range(2))
        self._since_ns, self._seen_ns = (np.zeros(n_places, dtype=np.int64) for _ in range(2))
        self._last_ns: int | None = None
        self.high_dynamic = HighDynamic(0, np.empty((0, 2), np.int32), np.empty((0, 2)))

    def update(self, scan: Scan) -> list[PlaceEvent]:
        """Take a scan in; returns what it settled. `high_dynamic` then says what was on the move in it.

        Raises
        ------
        ScanError
            The scan is earlier than the one before.
        ExtentError
            It lies absurdly far off.
        """
        if self._last_ns is not None and scan.stamp_ns < self._last_ns:
            raise ScanError(
                f"{scan.label or 'the scan'} at {scan.t:.3f} s is {(self._last_ns - scan.stamp_ns) / NS_PER_S:.3f} s"
                " earlier than the one before; a tracker takes scans in time order"
            )
        cells, prob = self._sensor.sense(scan, self.tiles, self.surfaces)
        self._last_ns = scan.stamp_ns
        if self.tiles.n_cells > len(self._place):
            self._place = grown(self._place, self.tiles.n_cells, fill=NOWHERE)
            self._near_place = grown(self._near_place, self.tiles.n_cells, fill=NOWHERE)
            self._near_static = grown(self._near_static, self.tiles.n_cells, fill=False)
        hit = prob > OCCUPIED_ABOVE
        events = self._settle(scan.stamp_ns, self._place[cells], hit)
        near = self._near_place[cells]
        empty = np.append((self._state == FREE) & (self._doubted != OCCUPIED), True)  # the last is for NOWHERE
        moving = cells[hit & ~self._near_static[cells] & empty[near]]
        rows, cols = self.tiles.rows_cols(moving)
        order = np.lexsort((cols, rows))
        places = np.stack([rows, cols], axis=-1)[order]
        points = self.tiles.spec.centres(places[:, 0], places[:, 1])
        self.high_dynamic = HighDynamic(scan.stamp_ns, places, points)
        return events

    def _settle(self, stamp_ns: int, place: NDArray[np.int32], hit: NDArray[np.bool_]) -> list[PlaceEvent]:
        known = place != NOWHERE
        seen = np.bincount(place[known], minlength=len(self._size))
        hits = np.bincount(place[known & hit], minlength=len(self._size))
        events = []
        share = self.found.settings.seen_share
        for k in np.flatnonzero((seen > 0) & (seen >= share * self._size)).tolist():
            state = OCCUPIED if 2 * hits[k] > seen[k] else FREE
            self._seen_ns[k] = stamp_ns
            if state == self._state[k]:
                self._doubted[k] = UNKNOWN
                continue
            if state != self._doubted[k]:
                self._doubted[k], self._since_ns[k] = state, stamp_ns
            if stamp_ns - self._since_ns[k] >= self._confirm_ns:
                self._state[k], self._doubted[k] = state, UNKNOWN
                agree = float(hits[k] / seen[k])
                one = self.found.configurations[k]
                owner = self._owner.get(one.id, 0)
                confidence = agree if state == OCCUPIED else 1 - agree
                events.append(PlaceEvent(stamp_ns, owner, one.id, NAMES[state], confidence))
        return events

    def state(self, configuration_id: int) -> PlaceState | None:
        """What a place was last seen as; None before it was seen."""
        return NAMES.get(int(self._state[self._index(configuration_id)]))

    def last_seen_ns(self, configuration_id: int) -> int | None:
        """When enough of a place was seen last; None before."""
        k = self._index(configuration_id)
        return int(self._seen_ns[k]) if self._state[k] != UNKNOWN or self._doubted[k] != UNKNOWN else None

    def where(self, object_id: int) -> int | None:
        """The id of the place that an object was seen in last; None if it was seen in none, or has left it since."""
        for one in self.found.objects:
            if one.id == object_id:
                there = [place.id for place in one.configurations if self.state(place.id) == "occupied"]
                return max(there, key=lambda place: self._seen_ns[self._index(place)], default=None)
        raise ConfigError(f"there is no object {object_id}; wanted one of {[one.id for one in self.found.objects]}")

    def _index(self, configuration_id: int) -> int:
        for k, place in enumerate(self.found.configurations):
            if place.id == configuration_id:
                return k
        ids = [place.id for place in self.found.configurations]
        raise ConfigError(f"there is no place {configuration_id}; wanted one of {ids}")
