"""The smoothed course of states of any cells: loaded block by block, and let go again."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.kernels import copy_periods, smooth_states
from tempog.analysis.series import Intervals
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.methods import EvidenceConfig

# Log-likelihood ratios of one look, occupied against free. Surfaces that are there return about four beams of five:
# drop-outs, grazing beams and poses that are a bit off take the rest; where nothing is, three looks of a hundred hit.
FOR_HIT = math.log(0.80 / 0.03)
FOR_FREE = math.log(0.20 / 0.97)
MAX_LOOKS = 5.0  # looks of one interval repeat each other's errors: they count for at most so many,
ERRORS_LAST_S = 2.0  # or for one in so many seconds: what is seen free for a minute without a break is free
HELD_PERIODS = 2**24  # of blocks that are kept for the next question: 18 bytes each, 300 MB


class Courses(NamedTuple):
    """When each of some cells was occupied and when free.

    Attributes
    ----------
    offsets : (n + 1,) int64
        The periods of cell i are at ``offsets[i]:offsets[i + 1]`` of the following.
    start_ns, stop_ns : (n_periods,) int64
    hit, state : (n_periods,) uint8
        1 occupied, 0 free: as measured, and smoothed.
    """

    offsets: NDArray[np.int64]
    start_ns: NDArray[np.int64]
    stop_ns: NDArray[np.int64]
    hit: NDArray[np.uint8]
    state: NDArray[np.uint8]

    @property
    def smoothed(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
        """What kernels take, with smoothed states."""
        return self.offsets, self.start_ns, self.stop_ns, self.state

    @property
    def measured(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
        """What kernels take, with states as measured."""
        return self.offsets, self.start_ns, self.stop_ns, self.hit


class CourseSource(Protocol):
    """Where the courses of cells come from; cells are indices into `CellStates`."""

    def of(self, which: NDArray[np.int64]) -> Courses:
        """The courses of some cells, in the order asked for."""


def smoothed_courses(intervals: Intervals, numbers: NDArray[np.int32], settings: EvidenceConfig) -> Courses:
    """The courses of cells, given by their numbers: a two-state hidden Markov model over each one's intervals."""
    series = intervals.series(numbers)
    state = np.zeros(len(series.value), dtype=np.uint8)
    periods = (series.offsets, series.start_ns, series.stop_ns, series.value)
    model = (OCCUPIED_ABOVE, FOR_HIT, FOR_FREE, MAX_LOOKS, ERRORS_LAST_S, settings.dwell_s)
    smooth_states(*periods, intervals.look_ns, *model, state)
    return Courses(*periods[:3], (series.value > OCCUPIED_ABOVE).astype(np.uint8), state)


class HeldCourses:
    """Courses of all cells, in memory."""

    def __init__(self, courses: Courses) -> None:
        self._courses = courses

    def of(self, which: NDArray[np.int64]) -> Courses:
        """The courses of some cells, in the order asked for."""
        chosen = _empty_courses(np.diff(self._courses.offsets)[which])
        copy_periods(*self._courses, which, np.arange(len(which)), *chosen)
        return chosen


class BlockCourses:
    """Courses of the cells of many blocks, of which those asked for last are kept.

    Parameters
    ----------
    block_of, place_of : (n_cells,) int64
        Which block each cell is in, and which of the block's cells it is.
    n_periods : (n_cells,) int64
    load : callable
        Gives the courses of all cells of a block.
    held : dict
        Courses of all cells of some blocks, which were loaded already.
    """

    def __init__(
        self,
        block_of: NDArray[np.int64],
        place_of: NDArray[np.int64],
        n_periods: NDArray[np.int64],
        load: Callable[[int], Courses],
        held: Mapping[int, Courses],
    ) -> None:
        self._block_of = block_of
        self._place_of = place_of
        self._n_periods = n_periods
        self._load = load
        self._held = OrderedDict(held)
        self._n_held = sum(len(courses.state) for courses in held.values())

    def of(self, which: NDArray[np.int64]) -> Courses:
        """The courses of some cells, in the order asked for."""
        chosen = _empty_courses(self._n_periods[which])
        blocks, places = self._block_of[which], self._place_of[which]
        for block in np.unique(blocks).tolist():
            here = np.flatnonzero(blocks == block)
            copy_periods(*self._block(block), places[here], here, *chosen)
        return chosen

    def _block(self, block: int) -> Courses:
        if block not in self._held:
            self._held[block] = self._load(block)
            self._n_held += len(self._held[block].state)
            while self._n_held > HELD_PERIODS and len(self._held) > 1:
                self._n_held -= len(self._held.popitem(last=False)[1].state)
        self._held.move_to_end(block)
        return self._held[block]


def _empty_courses(n_periods: NDArray[np.int64]) -> Courses:
    offsets = np.append(0, np.cumsum(n_periods)).astype(np.int64)
    start_ns, stop_ns = np.empty((2, offsets[-1]), dtype=np.int64)
    hit, state = np.empty((2, offsets[-1]), dtype=np.uint8)
    return Courses(offsets, start_ns, stop_ns, hit, state)
