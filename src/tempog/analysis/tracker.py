"""Known objects, followed scan by scan: where each is now, what just moved, who walks by. In bounded memory."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog._arrays import grown
from tempog.analysis.configurations import PlaceState
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.high_dynamic import HighDynamic
from tempog.analysis.learn_area import Learned, NextIds, learn_area
from tempog.analysis.static import CellClass
from tempog.analysis.unexplained import Unexplained
from tempog.errors import ConfigError, ScanError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.scans.scan import Scan
from tempog.sensing.evidence import Sensor
from tempog.sensing.grid_spec import Bounds
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import NO_CELL, TileIndex
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

    Memory grows with the area that is driven through, not with time: no history is kept. What it does not know it
    finds where a grid keeps the history beside it: `due` names the areas that scans contradict, `learn` has one
    analysed again.

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

    A door that nobody saw move before is learned on the way:

    >>> from tempog import TemporalGrid
    >>> grid = TemporalGrid(scan_period_s=0.1)
    >>> grid.integrate_many(scans[:120])
    >>> tracker = ObjectTracker(find_objects(grid))
    >>> for k, scan in enumerate(scans[120:]):
    ...     grid.integrate(scan)
    ...     events = tracker.update(scan)
    ...     for area in tracker.due() if k % 100 == 99 else []:
    ...         learned = tracker.learn(grid, area)
    ...         if learned.new_objects:
    ...             print(grid.format_moment(scan.stamp_ns), area, learned.new_objects)
    2025-06-15 15:07:41 UTC (+61.9 s) x 7.18 to 7.68 m, y 2.68 to 3.68 m (1,)
    """

    def __init__(self, found: FoundObjects, confirm_s: float = 0.5) -> None:
        if not 0 <= confirm_s <= MOST_SECONDS:
            raise ConfigError(f"confirm_s = {confirm_s!r} cannot work; wanted seconds from 0 to {MOST_SECONDS:g}")
        tiles = found.history.tiles
        self._confirm_ns = round(confirm_s * NS_PER_S)
        self._sensor = Sensor(found.history.config)
        used = slice(0, tiles.n_tiles)
        self.tiles = TileIndex.from_tiles(tiles.spec, tiles.max_cells, tiles.tile_rows[used], tiles.tile_cols[used])
        self.surfaces = SurfaceMemory()
        self._unexplained = Unexplained()
        self._ids = NextIds(
            max((place.id for place in found.configurations), default=0) + 1,
            max((one.id for one in found.objects), default=0) + 1,
        )
        self._state = self._doubted = np.empty(0, dtype=np.int8)
        self._since_ns = self._seen_ns = np.empty(0, dtype=np.int64)
        self._follow(found)
        self._last_ns: int | None = None
        self.high_dynamic = HighDynamic(0, np.empty((0, 2), np.int32), np.empty((0, 2)))

    def _follow(self, found: FoundObjects) -> None:
        """Mark the cells of walls and places, and lay out the places' states; the caller fills these in."""
        self.found = found
        tiles, near_m = self.tiles, found.settings.near_m
        self._static = np.zeros(tiles.n_cells, dtype=np.bool_)
        self._near_static = np.zeros(tiles.n_cells, dtype=np.bool_)
        self._place = np.full(tiles.n_cells, NOWHERE, dtype=np.int32)
        self._near_place = np.full(tiles.n_cells, NOWHERE, dtype=np.int32)
        corner = np.array([found.extent.row0, found.extent.col0])
        static, glass = (
            np.argwhere(found.walls == what) + corner for what in (CellClass.STATIC, CellClass.UNCERTAIN)
        )
        self._static[self._numbers(static)] = True
        self._near_static[self._numbers(np.concatenate([static, glass]), near_m)] = True
        for k, place in enumerate(found.configurations):
            self._place[self._numbers(place.cells)] = k
            near = self._numbers(place.cells, near_m)
            self._near_place[near[self._near_place[near] == NOWHERE]] = k
        self._owner = {place.id: one.id for one in found.objects for place in one.configurations}
        self._size = np.array([len(place.cells) for place in found.configurations], dtype=np.int64)
        n_places = len(found.configurations)
        self._state, self._doubted = (np.full(n_places, UNKNOWN, dtype=np.int8) for _ in range(2))
        self._since_ns, self._seen_ns = (np.zeros(n_places, dtype=np.int64) for _ in range(2))

    def _numbers(self, cells: NDArray[np.int32] | NDArray[np.int64], near_m: float = 0.0) -> NDArray[np.int32]:
        """Numbers of some cells, (n, 2) row and col, and of those whose centres are near; unknown ones left out."""
        reach = near_m / self.tiles.spec.resolution_m + 1e-9
        steps = np.arange(-int(reach), int(reach) + 1)
        up, right = (part[None] for part in np.meshgrid(steps, steps, indexing="ij"))
        within = up**2 + right**2 <= reach**2
        rows, cols = ((cells[:, k, None] + part[within]).ravel() for k, part in enumerate((up, right)))
        numbers = self.tiles.cell_numbers(rows.astype(np.int32), cols.astype(np.int32))
        return np.unique(numbers[numbers != NO_CELL])

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
            self._static = grown(self._static, self.tiles.n_cells, fill=False)
        hit = prob > OCCUPIED_ABOVE
        events = self._settle(scan.stamp_ns, self._place[cells], hit)
        near = self._near_place[cells]
        empty = np.append((self._state == FREE) & (self._doubted != OCCUPIED), True)  # the last is for NOWHERE
        strange = np.where(hit, ~self._near_static[cells] & (near == NOWHERE), self._static[cells])
        self._unexplained.look(scan.stamp_ns, self.tiles.n_cells, cells, strange)
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

    def due(self) -> list[Bounds]:
        """Areas whose walls and places explain too little of what scans say there: those to `learn` again.

        A group of cells larger than 0.3 m is due once something stood there for 20 s that was neither wall nor place,
        or repeatedly for 2 s; or once walls were seen free for as long. What was learned in vain is due after twice
        the time. Rectangles in metres, map frame; areas that were never mapped are due, too.
        """
        return self._unexplained.areas(self.tiles)

    def learn(self, history: History, area: Bounds) -> Learned:
        """Analyse one area of the history again, and follow what is found there from now on.

        What it costs follows the area, with the method's reach of some metres around it, and how often that was seen.
        Places that are found again keep their ids and states, as do their objects. A place that the history does not
        bear out any more is retired, and so is an object without places. No id is given twice.

        Parameters
        ----------
        history : History
            With the scans that made the area due: the grid that they were integrated into, or a window of it.
        area : Bounds, metres
            One of `due`, or any other.

        Returns
        -------
        Learned
            The ids that are new, and those that are retired. `found` then has all that is followed.

        Raises
        ------
        ConfigError
            `history` has cells of another size.
        EmptyWindowError
            It holds nothing of the area.
        """
        mine_m, theirs_m = self.tiles.spec.resolution_m, history.tiles.spec.resolution_m
        if mine_m != theirs_m:
            raise ConfigError(
                f"the history has cells of {theirs_m:g} m, the tracker of {mine_m:g} m; they must agree"
            )
        learned = learn_area(self.found, history, area, self._ids)
        self.adopt(learned, area)
        return learned[1]

    @property
    def ids(self) -> NextIds:
        """The lowest ids that were never given."""
        return self._ids

    def adopt(self, what: tuple[FoundObjects, Learned, NextIds], area: Bounds) -> None:
        """Follow from now on what `learn_area` says of an area: the part of `learn` that takes no time.

        Parameters
        ----------
        what : FoundObjects, Learned, NextIds
            The answer of `learn_area` for this tracker's `found` and `ids`, worked out in another process perhaps.
        area : Bounds, metres
            The one that was asked for.
        """
        before = {place.id: k for k, place in enumerate(self.found.configurations)}
        state, doubted, since_ns, seen_ns = self._state, self._doubted, self._since_ns, self._seen_ns
        found, _, self._ids = what
        self._follow(found)
        for k, place in enumerate(found.configurations):
            if place.id in before:
                was = before[place.id]
                self._state[k], self._doubted[k] = state[was], doubted[was]
                self._since_ns[k], self._seen_ns[k] = since_ns[was], seen_ns[was]
            elif place.periods:
                last = place.periods[-1]
                self._state[k], self._seen_ns[k] = OCCUPIED if last.state == "occupied" else FREE, last.stop_ns
        rows, cols = self.tiles.rows_cols(np.arange(self.tiles.n_cells, dtype=np.int32))
        inside = area.holds(self.tiles.spec.centres(rows, cols))
        self._unexplained.learned(np.flatnonzero(inside).astype(np.int32))

    @property
    def memory_bytes(self) -> int:
        """Bytes held for cells, apart from `found`; they follow the area that was seen, not time."""
        cells = (self._static, self._near_static, self._place, self._near_place)
        return (
            sum(part.nbytes for part in cells) + self.tiles.nbytes + self.surfaces.nbytes + self._unexplained.nbytes
        )

    def state(self, configuration_id: int) -> PlaceState | None:
        """What a place was last seen as; None before it was seen."""
        return NAMES.get(int(self._state[self._index(configuration_id)]))

    def last_seen_ns(self, configuration_id: int) -> int | None:
        """When enough of a place was seen last; None before."""
        k = self._index(configuration_id)
        return int(self._seen_ns[k]) if self._state[k] != UNKNOWN or self._doubted[k] != UNKNOWN else None

    def states(self) -> dict[int, tuple[PlaceState | None, int | None]]:
        """By the id of each place, what `state` and `last_seen_ns` say of it."""
        known = (self._state != UNKNOWN) | (self._doubted != UNKNOWN)
        return {
            place.id: (NAMES.get(state), seen_ns if seen else None)
            for place, state, seen_ns, seen in zip(
                self.found.configurations, self._state.tolist(), self._seen_ns.tolist(), known.tolist(), strict=True
            )
        }

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
