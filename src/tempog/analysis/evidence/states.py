"""When each cell was occupied and when free, smoothed, and how much speaks for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.courses import CourseSource
from tempog.analysis.evidence.kernels import find_within, seconds_during
from tempog.analysis.evidence.known import digest

CELLS_AT_A_TIME = 2**13  # whose courses are asked for at once: the rectangle around a place may be the whole map


class Alike(NamedTuple):
    """Pairs of cells close to each other that both changed, and how much speaks for their showing one thing.

    Attributes
    ----------
    left, right : (n_pairs,) int64
        Indices into `CellStates`, the smaller one left.
    weight : (n_pairs,) float64
        Log-likelihood ratio.
    """

    left: NDArray[np.int64]
    right: NDArray[np.int64]
    weight: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CellStates:
    """Smoothed states of all cells that were ever hit.

    Attributes
    ----------
    rows, cols : (n,) int64
        Of the lattice, sorted by row, then column; may be negative.
    resolution_m : float, metres
    numbers : (n,) int32
        Cell numbers.
    evidence : (n, 2) float64
        For having been free, and occupied: about the number of times that it was seen so for over a second.
    seconds : (n, 2) float64
        For how long it was seen free, and occupied.
    block_of : (n,) int64
        Cells of one block are near each other, and their courses are loaded together.
    alike : Alike
    courses : CourseSource
        When each of the cells was in which state.
    content : (n,) uint64
        Differs if anything else was measured in a cell, or from elsewhere; zeros if nobody asked for it.
    by_view : (n,) bool
        Which cells were free or occupied by where they were seen from: glass.
    """

    rows: NDArray[np.int64]
    cols: NDArray[np.int64]
    resolution_m: float
    numbers: NDArray[np.int32]
    evidence: NDArray[np.float64]
    seconds: NDArray[np.float64]
    block_of: NDArray[np.int64]
    alike: Alike
    courses: CourseSource
    content: NDArray[np.uint64]
    by_view: NDArray[np.bool_]

    @property
    def occupied_share(self) -> NDArray[np.float64]:
        """(n,) share of the time seen in which the cell was occupied."""
        return np.asarray(self.seconds[:, 1] / self.seconds.sum(axis=1))

    def around(self, cells: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
        """Which of the cells lie in the rectangle around some of them, or up to `reach` cells beside it."""
        return within(
            self.rows,
            self.cols,
            int(self.rows[cells].min()) - reach,
            int(self.rows[cells].max()) + reach,
            int(self.cols[cells].min()) - reach,
            int(self.cols[cells].max()) + reach,
        )

    def seconds_during(
        self, which: NDArray[np.int64], spells: Sequence[tuple[int, int]], smoothed: bool = True
    ) -> NDArray[np.float64]:
        """For how long some cells were free, and occupied, within spells of (since, until) ns; (n, 2).

        By their smoothed states, or by what was measured.
        """
        since, until = np.array(spells, dtype=np.int64).reshape(-1, 2).T.copy()
        seconds = np.zeros((len(which), 2))
        for first in range(0, len(which), CELLS_AT_A_TIME):
            part = which[first : first + CELLS_AT_A_TIME]
            courses = self.courses.of(part)
            periods = courses.smoothed if smoothed else courses.measured
            seconds_during(*periods, np.arange(len(part)), since, until, seconds[first:])
        return seconds

    def digest(self, purpose: str, *several: NDArray[np.int64]) -> bytes:
        """A name for some sets of cells and all that was measured in them, for `Known`."""
        return digest(purpose, *(of[cells] for cells in several for of in (self.rows, self.cols, self.content)))

    def points_map(self, which: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centres of some of the cells, (n, 2) metres."""
        return np.stack([self.cols[which] + 0.5, self.rows[which] + 0.5], axis=-1) * self.resolution_m


def within(
    rows: NDArray[np.int64], cols: NDArray[np.int64], row_min: int, row_max: int, col_min: int, col_max: int
) -> NDArray[np.int64]:
    """Which of some cells, sorted by row and col, lie in a rectangle, borders included.

    >>> within(np.array([0, 0, 2, 3]), np.array([0, 5, 1, 0]), 0, 2, 0, 3).tolist()
    [0, 2]
    """
    box = (row_min, row_max, col_min, col_max)
    found = np.empty(256, dtype=np.int64)  # enough for most questions
    n_found = find_within(rows, cols, *box, found)
    if n_found > len(found):
        found = np.empty(n_found, dtype=np.int64)
        find_within(rows, cols, *box, found)
    return found[:n_found]
