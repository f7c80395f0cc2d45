"""What of the truth could be seen: in how many periods a place was seen occupied, and in how many free.

A thing's place is *occupied* while the thing rests there and *free* while it rests elsewhere; while it moves,
neither is said. A period of a place is the longest time without the other state. Beams are the true ones, without
noise and drop-outs; cells are those of one resolution.

- The seen cells of a place are those that it covers and in which a beam ended on the thing resting there.
- It was seen occupied in a period if `SEEN_BEAMS` beams or more ended on it, in `SEEN_SHARE` or more of its seen
  cells, or in as many cells as make `SEEN_M`.
- It was seen free in a period if `SEEN_BEAMS` beams or more crossed seen cells of it and ended on something behind
  them, together in `SEEN_SHARE` or more of its seen cells. Beams without return tell nothing: a dark wall or a
  drop-out looks the same.
- It is observable if its seen cells make `SPECK_M` or more, and it was seen occupied in one period or more, and
  free in one or more. Whoever misses another place could not have known better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tempog.simulation.cell_sets import cell_keys, cells_at, contained, unique_cells
from tempog.simulation.polygons import covered_cells
from tempog.simulation.simulation import MOVING
from tempog.simulation.truth import Truth

SEEN_BEAMS = 3  # beams; a single one may have slipped past an edge
SEEN_SHARE = 0.3  # of a place's seen cells; as much as configurations need before their state counts
SEEN_M = 0.3  # m of cells side by side; a third of a leaf, one face of a box
SPECK_M = 0.15  # m of cells; a place seen edge-on, through a gap, shows less
WIDER = 1.001  # rounding must not put a cell outside the circle around it


@dataclass(frozen=True, eq=False)
class SeenPlace:
    """A place of a thing, and what of it was seen.

    Attributes
    ----------
    thing : int
        Which of `Truth.things`.
    place : int
        Which of its places.
    covered, seen : (n_cells, 2) int64
        [row, col], sorted: the cells it covers, and those of them that were seen.
    n_occupied, n_free : int
        In how many periods it was seen occupied, and free.
    observable : bool
    """

    thing: int
    place: int
    covered: NDArray[np.int64]
    seen: NDArray[np.int64]
    n_occupied: int
    n_free: int
    observable: bool


def seen_places(truth: Truth, resolution_m: float) -> list[SeenPlace]:
    """Every place of every thing, with what of it was seen; see the top of this module.

    Parameters
    ----------
    truth : Truth
        Of a whole log or a window of it.
    resolution_m : float, metres

    Returns
    -------
    list of SeenPlace
        Also those of which nothing was seen; by thing, then place.

    Examples
    --------
    >>> from tempog.simulation import load_world, simulate
    >>> truth = Truth.of(simulate(load_world("hallway"), duration_s=120.0))
    >>> places = seen_places(truth, 0.05)
    >>> len(places), all(place.n_occupied and place.n_free for place in places if place.observable)
    (17, True)
    """
    from tempog.simulation.crossing import count_crossings

    x, y, angle = truth.beams()
    cos, sin = np.cos(angle), np.sin(angle)
    reach = np.where(np.isfinite(truth.distances), truth.distances, 0.0)  # without return: crosses nothing
    found = []
    for k, thing in enumerate(truth.things):
        scans, beams = np.nonzero(truth.hit_things == k)
        ends = cells_at(truth.ends(scans, beams), resolution_m)
        stood_at = truth.places[scans, k]
        for p, corners in enumerate(thing.places.values()):
            covered = covered_cells(corners, resolution_m)
            on_it = (stood_at == p) & contained(ends, covered)
            seen = unique_cells(ends[on_it])
            if not len(seen):
                found.append(SeenPlace(k, p, covered, seen, 0, 0, False))
                continue
            occupied, free = place_periods(truth.places[:, k], p)

            period = occupied[scans[on_it]]
            n_periods = int(occupied.max()) + 1
            touched = np.zeros((n_periods, len(seen)), dtype=np.bool_)
            touched[period, np.searchsorted(cell_keys(seen), cell_keys(ends[on_it]))] = True
            n_touched = touched.sum(axis=1)
            wide = (n_touched >= SEEN_SHARE * len(seen)) | (n_touched * resolution_m >= SEEN_M)
            n_occupied = int(np.count_nonzero(wide & (np.bincount(period, minlength=n_periods) >= SEEN_BEAMS)))

            n_periods = int(free.max()) + 1
            crossed = np.zeros((n_periods, len(seen)), dtype=np.bool_)
            n_beams = np.zeros(n_periods, dtype=np.int64)
            low = np.multiply(seen[:, ::-1], resolution_m, dtype=np.float64)
            middle = (low.min(axis=0) + low.max(axis=0) + resolution_m) / 2
            radius = float(np.hypot(*(low.max(axis=0) + resolution_m - middle))) * WIDER
            side = float(resolution_m)
            count_crossings(x, y, cos, sin, reach, free, low, side, middle, radius, crossed, n_beams)
            wide = crossed.sum(axis=1) >= SEEN_SHARE * len(seen)
            n_free = int(np.count_nonzero(wide & (n_beams >= SEEN_BEAMS)))

            observable = n_occupied > 0 and n_free > 0 and len(seen) * resolution_m >= SPECK_M
            found.append(SeenPlace(k, p, covered, seen, n_occupied, n_free, observable))
    return found


def place_periods(stands_at: NDArray[np.int16], place: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Per scan, the number of the period in which the place is occupied, and in which it is free; -1 in none.

    >>> occupied, free = place_periods(np.array([0, -1, 0, -1, 1, -1, 2, 0]), 0)
    >>> occupied.tolist(), free.tolist()
    ([0, -1, 0, -1, -1, -1, -1, 1], [-1, -1, -1, -1, 0, -1, 0, -1])
    """
    occupied, free = (np.full(len(stands_at), -1, dtype=np.int64) for _ in range(2))
    rests = np.flatnonzero(stands_at != MOVING)
    there = stands_at[rests] == place
    for periods, state in ((occupied, there), (free, ~there)):
        begins = state & ~np.append(False, state[:-1])
        periods[rests[state]] = (np.cumsum(begins) - 1)[state]
    return occupied, free
