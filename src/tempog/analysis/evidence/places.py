"""Which groups of cells are places that a thing comes to stand in, and which are people, or walls."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Period, PlaceState
from tempog.analysis.evidence.kernels import sweep_group
from tempog.analysis.evidence.known import Known, recalled
from tempog.analysis.evidence.scorecard import Traits, place_odds
from tempog.analysis.evidence.shape import ROUNDING_M, Line, fit_line
from tempog.analysis.evidence.states import CellStates
from tempog.methods import EvidenceConfig
from tempog.times import NS_PER_S

if TYPE_CHECKING:
    from tempog.analysis.evidence.elsewhere import Elsewhere

STATES: tuple[PlaceState, PlaceState] = ("free", "occupied")
# Shares of the smaller group's cells that lie along the other:
FACE = 0.5  # the far face of a leaf may be seen in part
SAME_PLACE = 0.8  # all of them but for an end: one place, seen twice
FRAGMENT = 0.2  # the short side of a box, at its corner


class Stay(NamedTuple):
    """A group's state from when it was first seen so until it was last, gaps and all.

    `observed_s` is how long of it was seen, `together` the share of the cells seen that had the group's state.
    """

    occupied: bool
    start_ns: int
    stop_ns: int
    observed_s: float
    together: float

    @property
    def lasted_s(self) -> float:
        """From first to last seen."""
        return (self.stop_ns - self.start_ns) / NS_PER_S


class PeriodArrays(NamedTuple):
    """Periods for kernels: when each began and ended, and 1 for occupied, 0 for free; each (n,)."""

    start_ns: NDArray[np.int64]
    stop_ns: NDArray[np.int64]
    state: NDArray[np.uint8]


def as_arrays(periods: Sequence[Period] | PeriodArrays) -> PeriodArrays:
    """Periods as arrays, if they are none yet."""
    if isinstance(periods, PeriodArrays):
        return periods
    start_ns, stop_ns = np.array([period[:2] for period in periods], dtype=np.int64).reshape(-1, 2).T.copy()
    return PeriodArrays(
        start_ns, stop_ns, np.array([period.state == "occupied" for period in periods], dtype=np.uint8)
    )


@dataclass(frozen=True, eq=False)
class Place:
    """A group of cells with its course of states, and what speaks for and against its being a place.

    Attributes
    ----------
    cells : (n,) int64
        Indices into `CellStates`, sorted.
    points_map : (n, 2) float64, metres
    course : PeriodArrays
        The state of most of the cells seen, while enough of them were; gaps are times without.
    stays : tuple of Stay
        Of a minimal observed time.
    log_odds : float
        That it is a place, and not people or a wall seen displaced; see `place_odds`.
    """

    cells: NDArray[np.int64]
    points_map: NDArray[np.float64]
    course: PeriodArrays
    stays: tuple[Stay, ...]
    resolution_m: float
    log_odds: float = 0.0

    @cached_property
    def centre_m(self) -> tuple[float, float]:
        """Mean x and y of the cells."""
        x, y = self.points_map.mean(axis=0).tolist()
        return x, y

    @cached_property
    def size_m(self) -> float:
        """Corner to corner of the rectangle around its cells, along the axes of the lattice."""
        return float(np.hypot(*(np.ptp(self.points_map, axis=0) + self.resolution_m)))

    @cached_property
    def line(self) -> Line:
        """The straight line that fits its cells best."""
        return fit_line(self.points_map, self.resolution_m)

    @cached_property
    def periods(self) -> tuple[Period, ...]:
        """The course as objects, which take more time to make than all else: most groups are people, of many."""
        start_ns, stop_ns, state = (part.tolist() for part in self.course)
        return tuple(map(Period, start_ns, stop_ns, [STATES[k] for k in state]))

    @cached_property
    def occupied(self) -> tuple[Stay, ...]:
        """The stays in which it was occupied."""
        return tuple(stay for stay in self.stays if stay.occupied)

    @cached_property
    def free(self) -> tuple[Stay, ...]:
        """The stays in which it was free."""
        return tuple(stay for stay in self.stays if not stay.occupied)

    @cached_property
    def n_changes(self) -> int:
        """How often its state was found to be another one."""
        return sum(stay.occupied != following.occupied for stay, following in pairwise(self.stays))

    @cached_property
    def duty(self) -> float:
        """Share of the time seen in which it was occupied."""
        occupied_s = sum(stay.observed_s for stay in self.occupied)
        return occupied_s / max(occupied_s + sum(stay.observed_s for stay in self.free), 1e-9)

    def together(self, stays: Sequence[Stay]) -> float:
        """Share of the cells seen that had the group's state, in the mean over the time of some stays."""
        return sum(stay.together * stay.observed_s for stay in stays) / sum(stay.observed_s for stay in stays)

    def n_long(self, long_s: float) -> int:
        """How often it was occupied from first to last seen for so long."""
        return sum(stay.lasted_s >= long_s for stay in self.occupied)


