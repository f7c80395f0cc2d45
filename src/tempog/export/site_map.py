"""What every export begins with: the map of a site in layers, and the things in it with their states."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.objects import MovingObject, ObjectStay
from tempog.analysis.static import CellClass
from tempog.errors import EmptyWindowError, TimeError
from tempog.export.doors import Hinge, hinge_of, leaf_cells
from tempog.export.layers import (
    MOSTLY,
    Cells,
    Mask,
    cell_times,
    planning_cells,
    seen_extent,
    small_groups,
    standing_cells,
)
from tempog.export.map_server import FREE, OCCUPIED, UNKNOWN, Nav2Map
from tempog.export.passages import blocks_way
from tempog.grid.history import History
from tempog.methods import SMALLEST_M
from tempog.sensing.grid_spec import Extent
from tempog.times import Moment


@dataclass(frozen=True, eq=False)
class Thing:
    """A found object as others want to know it.

    Attributes
    ----------
    one : MovingObject
    hinge : Hinge, optional
        If its places are those of a leaf that turns; such a thing is a door.
    blocks : tuple of bool
        For each place, whether what stands there blocks a way.
    at : ObjectStay, optional
        What it was in at the moment of the export, as far as it was seen by then.
    """

    one: MovingObject
    hinge: Hinge | None
    blocks: tuple[bool, ...]
    at: ObjectStay | None

    @property
    def kind(self) -> str:
        """ "door" if it turns about a hinge, else "other"."""
        return "other" if self.hinge is None else "door"

    @property
    def share_open(self) -> float | None:
        """Share of the time it was seen in which it stood where it blocks no way, or was away.

        None if none of its places blocks one, or all of several do: then nobody can say what open is. Time in which
        it was in no clear place counts for nothing.
        """
        one = self.one
        alone = len(one.configurations) == 1
        if not any(self.blocks) or (all(self.blocks) and not alone):
            return None
        shares = one.shares
        closed = sum(
            shares[place.id] for place, blocks in zip(one.configurations, self.blocks, strict=True) if blocks
        )
        known = sum(shares[place.id] for place in one.configurations) + (shares.get(None, 0.0) if alone else 0.0)
        return 1 - closed / known if known > 0 else None

    @property
    def is_open(self) -> bool | None:
        """Whether it was open at the moment of the export; None where `share_open` is, or if never seen by then."""
        return self.is_open_in(self.at)

    def is_open_in(self, stay: ObjectStay | None) -> bool | None:
        """Whether it is open in a state: where it blocks no way, or away."""
        if stay is None or self.share_open is None:
            return None
        ids = [place.id for place in self.one.configurations]
        return stay.configuration is None or not self.blocks[ids.index(stay.configuration)]


@dataclass(frozen=True, eq=False)
class SiteMap:
    """A map in the layers that other programs want; made by `site_map`.

    Attributes
    ----------
    found : FoundObjects
    at_ns : int
        The moment of `current` and of what things are in.
    extent : Extent
        Where the layers lie: the rectangle of all cells that were seen.
    classes : (n_rows, n_cols) int8, values of `CellClass`
    share, seen_s : (n_rows, n_cols) float32, 0..1 and seconds
        For how much of the time in which the cell was seen it was occupied, and how long that was; NaN if never.
    planning : (n_rows, n_cols) int8
        What never moves, without doors, furniture and people; see `planning_cells`. All layers of cells have 0 for
        free, 100 for occupied and -1 for unknown.
    places : (n_rows, n_cols) bool
        Cells of any place of a thing.
    things : tuple of Thing
    """

    found: FoundObjects
    at_ns: int
    extent: Extent
    classes: NDArray[np.int8]
    share: NDArray[np.float32]
    seen_s: NDArray[np.float32]
    planning: Cells
    places: Mask
    things: tuple[Thing, ...]

    @property
    def history(self) -> History:
        """The period that was analysed."""
        return self.found.history

    @cached_property
    def localisation(self) -> Cells:
        """`planning`, with every known place of a thing occupied: a scan may find something there."""
        localisation = self.planning.copy()
        localisation[self.places] = OCCUPIED
        return localisation

    @cached_property
    def current(self) -> Cells:
        """`planning`, and what stood there at `at_ns` as it was last seen by then.

        Things stand in the place they were seen in last. What belongs to no thing counts if it had been watched there
        for `FOR_S`: so people are left out, and a box that came today is not.
        """
        current = self.planning.copy()
        current[standing_cells(self.history, self.at_ns, self.extent) & ~self.places] = OCCUPIED
        current[self.places & (self.planning == UNKNOWN)] = FREE
        for thing in self.things:
            for place in thing.one.configurations:
                if thing.at is not None and thing.at.configuration == place.id:
                    current[self.mask_of(place)] = OCCUPIED
        return current

    def with_shares(self, cells: Cells) -> Cells:
        """A layer in which what belongs to nothing found has the percent of the time it was occupied (mode scale)."""
        shaded = cells.copy()
        between = (self.classes == CellClass.CHANGING) & ~self.places
        shaded[between] = np.rint(OCCUPIED * self.share[between]).astype(np.int8)
        return shaded

    def mask_of(self, place: Configuration) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices into the layers of a place's cells."""
        return indices(place.cells, self.extent)

    def as_nav2(self, cells: Cells) -> Nav2Map:
        """A layer as map_server has it."""
        return Nav2Map.over(cells, self.extent)


