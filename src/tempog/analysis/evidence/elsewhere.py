"""The steps of the method that cost most, worked out by other processes.

What is sent is a part of the map: some cells with their own intervals, and the scans that saw them. Nothing is read
from disk, and nothing is kept there, so that any process can work out any part, twice if need be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.blocks import BlockEvidence, look_at_block
from tempog.analysis.evidence.courses import HeldCourses, smoothed_courses
from tempog.analysis.evidence.grouping import merge
from tempog.analysis.evidence.places import (
    PeriodArrays,
    Place,
    Stay,
    by_block,
    close_pairs,
    join_pairs,
    looks_around,
    measure,
    traits_of,
)
from tempog.analysis.evidence.scorecard import Traits
from tempog.analysis.evidence.states import Alike, CellStates
from tempog.analysis.evidence.views import Scans
from tempog.analysis.series import Intervals
from tempog.analysis.series_kernels import connect, count_periods, cut_out
from tempog.grid.segments import Runs
from tempog.methods import EvidenceConfig

CHUNK_BITS = 6  # scans are kept or left out by 64: a block that was seen at all was seen for seconds
T = TypeVar("T")
U = TypeVar("U")


class Workers(Protocol):
    """Other processes."""

    def each(self, what: str, work: Callable[[T], U], items: Iterable[T], n_items: int) -> list[U]:
        """``[work(item) for item in items]``; `what` says for people what the items are."""


class Part(NamedTuple):
    """Some cells, and all that was measured in them.

    Attributes
    ----------
    numbers : (n,) int32
        Cell numbers.
    rows, cols : (n,) int64
        Sorted by row, then column.
    resolution_m : float, metres
    intervals : Intervals
        Of these cells alone; scans that saw none of them are left out, and the others are numbered anew.
    poses : (n_scans, 3) float64
        Of the scans that are kept.
    """

    numbers: NDArray[np.int32]
    rows: NDArray[np.int64]
    cols: NDArray[np.int64]
    resolution_m: float
    intervals: Intervals
    poses: NDArray[np.float64]

    def states(self, settings: EvidenceConfig, evidence: NDArray[np.float64] | None = None) -> CellStates:
        """The cells' courses, and for how much their states speak as far as it is given."""
        n = len(self.numbers)
        nothing = np.empty(0, np.int64)
        return CellStates(
            self.rows,
            self.cols,
            self.resolution_m,
            self.numbers,
            np.zeros((n, 2)) if evidence is None else evidence,
            np.zeros((n, 2)),
            np.zeros(n, dtype=np.int64),
            Alike(nothing, nothing, np.empty(0)),
            HeldCourses(smoothed_courses(self.intervals, self.numbers, settings)),
            np.zeros(n, dtype=np.uint64),
            np.zeros(n, dtype=np.bool_),
        )


