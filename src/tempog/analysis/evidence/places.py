"""Which groups of cells are places that a thing comes to stand in, and which are people, or walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Period
from tempog.analysis.evidence.states import CellStates
from tempog.methods import EvidenceConfig
from tempog.times import NS_PER_S


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


@dataclass(frozen=True, eq=False)
class Place:
    """A group of cells with its course of states, and what speaks for and against its being a place.

    Attributes
    ----------
    cells : (n,) int64
        Indices into `CellStates`, sorted.
    points_map : (n, 2) float64, metres
    periods : tuple of Period
        The state of most of the cells seen, while enough of them were; gaps are times without.
    stays : tuple of Stay
        Of a minimal observed time.
    """

    cells: NDArray[np.int64]
    points_map: NDArray[np.float64]
    periods: tuple[Period, ...]
    stays: tuple[Stay, ...]
    resolution_m: float

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


def find_places(states: CellStates, groups: Sequence[NDArray[np.int64]], settings: EvidenceConfig) -> list[Place]:
    """The groups that behave like a leaf or a box: still there after a long time or found again, all at once, alone.

    Sorted by the row, then column, of the first cell.
    """
    pieces = []
    for group in groups:
        if _reach_m(states, group) >= settings.piece_m:
            piece = measure(states, group, settings)
            if _may_be_part(piece, settings):
                pieces.append(piece)
    places = [place for place in join_faces(states, pieces, settings) if is_place(states, place, settings)]
    return sorted(places, key=lambda place: int(place.cells[0]))


def measure(states: CellStates, cells: NDArray[np.int64], settings: EvidenceConfig) -> Place:
    """The course of a group's states: what most of its cells say while enough of them are seen."""
    offsets = states.series.offsets
    where = np.concatenate([np.arange(offsets[i], offsets[i + 1]) for i in cells.tolist()])
    start, stop, state = (of[where] for of in (states.series.start_ns, states.series.stop_ns, states.state))
    times = np.concatenate([start, stop])
    order = np.argsort(times, kind="stable")
    times = times[order]
    step = np.concatenate([np.ones(len(start), np.int64), -np.ones(len(stop), np.int64)])
    seen = np.cumsum(step[order])[:-1]
    hit = np.cumsum((step * np.concatenate([state, state]).astype(np.int64))[order])[:-1]
    since, lasted_s = times[:-1], np.diff(times) / NS_PER_S
    enough = (lasted_s > 0) & (seen >= max(1.0, settings.seen_share * len(cells)))
    since, until, lasted_s, seen, hit = since[enough], times[1:][enough], lasted_s[enough], seen[enough], hit[enough]
    occupied = 2 * hit > seen
    agree_s = np.where(occupied, hit, seen - hit) / seen * lasted_s
    changes = np.append(True, occupied[1:] != occupied[:-1]) if len(occupied) else np.empty(0, np.bool_)
    breaks = changes.copy()
    breaks[1:] |= since[1:] != until[:-1]
    periods = tuple(
        Period(int(since[a]), int(until[b - 1]), "occupied" if occupied[a] else "free")
        for a, b in pairwise([*np.flatnonzero(breaks).tolist(), len(since)])
    )
    stays = []
    for a, b in pairwise([*np.flatnonzero(changes).tolist(), len(since)]):
        observed_s = float(lasted_s[a:b].sum())
        if observed_s >= settings.least_stay_s:
            together = float(agree_s[a:b].sum()) / observed_s
            stays.append(Stay(bool(occupied[a]), int(since[a]), int(until[b - 1]), observed_s, together))
    return Place(cells, states.points_map(cells), periods, tuple(stays), states.resolution_m)


def _reach_m(states: CellStates, cells: NDArray[np.int64]) -> float:
    rows, cols = np.ptp(states.rows[cells]) + 1, np.ptp(states.cols[cells]) + 1
    return math.hypot(rows, cols) * states.resolution_m


def _may_be_part(piece: Place, settings: EvidenceConfig) -> bool:
    """Whether a group can be a face of a place; the rest is asked of the whole place."""
    if not piece.occupied or not piece.free:
        return False
    again = piece.n_long(settings.long_stay_s) >= 1 or len(piece.occupied) >= 2
    least_duty = min(settings.long_duty, settings.short_duty) / 2
    return again and piece.duty >= least_duty and piece.together(piece.occupied) >= settings.together


def is_place(states: CellStates, place: Place, settings: EvidenceConfig) -> bool:
    """Whether a group behaves like a thing that comes and goes, rather than like people or a wall."""
    if place.size_m < settings.smallest_m or not place.n_changes:
        return False
    if min(place.together(place.occupied), place.together(place.free)) < settings.together:
        return False
    free_s = sum(stay.observed_s for stay in place.free)
    if place.duty > settings.wall_duty and (len(place.free) < 2 or free_s < settings.wall_free_s):
        return False
    n_long = place.n_long(settings.long_stay_s)
    if n_long < 2 and is_round(place.points_map, settings):
        return False
    seen_s = sum(stay.observed_s for stay in place.occupied) / len(place.occupied)
    long = n_long >= 1 and place.duty >= settings.long_duty and seen_s >= settings.long_seen_s
    echoes, leaks = echo(states, place, settings), leak(states, place, settings)
    if echoes > settings.echo:
        return False
    if place.n_changes == 1:
        observed_s = min(stay.observed_s for stay in place.stays)
        if max(echoes, leaks) > settings.once_doubt or observed_s < settings.once_seen_s:
            return False
    if long and leaks <= settings.leak:
        return True
    alone = leaks <= settings.short_leak and place.together(place.occupied) >= settings.short_together
    return (
        alone and len(place.occupied) >= 2 and place.duty >= settings.short_duty and seen_s >= settings.short_seen_s
    )