def find_places(
    states: CellStates,
    groups: Sequence[NDArray[np.int64]],
    settings: EvidenceConfig,
    known: Known | None = None,
    elsewhere: Elsewhere | None = None,
) -> list[Place]:
    """The groups that are likelier to be places of a leaf or a box than `doubt_above`.

    Sorted by the row, then column, of the first cell.
    """
    judged = (
        replace(place, log_odds=place_odds(traits))
        for place, traits in candidates(states, groups, settings, known, elsewhere)
    )
    places = without_doubles([place for place in judged if place.log_odds > settings.doubt_above], settings.face_m)
    return sorted(places, key=lambda place: int(place.cells[0]))


def candidates(
    states: CellStates,
    groups: Sequence[NDArray[np.int64]],
    settings: EvidenceConfig,
    known: Known | None = None,
    elsewhere: Elsewhere | None = None,
) -> list[tuple[Place, Traits]]:
    """Groups, faces joined, that change as a whole and are large enough; and what is known of each."""
    large = [group for group in groups if _reach_m(states, group) >= settings.piece_m]
    if elsewhere is not None:
        measured = dict(enumerate(elsewhere.measure(states, large)))
    else:
        measured = {k: _measured(states, large[k], settings, known) for k in by_block(states, large)}
    pieces = [measured[k] for k in range(len(large)) if _may_be_part(measured[k], settings)]
    comes_back = np.zeros(len(states.rows), dtype=np.bool_)
    for piece in pieces:
        if _comes_back(piece, settings):
            comes_back[piece.cells] = True
    if elsewhere is not None:
        joined = elsewhere.join_faces(states, pieces)
    else:
        joined = join_faces(states, pieces, settings, known)
    joined = [place for place in joined if place.size_m >= settings.smallest_m and place.n_changes]
    if elsewhere is not None:
        return list(zip(joined, elsewhere.traits(states, joined, comes_back), strict=True))
    return [
        (joined[k], _traits(states, joined[k], comes_back, settings, known))
        for k in by_block(states, [one.cells for one in joined])
    ]


def without_doubles(places: Sequence[Place], face_m: float) -> list[Place]:
    """Of places that lie along each other, the likelier: poses that drift show one place in two."""
    doubled: set[int] = set()
    ranked = sorted(range(len(places)), key=lambda k: (-places[k].log_odds, int(places[k].cells[0])))
    rank = {k: n for n, k in enumerate(ranked)}
    pairs = [(i, j) if rank[i] < rank[j] else (j, i) for i, j in close_pairs(places, face_m)]
    for better, worse in sorted(pairs, key=lambda pair: (rank[pair[0]], rank[pair[1]])):
        if doubled.isdisjoint((better, worse)) and _share_along(places[better], places[worse], face_m) >= SAME_PLACE:
            doubled.add(worse)
    return [place for k, place in enumerate(places) if k not in doubled]


def by_block(states: CellStates, groups: Sequence[NDArray[np.int64]]) -> list[int]:
    """Numbers of groups, those that begin in the same block after each other: their courses are loaded together."""
    return sorted(range(len(groups)), key=lambda k: (int(states.block_of[groups[k][0]]), k))


def looks_m(settings: EvidenceConfig) -> float:
    """How far from a place `traits_of` looks, at most: what has not changed within, it need not be asked again."""
    return max(settings.ring_m, settings.echo_m)


def looks_around(states: CellStates, settings: EvidenceConfig) -> int:
    """The same in cells, for `CellStates.around`."""
    return math.ceil(looks_m(settings) / states.resolution_m) + 1


def _measured(states: CellStates, cells: NDArray[np.int64], settings: EvidenceConfig, known: Known | None) -> Place:
    """As `measure`, or as it was measured before: cells may have other indices by now."""
    place = recalled(known, lambda: states.digest("piece", cells), lambda: measure(states, cells, settings))
    return replace(place, cells=cells)


def _traits(
    states: CellStates, place: Place, comes_back: NDArray[np.bool_], settings: EvidenceConfig, known: Known | None
) -> Traits:
    """As `traits_of`, or as they were before."""

    def key() -> bytes:
        around = states.around(place.cells, looks_around(states, settings))
        return states.digest("place", place.cells, around) + np.packbits(comes_back[around]).tobytes()

    return recalled(known, key, lambda: traits_of(states, place, comes_back, settings))