class Measured(NamedTuple):
    """What `measure` finds out about a group of cells."""

    course: PeriodArrays
    stays: tuple[Stay, ...]

    def place(self, states: CellStates, cells: NDArray[np.int64]) -> Place:
        """As a place, of cells by their indices into some states."""
        return Place(cells, states.points_map(cells), self.course, self.stays, states.resolution_m)


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """Has parts of one history worked out by other processes.

    Attributes
    ----------
    workers : Workers
    intervals : Intervals
        All of the history's.
    poses : (n_scans, 3) float64
    resolution_m : float, metres
    settings : EvidenceConfig
    """

    workers: Workers
    intervals: Intervals
    poses: NDArray[np.float64]
    resolution_m: float
    settings: EvidenceConfig

    def look_at_blocks(self, areas: Sequence[Callable[[], _Area]]) -> list[BlockEvidence]:
        """`look_at_block` for each area: the cells of a block and those beside it."""

        def tasks() -> Iterator[_Block]:
            for area in areas:
                numbers, rows, cols, own = area()
                yield _Block(self._part(numbers, rows, cols, with_poses=True), own, self.settings)

        return self.workers.each("blocks", _look, tasks(), len(areas))

    def merge(self, bundles: Sequence[_Bundle]) -> list[NDArray[np.int64]]:
        """`merge` for each bundle: how many cells there are, and pairs of them with their weights."""
        tasks = ((*bundle, self.settings.alike_above) for bundle in bundles)
        return self.workers.each("bundles of cells", _merge, tasks, len(bundles))

    def measure(self, states: CellStates, groups: Sequence[NDArray[np.int64]]) -> list[Place]:
        """`measure` for each group of cells."""
        batches = _batches(states, groups)

        def tasks() -> Iterator[_Groups]:
            for batch in batches:
                cells = _cells_of([groups[k] for k in batch])
                part = self._part_of(states, cells)
                yield _Groups(part, [np.searchsorted(cells, groups[k]) for k in batch], self.settings)

        answers = self.workers.each("groups of cells", _measure, tasks(), len(batches))
        found = {
            k: one for batch, ones in zip(batches, answers, strict=True) for k, one in zip(batch, ones, strict=True)
        }
        return [found[k].place(states, group) for k, group in enumerate(groups)]

    def join_faces(self, states: CellStates, pieces: Sequence[Place]) -> list[Place]:
        """`join_faces`, for pieces that no chain of close pairs connects by themselves."""
        pairs = np.array(close_pairs(pieces, self.settings.face_m), dtype=np.int64).reshape(-1, 2)
        first_of = np.arange(len(pieces))
        left, right = pairs.T.copy()
        connect(left, right, first_of)
        paired = np.zeros(len(pieces), dtype=np.bool_)
        paired[pairs.ravel()] = True
        block = np.array([states.block_of[pieces[k].cells[0]] for k in first_of.tolist()], dtype=np.int64)
        batches = _split(np.flatnonzero(paired), block[paired])
        pairs_of = _split(pairs, block[pairs[:, 0]])
        cells_of = [_cells_of([pieces[k].cells for k in batch.tolist()]) for batch in batches]

        def tasks() -> Iterator[_Pieces]:
            for batch, mine, cells in zip(batches, pairs_of, cells_of, strict=True):
                local = [_within(cells, pieces[k]) for k in batch.tolist()]
                yield _Pieces(self._part_of(states, cells), local, np.searchsorted(batch, mine), self.settings)

        answers = self.workers.each("pieces of places", _join, tasks(), len(batches))
        whole = {k: piece for k, piece in enumerate(pieces) if not paired[k]}
        for batch, cells, joined in zip(batches, cells_of, answers, strict=True):
            for k, one in joined.items():
                number = int(batch[k])
                whole[number] = pieces[number] if one is None else one[1].place(states, cells[one[0]])
        return [whole[k] for k in sorted(whole)]

    def traits(self, states: CellStates, places: Sequence[Place], comes_back: NDArray[np.bool_]) -> list[Traits]:
        """`traits_of` each place."""
        batches = _batches(states, [place.cells for place in places])
        reach = looks_around(states, self.settings)

        def tasks() -> Iterator[_Places]:
            for batch in batches:
                cells = _cells_of([states.around(places[k].cells, reach) for k in batch])
                local = [_within(cells, places[k]) for k in batch]
                part = self._part_of(states, cells)
                yield _Places(part, states.evidence[cells], local, comes_back[cells], self.settings)

        answers = self.workers.each("places", _traits, tasks(), len(batches))
        found = {
            k: one for batch, ones in zip(batches, answers, strict=True) for k, one in zip(batch, ones, strict=True)
        }
        return [found[k] for k in range(len(places))]

    def _part_of(self, states: CellStates, cells: NDArray[np.int64]) -> Part:
        return self._part(states.numbers[cells], states.rows[cells], states.cols[cells])

    def _part(
        self,
        numbers: NDArray[np.int32],
        rows: NDArray[np.int64],
        cols: NDArray[np.int64],
        with_poses: bool = False,
    ) -> Part:
        intervals, kept = part_of(self.intervals, np.sort(numbers))
        poses = self.poses[kept] if with_poses else np.empty((0, 3))
        return Part(numbers, rows, cols, self.resolution_m, intervals, poses)


