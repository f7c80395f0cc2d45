"""Time series of cells, and how far apart two of them are (paper, section IV.C.1a, Fig. 8)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.dynamics import FALLBACK_LOOK_S
from tempog.analysis.kernels import mark_above
from tempog.analysis.series_kernels import append_periods, count_periods, pair_distances
from tempog.errors import ConfigError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.grid.segments import Runs
from tempog.methods import PaperConfig
from tempog.times import NS_PER_S


class Series(NamedTuple):
    """One time series: periods ``[start_ns, stop_ns)`` in time order, without overlap, and P(occupied) in each."""

    start_ns: NDArray[np.int64]
    stop_ns: NDArray[np.int64]
    value: NDArray[np.float32]


Distance = Literal["manhattan", "jaccard"] | float | Callable[[Series, Series], float]


@dataclass(frozen=True, eq=False)
class SeriesSet:
    """Time series of many cells.

    Attributes
    ----------
    cells : (n,) int32
        Cell numbers, in the order they were asked for.
    offsets : (n + 1,) int64
        The periods of ``cells[i]`` are at ``offsets[i]:offsets[i + 1]`` of the following.
    start_ns, stop_ns : (n_periods,) int64
    value : (n_periods,) float32
        P(occupied).
    """

    cells: NDArray[np.int32]
    offsets: NDArray[np.int64]
    start_ns: NDArray[np.int64]
    stop_ns: NDArray[np.int64]
    value: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, i: int) -> Series:
        where = slice(int(self.offsets[i]), int(self.offsets[i + 1]))
        return Series(self.start_ns[where], self.stop_ns[where], self.value[where])


def time_series(history: History, cells: NDArray[np.int32]) -> SeriesSet:
    """The leaves of the chosen cells' time indexes as time series (Fig. 8), within the period.

    A look stands for one scan period: an interval lasts until a scan period after its last look, or until the
    next interval begins. Otherwise a cell that was looked at once would have been observed for no time.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    cells : (n,) int32
        Cell numbers of `history.tiles`, each once.
    """
    return Intervals.of(history).series(cells)


@dataclass(frozen=True, eq=False)
class Intervals:
    """The intervals of a history as they are now, from which series of any cells can be taken, by threads too.

    Attributes
    ----------
    sets : list of Runs
        From oldest to newest.
    stamps_ns : (n_scans,) int64
    first_scan, last_scan : int
        The period.
    look_ns : int
        What a look stands for.
    """

    sets: list[Runs]
    stamps_ns: NDArray[np.int64]
    first_scan: int
    last_scan: int
    look_ns: int

    @classmethod
    def of(cls, history: History, look: int | None = None) -> Intervals:
        """Those of the history's period; a look stands for `look` nanoseconds, by default for a scan period."""
        period = (history.first_scan, history.last_scan)
        return cls(list(history.runs()), history.stamps_ns, *period, look or look_ns(history))

    def series(self, cells: NDArray[np.int32]) -> SeriesSet:
        """See `time_series`."""
        cells = np.asarray(cells, dtype=np.int32)
        period = (self.first_scan, self.last_scan)
        found = []
        for runs in self.sets:
            at = np.searchsorted(runs.cells, cells)
            at[at == len(runs.cells)] = 0
            found.append(np.where(runs.cells[at] == cells, at, -1) if len(runs.cells) else np.full_like(at, -1))
        n_periods = np.zeros(len(cells), dtype=np.int64)
        for runs, at in zip(self.sets, found, strict=True):
            count_periods(at, runs.offsets, runs.first, runs.last, *period, n_periods)
        offsets = np.append(0, np.cumsum(n_periods)).astype(np.int64)
        start_ns, stop_ns = np.empty((2, offsets[-1]), dtype=np.int64)
        value = np.empty(offsets[-1], dtype=np.float32)
        begin, next_place = offsets[:-1], offsets[:-1].copy()
        for runs, at in zip(self.sets, found, strict=True):
            stamps = (self.stamps_ns, self.look_ns)
            append_periods(at, *runs[1:], *period, *stamps, begin, next_place, start_ns, stop_ns, value)
        return SeriesSet(cells, offsets, start_ns, stop_ns, value)


def look_ns(history: History) -> int:
    """What a look stands for, in nanoseconds: one scan period."""
    period_s = history.scan_period_s
    return round((period_s if period_s > 0 else FALLBACK_LOOK_S) * NS_PER_S)


def ever_occupied(history: History, above: float = OCCUPIED_ABOVE) -> NDArray[np.bool_]:
    """Per cell number, whether the cell's P(occupied) was above `above` at some time of the period."""
    found = np.zeros(history.tiles.n_cells, dtype=np.bool_)
    for runs in history.runs():
        mark_above(*runs, history.first_scan, history.last_scan, above, found)
    return found