def measure(states: CellStates, cells: NDArray[np.int64], settings: EvidenceConfig) -> Place:
    """The course of a group's states: what most of its cells say while enough of them are seen."""
    _, start, stop, state = states.courses.of(cells).smoothed
    order = np.argsort(np.concatenate([start, stop]), kind="stable")
    periods, stays = np.empty((2, 3, len(order)), dtype=np.int64)
    seconds = np.empty((2, len(order)))
    least_seen = max(1.0, settings.seen_share * len(cells))
    n_periods, n_stays = sweep_group(order, start, stop, state, least_seen, periods, stays, seconds)
    kept = np.flatnonzero(seconds[0, :n_stays] >= settings.least_stay_s)
    observed_s, agree_s = seconds[:, kept]
    first_ns, last_ns, occupied = stays[:, kept].tolist()
    together = (agree_s / observed_s).tolist()
    of_minimal_time = tuple(map(Stay, map(bool, occupied), first_ns, last_ns, observed_s.tolist(), together))
    start_ns, stop_ns, state_of = periods[:, :n_periods].copy()
    course = PeriodArrays(start_ns, stop_ns, state_of.astype(np.uint8))
    return Place(cells, states.points_map(cells), course, of_minimal_time, states.resolution_m)


def _reach_m(states: CellStates, cells: NDArray[np.int64]) -> float:
    rows, cols = np.ptp(states.rows[cells]) + 1, np.ptp(states.cols[cells]) + 1
    return math.hypot(rows, cols) * states.resolution_m


def _may_be_part(piece: Place, settings: EvidenceConfig) -> bool:
    """Whether a group can be a face of a place; the rest is asked of the whole place."""
    return bool(piece.occupied and piece.free) and piece.together(piece.occupied) >= settings.together


def _comes_back(piece: Place, settings: EvidenceConfig) -> bool:
    """Whether something stood in a group for long, or repeatedly: it is no person, for all that is known so far."""
    again = piece.n_long(settings.long_stay_s) >= 1 or len(piece.occupied) >= 2
    return again and piece.duty >= settings.least_duty


def traits_of(states: CellStates, place: Place, comes_back: NDArray[np.bool_], settings: EvidenceConfig) -> Traits:
    """What tells a place from people, and from walls that were seen displaced."""
    return Traits(
        duty=place.duty,
        free_worth=sum(stay.observed_s for stay in place.free) / settings.worth_s,
        leak=leak(states, place, comes_back, settings),
        echo=echo(states, place, settings),
        together=place.together(place.occupied),
        n_occupied=len(place.occupied),
        n_long=place.n_long(settings.long_stay_s),
        depth_m=place.line.depth_m,
        size_m=place.size_m,
    )


def leak(states: CellStates, place: Place, comes_back: NDArray[np.bool_], settings: EvidenceConfig) -> float:
    """While the place was occupied: time of hits in the ring around it, per time of hits in it.

    A leaf's ring is empty; people fill theirs. Not counted are cells that were never free, walls beside the place,
    and those of other things that come back, such as the part at the hinge that another place of the leaf shares.
    """
    from scipy.spatial import cKDTree

    reach = max(1, round(settings.ring_m / states.resolution_m))
    around = states.around(place.cells, reach)
    cells, others = (np.stack([states.rows[of], states.cols[of]], axis=-1) for of in (place.cells, around))
    apart, _ = cKDTree(cells).query(others, p=np.inf, distance_upper_bound=reach + 0.5)
    ring = around[(apart > 0) & (apart <= reach) & (states.evidence[around, 0] >= settings.least_evidence)]
    ring = ring[~comes_back[ring]]
    spells = [(stay.start_ns, stay.stop_ns) for stay in place.occupied]
    in_ring, inside = (
        float(states.seconds_during(which, spells, smoothed=False)[:, 1].sum()) for which in (ring, place.cells)
    )
    return in_ring / max(inside, 1e-9)


