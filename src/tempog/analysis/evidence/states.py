"""When each cell was occupied and when free, smoothed, and how much speaks for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.kernels import seconds_during, smooth_states, state_evidence
from tempog.analysis.series import SeriesSet, ever_occupied, look_ns, time_series
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.methods import EvidenceConfig

# Log-likelihood ratios of one look, occupied against free. Surfaces that are there return about four beams of five:
# drop-outs, grazing beams and poses that are a bit off take the rest; where nothing is, three looks of a hundred hit.
FOR_HIT = math.log(0.80 / 0.03)
FOR_FREE = math.log(0.20 / 0.97)
MAX_LOOKS = 5.0  # looks of one interval repeat each other's errors: they count for at most so many,
ERRORS_LAST_S = 2.0  # or for one in so many seconds: what is seen free for a minute without a break is free


@dataclass(frozen=True, eq=False)
class CellStates:
    """Smoothed states of all cells that were ever hit.

    Attributes
    ----------
    rows, cols : (n,) int64
        Of the lattice, sorted by row, then column; may be negative.
    resolution_m : float, metres
    series : SeriesSet
        The measured series of the cells, in the same order.
    state : (n_periods,) uint8
        1 occupied, 0 free, for each period of `series`.
    evidence : (n, 2) float64
        For having been free, and occupied: about the number of times that it was seen so for over a second.
    seconds : (n, 2) float64
        For how long it was seen free, and occupied.
    """

    rows: NDArray[np.int64]
    cols: NDArray[np.int64]
    resolution_m: float
    series: SeriesSet
    state: NDArray[np.uint8]
    evidence: NDArray[np.float64]
    seconds: NDArray[np.float64]

    @property
    def occupied_share(self) -> NDArray[np.float64]:
        """(n,) share of the time seen in which the cell was occupied."""
        return np.asarray(self.seconds[:, 1] / self.seconds.sum(axis=1))

    @cached_property
    def _measured(self) -> NDArray[np.uint8]:
        """As `state`, not smoothed."""
        return (self.series.value > OCCUPIED_ABOVE).astype(np.uint8)

    def around(self, cells: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
        """Which of the cells lie in the rectangle around some of them, or up to `reach` cells beside it."""
        row_min, row_max = int(self.rows[cells].min()) - reach, int(self.rows[cells].max()) + reach
        col_min, col_max = int(self.cols[cells].min()) - reach, int(self.cols[cells].max()) + reach
        first, end = np.searchsorted(self.rows, [row_min, row_max + 1])
        cols = self.cols[first:end]
        return np.asarray(first + np.flatnonzero((cols >= col_min) & (cols <= col_max)))

    def seconds_during(
        self, which: NDArray[np.int64], spells: Sequence[tuple[int, int]], smoothed: bool = True
    ) -> NDArray[np.float64]:
        """For how long some cells were free, and occupied, within spells of (since, until) ns; (n, 2).

        By their smoothed states, or by what was measured.
        """
        since, until = np.array(spells, dtype=np.int64).reshape(-1, 2).T.copy()
        series = self.series
        state = self.state if smoothed else self._measured
        seconds = np.zeros((len(which), 2))
        seconds_during(series.offsets, series.start_ns, series.stop_ns, state, which, since, until, seconds)
        return seconds

    def points_map(self, which: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centres of some of the cells, (n, 2) metres."""
        return np.stack([self.cols[which] + 0.5, self.rows[which] + 0.5], axis=-1) * self.resolution_m


def cell_states(history: History, settings: EvidenceConfig) -> CellStates:
    """Smooth the series of every cell that was ever hit: a two-state hidden Markov model over its intervals."""
    cells = np.flatnonzero(ever_occupied(history)).astype(np.int32)
    rows, cols = (places.astype(np.int64) for places in history.tiles.rows_cols(cells))
    order = np.lexsort((cols, rows))
    series = time_series(history, cells[order])
    periods = (series.offsets, series.start_ns, series.stop_ns)
    state = np.zeros(len(series.value), dtype=np.uint8)
    smooth_states(
        *periods,
        series.value,
        look_ns(history),
        OCCUPIED_ABOVE,
        FOR_HIT,
        FOR_FREE,
        MAX_LOOKS,
        ERRORS_LAST_S,
        settings.dwell_s,
        state,
    )
    evidence, seconds = np.zeros((2, len(cells), 2))
    state_evidence(*periods, state, settings.worth_s, evidence, seconds)
    resolution_m = history.tiles.spec.resolution_m
    return CellStates(rows[order], cols[order], resolution_m, series, state, evidence, seconds)