def is_round(points_map: NDArray[np.float64], settings: EvidenceConfig) -> bool:
    """Whether points lie on a part of a small circle, deeper than a line: the near side of somebody.

    The circle is Kasa's (1976): least squares of ``x² + y² = 2 a x + 2 b y + c``.
    """
    points = points_map - points_map.mean(axis=0)
    depth_m = math.sqrt(max(float(np.linalg.eigvalsh(points.T @ points / len(points))[0]), 0.0))
    if depth_m <= settings.round_depth_m:
        return False
    terms = np.column_stack([2 * points, np.ones(len(points))])
    (a, b, c), *_ = np.linalg.lstsq(terms, (points**2).sum(axis=1), rcond=None)
    radius_m = math.sqrt(max(float(c + a * a + b * b), 0.0))
    error_m = float(np.sqrt(((np.hypot(*(points - (a, b)).T) - radius_m) ** 2).mean()))
    return radius_m < settings.round_radius_m and error_m < settings.round_error_m


def leak(states: CellStates, place: Place, settings: EvidenceConfig) -> float:
    """While the place was occupied: time of hits in the ring around it, per time of hits in it.

    Cells that were never free, walls beside the place, are not counted.
    """
    reach = max(1, round(settings.ring_m / states.resolution_m))
    around = states.around(place.cells, reach)
    up, right = (abs(of[around][:, None] - of[place.cells]) for of in (states.rows, states.cols))
    apart = np.maximum(up, right).min(axis=1)
    ring = around[(apart > 0) & (apart <= reach) & (states.evidence[around, 0] >= settings.least_evidence)]
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
    reach = max(1, round(settings.echo_m / states.resolution_m))
    around = np.setdiff1d(states.around(place.cells, reach), place.cells, assume_unique=True)
    seconds = states.seconds_during(around, [(stay.start_ns, stay.stop_ns) for stay in place.free])
    standing = around[(seconds[:, 1] >= settings.least_stay_s) & (seconds[:, 1] > seconds[:, 0])]
    if not len(standing):
        return 0.0
    # Sideways only: the jambs at both ends of a leaf are no echo of it.
    centred = place.points_map - place.points_map.mean(axis=0)
    along, across = np.linalg.eigh(centred.T @ centred)[1].T[::-1]
    apart = states.points_map(standing) - place.points_map[:, None]
    beside = (abs(apart @ across) <= settings.echo_m) & (abs(apart @ along) <= states.resolution_m)
    return float(np.mean(beside.any(axis=1)))


def join_faces(states: CellStates, pieces: Sequence[Place], settings: EvidenceConfig) -> list[Place]:
    """Groups that lie along each other and never contradict each other, as one: the faces of a leaf or a box.

    A pass of the robot sees one face, the next one the other; what their states have in common are stays, gaps
    filled in.
    """
    from scipy.spatial import cKDTree

    from tempog.analysis.evidence.association import joint_periods

    whole: dict[int, Place] = dict(enumerate(pieces))
    if len(pieces) < 2:
        return list(whole.values())
    reach_m = max(piece.size_m for piece in pieces)
    pairs = cKDTree([piece.centre_m for piece in pieces]).query_pairs(
        reach_m + settings.face_m, output_type="ndarray"
    )
    part_of = list(range(len(pieces)))
    for i, j in sorted(pairs.tolist()):
        a, b = part_of[i], part_of[j]
        if a == b or not _along(whole[a], whole[b], settings.face_m):
            continue
        evidence = joint_periods(whole[a].periods, whole[b].periods, settings.worth_s, one_at_a_time=False)
        if evidence[1, 1] >= 0.5 and evidence[0, 1] + evidence[1, 0] <= 0.1 * evidence.sum():
            whole[a] = measure(states, np.sort(np.concatenate([whole[a].cells, whole[b].cells])), settings)
            del whole[b]
            part_of = [a if owner == b else owner for owner in part_of]
    return list(whole.values())


def _along(place: Place, other: Place, face_m: float) -> bool:
    """Whether half the cells of the smaller are within two faces' distance of the other, and one within one."""
    small, large = sorted((place.points_map, other.points_map), key=len)
    if np.any(small.min(axis=0) - large.max(axis=0) > face_m) or np.any(
        large.min(axis=0) - small.max(axis=0) > face_m
    ):
        return False
    apart_m = np.sqrt(((small[:, None] - large[None]) ** 2).sum(axis=-1)).min(axis=1)
    return bool(apart_m.min() <= face_m and np.mean(apart_m <= 2 * face_m) >= 0.5)