def echo(states: CellStates, place: Place, settings: EvidenceConfig) -> float:
    """While the place was free: share of its cells with something occupied close beside them.

    A door that opens, or a chair that is carried away, leaves open floor. A wall that one pass of the robot saw a
    decimetre beside where another did is still there, right beside its other self.
    """
    from scipy.spatial import cKDTree

    reach = max(1, round(settings.echo_m / states.resolution_m))
    around = np.setdiff1d(states.around(place.cells, reach), place.cells, assume_unique=True)
    seconds = states.seconds_during(around, [(stay.start_ns, stay.stop_ns) for stay in place.free])
    standing = around[(seconds[:, 1] >= settings.least_stay_s) & (seconds[:, 1] > seconds[:, 0])]
    if not len(standing):
        return 0.0
    # Sideways only: the jambs at both ends of a leaf are no echo of it.
    centred = place.points_map - place.points_map.mean(axis=0)
    along, across = np.linalg.eigh(centred.T @ centred)[1].T[::-1]
    points = states.points_map(standing)
    aside_m, ahead_m = settings.echo_m + ROUNDING_M, states.resolution_m + ROUNDING_M
    near = cKDTree(points).query_ball_point(place.points_map, math.hypot(aside_m, ahead_m))
    cell = np.repeat(np.arange(len(near)), [len(others) for others in near])
    apart = points[np.concatenate(near).astype(np.int64)] - place.points_map[cell]
    beside = (abs(apart @ across) <= aside_m) & (abs(apart @ along) <= ahead_m)
    return len(np.unique(cell[beside])) / len(place.cells)


def join_faces(
    states: CellStates, pieces: Sequence[Place], settings: EvidenceConfig, known: Known | None = None
) -> list[Place]:
    """Groups that lie along each other and never contradict each other, as one: the faces of a leaf or a box.

    A pass of the robot sees one face, the next one the other; what their states have in common are stays, gaps
    filled in.
    """
    return list(join_pairs(states, pieces, close_pairs(pieces, settings.face_m), settings, known).values())


def join_pairs(
    states: CellStates,
    pieces: Sequence[Place],
    pairs: Iterable[tuple[int, int]],
    settings: EvidenceConfig,
    known: Known | None = None,
) -> dict[int, Place]:
    """`join_faces` for pairs of pieces, by their numbers, in order; what is joined has the number of one piece of it.

    Pieces that no chain of pairs connects do not meet.
    """
    from tempog.analysis.evidence.association import joint_periods

    whole: dict[int, Place] = dict(enumerate(pieces))
    part_of = list(range(len(pieces)))

    def owner(k: int) -> int:
        while part_of[k] != k:
            part_of[k] = part_of[part_of[k]]
            k = part_of[k]
        return k

    for i, j in pairs:
        a, b = owner(i), owner(j)
        if a == b:
            continue
        along = _share_along(whole[a], whole[b], settings.face_m)
        small = min(whole[a].size_m, whole[b].size_m) <= settings.fragment_m + ROUNDING_M
        if along < (FRAGMENT if small else FACE):
            continue
        evidence = joint_periods(whole[a].course, whole[b].course, settings.worth_s, one_at_a_time=False)
        agree = evidence[1, 1] >= 0.5 and (along >= FACE or evidence[0, 0] >= 0.5)
        if (agree or along >= SAME_PLACE) and evidence[0, 1] + evidence[1, 0] <= 0.1 * evidence.sum():
            cells = np.sort(np.concatenate([whole[a].cells, whole[b].cells]))
            whole[a] = _measured(states, cells, settings, known)
            del whole[b]
            part_of[b] = a
    return whole


def close_pairs(pieces: Sequence[Place], face_m: float) -> list[tuple[int, int]]:
    """Pairs of pieces whose centres are no farther apart than the larger one's size, and the gap between faces.

    Each piece looks as far as its own size: one that reaches through the whole map is paired with all others, but
    these are not with each other.
    """
    from scipy.spatial import cKDTree

    if len(pieces) < 2:
        return []
    centres = np.array([piece.centre_m for piece in pieces])
    near = cKDTree(centres).query_ball_point(centres, [piece.size_m + face_m + ROUNDING_M for piece in pieces])
    return sorted({(min(i, j), max(i, j)) for i, others in enumerate(near) for j in others if i != j})


def _share_along(place: Place, other: Place, face_m: float) -> float:
    """Share of the smaller one's cells within two faces' distance of the other; 0 if none is within one."""
    from scipy.spatial import cKDTree

    small, large = sorted((place.points_map, other.points_map), key=len)
    beside_m = face_m + ROUNDING_M
    if np.any(small.min(axis=0) - large.max(axis=0) > beside_m) or np.any(
        large.min(axis=0) - small.max(axis=0) > beside_m
    ):
        return 0.0
    apart_m, _ = cKDTree(large).query(small)
    return float(np.mean(apart_m <= 2 * face_m + ROUNDING_M)) if apart_m.min() <= beside_m else 0.0
