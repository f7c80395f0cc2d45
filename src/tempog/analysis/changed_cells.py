"""Cells that are in another state at one moment than at an earlier one, by their smoothed states."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.courses import Courses, smoothed_courses
from tempog.analysis.evidence.find import for_looks_every, steady_look_ns
from tempog.analysis.series import Intervals, ever_occupied
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.methods import EvidenceConfig
from tempog.times import NS_PER_S

CELLS_AT_A_TIME = 2**16  # whose courses are in memory at once
BREAK_S = 5.0  # after a longer time without a look the robot has driven on, or turned: somebody else may stand there


class Looks(NamedTuple):
    """What is known of all cells at two moments, by cell number.

    Attributes
    ----------
    known_before, known_after : (n_cells,) bool
        Seen at the moment or within `hold` before it.
    seen_again : (n_cells,) bool
        Looked at after the first moment, up to the second.
    taken_before, taken_after : (n_cells,) bool
        Occupied when last looked at.
    age_before_s, age_after_s : (n_cells,) float32
        Since the last look; NaN where unknown.
    """

    known_before: NDArray[np.bool_]
    known_after: NDArray[np.bool_]
    seen_again: NDArray[np.bool_]
    taken_before: NDArray[np.bool_]
    taken_after: NDArray[np.bool_]
    age_before_s: NDArray[np.float32]
    age_after_s: NDArray[np.float32]

    @property
    def compared(self) -> NDArray[np.bool_]:
        """Cells that are known at both moments, and were looked at in between."""
        return self.known_before & self.known_after & self.seen_again


class ChangedCells(NamedTuple):
    """Cells whose states differ.

    Attributes
    ----------
    cells : (n,) int32
        Cell numbers, ascending.
    appeared : (n,) bool
        Whether the cell is occupied at the second moment; else it was at the first.
    last_before_ns, first_after_ns : (n,) int64
        Until just before when it was seen in its old state, and from when on in the new one.
    age_before_s, age_after_s : (n,) float32
        How long before each moment it was looked at last.
    watched_s, seen_s : (n,) float64
        For how long it was watched while occupied, before the first moment and after the second one too, as long as
        no look speaks against it; and the shorter of the times for which it was seen in either state. Breaks of up to
        `BREAK_S` count for the first.
    """

    cells: NDArray[np.int32]
    appeared: NDArray[np.bool_]
    last_before_ns: NDArray[np.int64]
    first_after_ns: NDArray[np.int64]
    age_before_s: NDArray[np.float32]
    age_after_s: NDArray[np.float32]
    watched_s: NDArray[np.float64]
    seen_s: NDArray[np.float64]

    def chosen(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> ChangedCells:
        """Some of them."""
        return ChangedCells._make(values[which] for values in self)


def looks_at(history: History, before_ns: int, after_ns: int, hold_s: float) -> Looks:
    """What is known of all cells at two moments; states older than `hold_s` count as unknown."""
    before, after = (history.at(np.datetime64(stamp, "ns"), hold_s) for stamp in (before_ns, after_ns))
    value_before, value_after, age_before_s, age_after_s = (
        history.tiles.from_dense(values) for values in (before.value, after.value, before.age_s, after.age_s)
    )
    between_s = np.float32((after_ns - before_ns) / NS_PER_S)  # ages are kept in 32 bits, too
    with np.errstate(invalid="ignore"):
        return Looks(
            known_before=~np.isnan(value_before),
            known_after=~np.isnan(value_after),
            seen_again=age_after_s < between_s,
            taken_before=value_before > OCCUPIED_ABOVE,
            taken_after=value_after > OCCUPIED_ABOVE,
            age_before_s=age_before_s,
            age_after_s=age_after_s,
        )


def changed_cells(history: History, before_ns: int, after_ns: int, looks: Looks) -> ChangedCells:
    """Those of the compared cells whose smoothed states differ at two moments."""
    look = steady_look_ns(history)
    settings = for_looks_every(look / NS_PER_S, EvidenceConfig())
    numbers = np.flatnonzero(looks.compared & ever_occupied(history)).astype(np.int32)
    intervals = Intervals.of(history, look)
    parts = [
        _changed(part, smoothed_courses(intervals, part, settings), before_ns, after_ns, looks)
        for part in np.split(numbers, range(CELLS_AT_A_TIME, len(numbers), CELLS_AT_A_TIME))
    ]
    return ChangedCells._make(np.concatenate(values) for values in zip(*parts, strict=True))


def _changed(
    numbers: NDArray[np.int32], courses: Courses, before_ns: int, after_ns: int, looks: Looks
) -> ChangedCells:
    offsets, start_ns, stop_ns, state = courses.smoothed
    n_periods = np.diff(offsets)
    owner = np.repeat(np.arange(len(numbers)), n_periods)
    # A run is several periods of one state of one cell, whatever gaps are between them.
    begins = np.append(True, (np.diff(state.astype(np.int8)) != 0) | (np.diff(owner) != 0))[: len(owner)]
    run = np.cumsum(begins) - 1
    first = np.flatnonzero(begins)
    lasted_s = (stop_ns - start_ns) / NS_PER_S
    break_s = np.append(0.0, (start_ns[1:] - stop_ns[:-1]) / NS_PER_S)[: len(owner)]
    break_s[begins | (break_s > BREAK_S)] = 0.0
    seen_s, watched_s = (
        np.bincount(run, weights=seconds, minlength=len(first)) for seconds in (lasted_s, lasted_s + break_s)
    )
    runs = [
        run[offsets[:-1] + np.bincount(owner[start_ns <= moment_ns], minlength=len(numbers)) - 1]
        for moment_ns in (before_ns, after_ns)
    ]
    differs = state[first[runs[0]]] != state[first[runs[1]]]
    before, after = (which[differs] for which in runs)
    appeared = state[first[after]] == 1
    taken = np.where(appeared, after, before)
    return ChangedCells(
        cells=numbers[differs],
        appeared=appeared,
        last_before_ns=stop_ns[first[after] - 1],  # another state of the same cell comes before it
        first_after_ns=start_ns[first[after]],
        age_before_s=looks.age_before_s[numbers[differs]],
        age_after_s=looks.age_after_s[numbers[differs]],
        watched_s=watched_s[taken],
        seen_s=np.minimum(seen_s[before], seen_s[after]),
    )
