"""Places that objects come to stand in: neighbouring cells that change together (paper, IV.C.1a, Fig. 7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.dynamics import cell_moments
from tempog.analysis.series import (
    Distance,
    SeriesSet,
    ever_occupied,
    neighbouring_pairs,
    series_distances,
    time_series,
)
from tempog.analysis.series_kernels import connect
from tempog.analysis.static import CellClass, static_map
from tempog.errors import ConfigError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.methods import Candidates, PaperConfig

PlaceState = Literal["occupied", "free"]
SAME_SHARE = 1e-6  # of time; P(occupied) is kept in 32 bits


class Period(NamedTuple):
    """A configuration's state from `start_ns` until just before `stop_ns`."""

    start_ns: int
    stop_ns: int
    state: PlaceState


@dataclass(frozen=True, eq=False)
class Configuration:
    """A place that something comes to stand in, and leaves.

    Attributes
    ----------
    id : int
        From 1, by row and col of the first cell.
    cells : (n, 2) int32
        Lattice row and col of each cell, sorted; may be negative.
    points_map : (n, 2) float64, metres
        x and y of the cells' centres.
    periods : tuple of Period
        What most of its cells said while enough of them were seen; gaps are times without.
    hypothesis : bool
        Whether the place is inferred, and was never seen to change.
    """

    id: int
    cells: NDArray[np.int32]
    points_map: NDArray[np.float64]
    periods: tuple[Period, ...]
    hypothesis: bool = False

    @property
    def centre_m(self) -> tuple[float, float]:
        """Mean x and y of the cells' centres, metres."""
        x, y = self.points_map.mean(axis=0).tolist()
        return x, y


def find_configurations(
    history: History,
    walls: NDArray[np.int8] | None = None,
    *,
    distance: Distance = "manhattan",
    threshold: float = PaperConfig.distance_below,
    min_common_s: float = PaperConfig.min_common_s,
    neighbourhood: int = PaperConfig.neighbourhood,
    seen_share: float = PaperConfig.seen_share,
    smallest_m: float = PaperConfig.smallest_m,
    candidates: Candidates = PaperConfig.candidates,
    least_occupied: float = PaperConfig.least_occupied,
) -> list[Configuration]:
    """Groups of neighbouring cells whose time series are close (Fig. 7), as the paper does it.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    walls : (n_rows, n_cols) int8, optional
        A `static_map` of `history`. Default: Fig. 6 to the letter, each interval counted once.
    distance, min_common_s
        See `tempog.analysis.series.series_distances`.
    threshold : float
        Neighbours whose distance is below it belong together.
    neighbourhood, seen_share, smallest_m, candidates, least_occupied
        See `tempog.methods.PaperConfig`.

    Raises
    ------
    ConfigError
        A setting that cannot work, or `walls` of another extent.

    Notes
    -----
    A cell without a neighbour like it belongs to none. Like the figure, this joins what a chain of similar
    neighbours joins.
    """
    if not threshold > 0:
        raise ConfigError(f"threshold = {threshold!r} cannot work; wanted a distance above 0")
    PaperConfig(
        neighbourhood=neighbourhood,
        seen_share=seen_share,
        smallest_m=smallest_m,
        candidates=candidates,
        least_occupied=least_occupied,
    )
    if walls is None:
        walls = static_map(history, weight="interval")
    observed = ever_occupied(history, above=OCCUPIED_ABOVE if candidates == "occupied" else 0.0)
    if least_occupied > 0:
        free, hit = history.config.sensing.prob_free, history.config.sensing.prob_hit
        with np.errstate(invalid="ignore"):
            share = (cell_moments(history, "mad", "duration").mean - free) / (hit - free)
            observed &= share >= least_occupied - SAME_SHARE
    cells = np.flatnonzero(observed & ~static_cells(history, walls)).astype(np.int32)
    rows, cols = history.tiles.rows_cols(cells)
    order = np.lexsort((cols, rows))
    cells, rows, cols = cells[order], rows[order], cols[order]
    left, right = neighbouring_pairs(rows, cols, neighbourhood)
    series = time_series(history, cells)
    distances = series_distances(series, left, right, distance=distance, min_common_s=min_common_s)
    close = distances < threshold  # an unknown distance is not below it
    group = np.arange(len(cells))
    connect(left[close], right[close], group)
    roots, group, sizes = np.unique(group, return_inverse=True, return_counts=True)
    number = np.full(len(roots), -1)
    number[sizes > 1] = np.arange(np.count_nonzero(sizes > 1))  # roots are sorted, and so are ids by first cell
    group = number[group]
    periods = combined_periods(series, group, sizes[sizes > 1], seen_share)
    members = np.split(np.argsort(group, kind="stable"), np.cumsum([np.count_nonzero(group < 0), *sizes[sizes > 1]]))
    found: list[Configuration] = []
    for k, where in enumerate(members[1:-1]):
        places = np.stack([rows[where], cols[where]], axis=-1)
        reach_m = np.hypot(*(np.ptp(places, axis=0) + 1)) * history.tiles.spec.resolution_m
        if reach_m >= smallest_m:
            points = history.tiles.spec.centres(rows[where], cols[where])
            found.append(Configuration(len(found) + 1, places, points, tuple(periods[k])))
    return found


def static_cells(history: History, walls: NDArray[np.int8], what: CellClass = CellClass.STATIC) -> NDArray[np.bool_]:
    """Per cell number, whether the cell is static, or else, in a static map over the history's extent."""
    if walls.shape != history.extent.shape:
        raise ConfigError(
            f"walls has shape {walls.shape}, the history's extent {history.extent.shape};"
            " wanted static_map of the same history"
        )
    static: NDArray[np.bool_] = history.tiles.from_dense(walls) == what
    return static


def combined_periods(
    series: SeriesSet, group: NDArray[np.int64], sizes: NDArray[np.int64], seen_share: float
) -> list[list[Period]]:
    """What most of each group's seen cells said, while `seen_share` of its cells were seen.

    group (n,) which group each series belongs to, -1 for none; sizes (n_groups,) how many belong to each.
    A tie counts as free.
    """
    owner = np.repeat(group, np.diff(series.offsets))
    used = owner >= 0
    n = int(np.count_nonzero(used))
    times = np.concatenate([series.start_ns[used], series.stop_ns[used]])
    owners = np.concatenate([owner[used]] * 2)
    step = np.repeat([1, -1], n)
    hit = np.concatenate([series.value[used] > OCCUPIED_ABOVE] * 2)
    order = np.lexsort((times, owners))
    times, owners = times[order], owners[order]
    # Every period that begins also ends, so the sums are back at zero where the next group begins.
    n_seen, n_hit = np.cumsum(step[order]), np.cumsum((step * hit)[order])
    periods: list[list[Period]] = [[] for _ in sizes]
    if not n:
        return periods
    enough = (n_seen > 0) & (n_seen >= seen_share * sizes[owners])
    state = np.where(enough, (2 * n_hit > n_seen).astype(np.int64), -1)
    settled = np.append((times[1:] != times[:-1]) | (owners[1:] != owners[:-1]), True)
    times, owners, state = times[settled], owners[settled], state[settled]
    changed = np.append(True, (state[1:] != state[:-1]) | (owners[1:] != owners[:-1]))
    times, owners, state = times[changed], owners[changed], state[changed]
    # The last entry of a group is unseen, so every other entry has a next one of its group.
    for k in np.flatnonzero(state >= 0).tolist():
        name: PlaceState = "occupied" if state[k] else "free"
        periods[int(owners[k])].append(Period(int(times[k]), int(times[k + 1]), name))
    return periods
