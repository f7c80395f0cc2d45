"""Which groups of cells are places that a thing comes to stand in, and which are people, or walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Period
from tempog.analysis.evidence.known import Known, recalled
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


def find_places(
    states: CellStates, groups: Sequence[NDArray[np.int64]], settings: EvidenceConfig, known: Known | None = None
) -> list[Place]:
    """The groups that behave like a leaf or a box: still there after a long time or found again, all at once, alone.

    Sorted by the row, then column, of the first cell.
    """
    large = [group for group in groups if _reach_m(states, group) >= settings.piece_m]
    measured: dict[int, Place] = {}
    for k in by_block(states, large):
        measured[k] = _measured(states, large[k], settings, known)
    pieces = [measured[k] for k in range(len(large)) if _may_be_part(measured[k], settings)]
    joined = join_faces(states, pieces, settings, known)
    places = [
        joined[k]
        for k in by_block(states, [one.cells for one in joined])
        if _is_place(states, joined[k], settings, known)
    ]
    return sorted(places, key=lambda place: int(place.cells[0]))


def by_block(states: CellStates, groups: Sequence[NDArray[np.int64]]) -> list[int]:
    """Numbers of groups, those that begin in the same block after each other: their courses are loaded together."""
    return sorted(range(len(groups)), key=lambda k: (int(states.block_of[groups[k][0]]), k))


def looks_m(settings: EvidenceConfig) -> float:
    """How far from a place `is_place` looks, at most: what has not changed within, it need not be asked again."""
    return max(settings.ring_m, settings.echo_m)


def _measured(states: CellStates, cells: NDArray[np.int64], settings: EvidenceConfig, known: Known | None) -> Place:
    """As `measure`, or as it was measured before: cells may have other indices by now."""
    place = recalled(known, lambda: states.digest("piece", cells), lambda: measure(states, cells, settings))
    return replace(place, cells=cells)


def _is_place(states: CellStates, place: Place, settings: EvidenceConfig, known: Known | None) -> bool:
    def key() -> bytes:
        around = states.around(place.cells, math.ceil(looks_m(settings) / states.resolution_m) + 1)
        return states.digest("place", place.cells, around)

    return recalled(known, key, lambda: is_place(states, place, settings))


def measure(states: CellStates, cells: NDArray[np.int64], settings: EvidenceConfig) -> Place:
    """The course of a group's states: what most of its cells say while enough of them are seen."""
    _, start, stop, state = states.courses.of(cells).smoothed
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
    from scipy.spatial import cKDTree

    reach = max(1, round(settings.ring_m / states.resolution_m))
    around = states.around(place.cells, reach)
    cells, others = (np.stack([states.rows[of], states.cols[of]], axis=-1) for of in (place.cells, around))
    apart, _ = cKDTree(cells).query(others, p=np.inf, distance_upper_bound=reach + 0.5)
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
    near = cKDTree(points).query_ball_point(place.points_map, math.hypot(settings.echo_m, states.resolution_m) + 1e-6)
    cell = np.repeat(np.arange(len(near)), [len(others) for others in near])
    apart = points[np.concatenate(near).astype(np.int64)] - place.points_map[cell]
    beside = (abs(apart @ across) <= settings.echo_m) & (abs(apart @ along) <= states.resolution_m)
    return len(np.unique(cell[beside])) / len(place.cells)


def join_faces(
    states: CellStates, pieces: Sequence[Place], settings: EvidenceConfig, known: Known | None = None
) -> list[Place]:
    """Groups that lie along each other and never contradict each other, as one: the faces of a leaf or a box.

    A pass of the robot sees one face, the next one the other; what their states have in common are stays, gaps
    filled in.
    """
    from tempog.analysis.evidence.association import joint_periods

    whole: dict[int, Place] = dict(enumerate(pieces))
    part_of = list(range(len(pieces)))

    def owner(k: int) -> int:
        while part_of[k] != k:
            part_of[k] = part_of[part_of[k]]
            k = part_of[k]
        return k

    for i, j in _close_pairs(pieces, settings.face_m):
        a, b = owner(i), owner(j)
        if a == b or not _along(whole[a], whole[b], settings.face_m):
            continue
        evidence = joint_periods(whole[a].periods, whole[b].periods, settings.worth_s, one_at_a_time=False)
        if evidence[1, 1] >= 0.5 and evidence[0, 1] + evidence[1, 0] <= 0.1 * evidence.sum():
            cells = np.sort(np.concatenate([whole[a].cells, whole[b].cells]))
            whole[a] = _measured(states, cells, settings, known)
            del whole[b]
            part_of[b] = a
    return list(whole.values())


def _close_pairs(pieces: Sequence[Place], face_m: float) -> list[tuple[int, int]]:
    """Pairs of pieces whose centres are no farther apart than the larger one's size, and the gap between faces.

    Each piece looks as far as its own size: one that reaches through the whole map is paired with all others, but
    these are not with each other.
    """
    from scipy.spatial import cKDTree

    if len(pieces) < 2:
        return []
    centres = np.array([piece.centre_m for piece in pieces])
    near = cKDTree(centres).query_ball_point(centres, [piece.size_m + face_m for piece in pieces])
    return sorted({(min(i, j), max(i, j)) for i, others in enumerate(near) for j in others if i != j})


def _along(place: Place, other: Place, face_m: float) -> bool:
    """Whether half the cells of the smaller are within two faces' distance of the other, and one within one."""
    from scipy.spatial import cKDTree

    small, large = sorted((place.points_map, other.points_map), key=len)
    if np.any(small.min(axis=0) - large.max(axis=0) > face_m) or np.any(
        large.min(axis=0) - small.max(axis=0) > face_m
    ):
        return False
    apart_m, _ = cKDTree(large).query(small)
    return bool(apart_m.min() <= face_m and np.mean(apart_m <= 2 * face_m) >= 0.5)