def site_map(found: FoundObjects, at: Moment | None = None, *, doubtful_are_walls: bool = False) -> SiteMap:
    """What was found, in layers.

    Parameters
    ----------
    found : FoundObjects
        Of `find_objects`; of a window, if only that period is to count.
    at : moment, optional
        For `SiteMap.current`, and what things are in. Default: the last scan of the period.
    doubtful_are_walls : bool
        Whether things of one place that were there for half of the time or more stay in the planning map: with poses
        that disagree (`pose_consistency`) most of them are walls that were seen displaced.

    Raises
    ------
    TimeError
        `at` is before the period's first scan or after its last.
    EmptyWindowError
        Nothing was seen in the period.
    """
    history = found.history
    history.require_scans()
    first_ns, last_ns = (int(history.stamps_ns[k]) for k in (history.first_scan, history.last_scan))
    at_ns = last_ns if at is None else history.parse_moment(at)
    if not first_ns <= at_ns <= last_ns:
        raise TimeError(
            f"nothing is known of {history.format_moment(at_ns)}: the scans run from"
            f" {history.format_moment(first_ns)} to {history.format_moment(last_ns)}"
        )
    extent = seen_extent(found)
    if extent is None:
        raise EmptyWindowError("no cell was seen in this period; choose a longer one")
    classes = found.walls[extent.part_of(found.extent)].copy()
    share, seen_s = cell_times(history, extent)
    places, guessed = np.zeros(extent.shape, dtype=np.bool_), np.zeros(extent.shape, dtype=np.bool_)
    for place in found.configurations:
        places[indices(place.cells, extent)] = True
        guessed[indices(place.cells, extent)] |= place.hypothesis
    hinges = [hinge_of(one.configurations, extent.resolution_m) for one in found.objects]
    static = classes == CellClass.STATIC
    crumbs = small_groups(static, SMALLEST_M, 0.0, extent.resolution_m)
    for one, hinge in zip(found.objects, hinges, strict=True):
        if hinge is None:
            continue
        for k, place in enumerate(one.configurations):
            rows, cols = indices(leaf_cells(hinge, k, extent), extent)
            taken = (static if place.hypothesis else crumbs)[rows, cols]
            places[rows[taken], cols[taken]] = True
            guessed[rows[taken], cols[taken]] |= place.hypothesis
    planning = planning_cells(classes, share, seen_s, places, guessed, extent.resolution_m)
    if doubtful_are_walls:
        for one in found.objects:
            for place in one.configurations:
                if len(one.configurations) == 1 and one.shares[place.id] >= MOSTLY:
                    planning[indices(place.cells, extent)] = OCCUPIED
    things = tuple(
        Thing(
            one,
            hinge,
            tuple(blocks_way(planning == FREE, place.cells, extent) for place in one.configurations),
            _stay_at(one, at_ns),
        )
        for one, hinge in zip(found.objects, hinges, strict=True)
    )
    return SiteMap(found, at_ns, extent, classes, share, seen_s, planning, places, things)


def indices(cells: NDArray[np.int32], extent: Extent) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices into an array over an extent, of those of some cells, (n, 2) lattice row and col, that it holds."""
    rows, cols = cells[:, 0].astype(np.int64) - extent.row0, cells[:, 1].astype(np.int64) - extent.col0
    inside = (rows >= 0) & (rows < extent.n_rows) & (cols >= 0) & (cols < extent.n_cols)
    return rows[inside], cols[inside]


def _stay_at(one: MovingObject, at_ns: int) -> ObjectStay | None:
    """The latest stay that was seen by a moment, as it was known then."""
    stay = latest_stay(one, at_ns)
    return stay and stay._replace(stop_ns=min(stay.stop_ns, at_ns))


def latest_stay(one: MovingObject, at_ns: int) -> ObjectStay | None:
    """The latest stay that has begun by a moment."""
    stays = one.stays
    n = bisect_right(stays, at_ns, key=lambda stay: stay.start_ns)
    return stays[n - 1] if n else None