def series_distances(
    series: SeriesSet,
    left: NDArray[np.int64],
    right: NDArray[np.int64],
    *,
    distance: Distance = "manhattan",
    min_common_s: float = PaperConfig.min_common_s,
) -> NDArray[np.float64]:
    """How far apart the series of each pair are over the time in which both cells were seen.

    Parameters
    ----------
    series : SeriesSet
    left, right : (n_pairs,) int64
        Which of `series` make a pair.
    distance : "manhattan", "jaccard", a number, or a callable
        ``"manhattan"`` is 1; a number is the p of the Minkowski distance, above 0; a callable is given two
        `Series` and returns the distance, NaN if unknown.
    min_common_s : float, seconds
        Pairs seen together for a shorter time have no distance.

    Returns
    -------
    (n_pairs,) float64
        Of Minkowski: ``(integral of |difference|**p dt / common time) ** (1 / p)``, in units of P(occupied).
        Of Jaccard: ``1 - time both were occupied / time either was``. NaN where unknown.

    Raises
    ------
    ConfigError
        Another distance, or a negative `min_common_s`.

    Notes
    -----
    Section IV.C.1a sums over samples and leaves open what two cells that were seen at different times have in
    common; we integrate over the time both were seen and divide by it.
    """
    if not 0 <= min_common_s < math.inf:
        raise ConfigError(f"min_common_s = {min_common_s!r} cannot work; wanted seconds, 0 or more")
    p = 1.0
    if distance not in ("manhattan", "jaccard") and not callable(distance):
        if isinstance(distance, str) or not 0 < distance < math.inf:
            raise ConfigError(
                f"distance = {distance!r} cannot work; wanted 'manhattan', 'jaccard', a p above 0, or a callable"
            )
        p = float(distance)
    value = (series.value > OCCUPIED_ABOVE).astype(np.float32) if distance == "jaccard" else series.value
    integral = np.empty(len(left))
    common_ns, either_ns = np.empty((2, len(left)), dtype=np.int64)
    pairs = (np.asarray(left, dtype=np.int64), np.asarray(right, dtype=np.int64))
    periods = (series.offsets, series.start_ns, series.stop_ns, value)
    pair_distances(*periods, *pairs, p, OCCUPIED_ABOVE, integral, common_ns, either_ns)
    known = (common_ns > 0) & (common_ns >= min_common_s * NS_PER_S)
    distances = np.full(len(left), math.nan)
    if callable(distance):
        for k in np.flatnonzero(known):
            distances[k] = distance(series[int(left[k])], series[int(right[k])])
    elif distance == "jaccard":
        known &= either_ns > 0
        distances[known] = integral[known] / (either_ns[known] / NS_PER_S)
    else:
        distances[known] = (integral[known] / (common_ns[known] / NS_PER_S)) ** (1 / p)
    return distances


def series_distance(
    first: Series, second: Series, *, distance: Distance = "manhattan", min_common_s: float = 0.0
) -> float:
    """The distance of two series; see `series_distances`.

    >>> import numpy as np
    >>> def periods(*triples):
    ...     start_s, stop_s, value = np.array(triples).T
    ...     return Series((start_s * 1e9).astype(np.int64), (stop_s * 1e9).astype(np.int64), np.float32(value))
    >>> closed = periods((0, 10, 1), (10, 20, 0))
    >>> seen_later = periods((8, 12, 1))
    >>> series_distance(closed, seen_later), series_distance(closed, seen_later, min_common_s=5)
    (0.5, nan)
    """
    start_ns, stop_ns = (np.concatenate([first[k], second[k]]).astype(np.int64) for k in (0, 1))
    value = np.concatenate([first.value, second.value]).astype(np.float32)
    offsets = np.cumsum([0, len(first.value), len(second.value)], dtype=np.int64)
    both = SeriesSet(np.arange(2, dtype=np.int32), offsets, start_ns, stop_ns, value)
    pair = np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.int64)
    return float(series_distances(both, *pair, distance=distance, min_common_s=min_common_s)[0])


def neighbouring_pairs(
    rows: Iterable[int] | NDArray[np.int32], cols: Iterable[int] | NDArray[np.int32], neighbourhood: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which of some distinct cells, sorted by row and col, touch: each pair once, the smaller index first.

    >>> [pair.tolist() for pair in neighbouring_pairs([0, 0, 1], [0, 1, 2], 8)]
    [[0, 1], [1, 2]]
    """
    if neighbourhood not in (4, 8):
        raise ConfigError(f"neighbourhood = {neighbourhood!r} cannot work; wanted 4 or 8")
    rows, cols = (np.asarray(places, dtype=np.int64) for places in (rows, cols))
    if not len(rows):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    width = int(cols.max() - cols.min()) + 3  # one column of padding: a row's end touches no other row's begin
    key = (rows - rows.min()) * width + (cols - cols.min())
    left, right = [], []
    for step in (1, width, width - 1, width + 1)[: neighbourhood // 2]:
        found = np.minimum(np.searchsorted(key, key + step), len(key) - 1)
        touches = np.flatnonzero(key[found] == key + step)
        left.append(touches)
        right.append(found[touches])
    order = np.lexsort((np.concatenate(right), np.concatenate(left)))
    return np.concatenate(left)[order], np.concatenate(right)[order]