def part_of(intervals: Intervals, numbers: NDArray[np.int32]) -> tuple[Intervals, NDArray[np.int64]]:
    """The intervals of some cells, sorted by number, within the period; and the numbers that the kept scans had.

    Its series are those of the whole, bit by bit. Between the first and the last look of an interval all scans are
    kept, and those of the same stamps: what is looked up there is the same as well.
    """
    period = (intervals.first_scan, intervals.last_scan)
    steps = np.zeros((len(intervals.stamps_ns) >> CHUNK_BITS) + 2, dtype=np.int32)
    sets = []
    for runs in intervals.sets:
        at = np.searchsorted(runs.cells, numbers)
        at[at == len(runs.cells)] = 0
        at = np.where(runs.cells[at] == numbers, at, -1) if len(runs.cells) else np.full_like(at, -1)
        n_intervals = np.zeros(len(numbers), dtype=np.int64)
        count_periods(at, runs.offsets, runs.first, runs.last, *period, n_intervals)
        offsets = np.append(0, np.cumsum(n_intervals)).astype(np.int64)
        first, last = np.empty((2, offsets[-1]), dtype=np.int32)
        value = np.empty(offsets[-1], dtype=np.float32)
        cut_out(at, *runs[1:], *period, intervals.stamps_ns, CHUNK_BITS, offsets, first, last, value, steps)
        sets.append(Runs(numbers, offsets, first, last, value))
    needed = np.cumsum(steps[:-1]) > 0
    begin = (np.cumsum(needed) - 1).astype(np.int32) << CHUNK_BITS  # of each chunk, among those that are kept
    for runs in sets:
        for scans in (runs.first, runs.last):
            scans[:] = begin[scans >> CHUNK_BITS] + (scans & ((1 << CHUNK_BITS) - 1))
    kept = ((np.flatnonzero(needed) << CHUNK_BITS)[:, np.newaxis] + np.arange(1 << CHUNK_BITS)).ravel()
    kept = kept[kept < len(intervals.stamps_ns)]
    return Intervals(sets, intervals.stamps_ns[kept], 0, len(kept) - 1, intervals.look_ns), kept


# What is sent, and what is done with it there.

_Area = tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]
_Bundle = tuple[int, NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]


class _Block(NamedTuple):
    part: Part
    own: NDArray[np.bool_]
    settings: EvidenceConfig


class _Groups(NamedTuple):
    part: Part
    groups: list[NDArray[np.int64]]
    settings: EvidenceConfig


class _Pieces(NamedTuple):
    part: Part
    pieces: list[Place]
    pairs: NDArray[np.int64]
    settings: EvidenceConfig


class _Places(NamedTuple):
    part: Part
    evidence: NDArray[np.float64]
    places: list[Place]
    comes_back: NDArray[np.bool_]
    settings: EvidenceConfig


def _look(task: _Block) -> BlockEvidence:
    part, own, settings = task
    courses = smoothed_courses(part.intervals, part.numbers, settings)
    scans = Scans(part.intervals.stamps_ns, part.poses, part.intervals.look_ns)
    return look_at_block(courses, part.rows, part.cols, own, part.resolution_m, scans, settings)


def _merge(task: tuple[int, NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], float]) -> NDArray[np.int64]:
    return merge(*task)


def _measure(task: _Groups) -> list[Measured]:
    states = task.part.states(task.settings)
    measured = [measure(states, group, task.settings) for group in task.groups]
    return [Measured(one.course, one.stays) for one in measured]


def _join(task: _Pieces) -> dict[int, tuple[NDArray[np.int64], Measured] | None]:
    """By the number that each joined place has: its cells and what was measured; None if it is a piece as it was."""
    states = task.part.states(task.settings)
    whole = join_pairs(states, task.pieces, map(tuple, task.pairs.tolist()), task.settings)
    return {
        k: None if one is task.pieces[k] else (one.cells, Measured(one.course, one.stays)) for k, one in whole.items()
    }


def _traits(task: _Places) -> list[Traits]:
    states = task.part.states(task.settings, task.evidence)
    return [traits_of(states, place, task.comes_back, task.settings) for place in task.places]


def _batches(states: CellStates, groups: Sequence[NDArray[np.int64]]) -> list[list[int]]:
    """Numbers of groups, by the block they begin in."""
    batches: dict[int, list[int]] = {}
    for k in by_block(states, groups):
        batches.setdefault(int(states.block_of[groups[k][0]]), []).append(k)
    return list(batches.values())


def _split(items: NDArray[np.int64], by: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Items with the same number together, in the order of these numbers."""
    order = np.argsort(by, kind="stable")
    return np.split(items[order], np.flatnonzero(np.diff(by[order])) + 1) if len(order) else []


def _cells_of(groups: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    return np.unique(np.concatenate(groups))


def _within(cells: NDArray[np.int64], place: Place) -> Place:
    """A place whose cells are indices into some cells alone."""
    return replace(place, cells=np.searchsorted(cells, place.cells))
