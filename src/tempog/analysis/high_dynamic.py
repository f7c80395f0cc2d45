"""What is on the move: occupied now, yet neither wall nor configuration (paper, section IV.C.2, Fig. 11)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration, static_cells
from tempog.analysis.static import static_map
from tempog.errors import ConfigError, TimeError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.sensing.tiles import NO_CELL
from tempog.times import NS_PER_S, Moment

ROUNDING_NS = 500_000  # stamps of a steady clock are off by rounding
LONGEST_NS = 2**62  # 146 years; two of them still fit int64


class HighDynamic(NamedTuple):
    """Cells that something on the move occupied at one measurement.

    Attributes
    ----------
    stamp_ns : int
        Of the measurement.
    cells : (n, 2) int32
        Lattice row and col, sorted.
    points_map : (n, 2) float64, metres
        x and y of the cells' centres.
    """

    stamp_ns: int
    cells: NDArray[np.int32]
    points_map: NDArray[np.float64]


def high_dynamic(
    history: History,
    at: Moment | None = None,
    *,
    walls: NDArray[np.int8] | None = None,
    configurations: Sequence[Configuration] = (),
    near_m: float = 0.0,
) -> HighDynamic:
    """Occupied cells of one measurement that are neither static nor part of a configuration (Fig. 11).

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    at : moment, optional
        The latest measurement at or before it. Default: the period's last.
    walls : (n_rows, n_cols) int8, optional
        A `static_map` of `history`. Default: Fig. 6 to the letter, each interval counted once.
    configurations : sequence of Configuration
    near_m : float, metres
        Cells whose centres are this close to a static cell's or a configuration's are left out, too.

    Raises
    ------
    TimeError
        No measurement at or before `at` in the period.
    ConfigError
        `walls` of another extent, `at` is no moment, or `near_m` is negative.

    Notes
    -----
    A history keeps intervals, not scans: a cell that the measurement skipped counts as seen by it if the cell's
    interval goes on afterwards.
    """
    history.require_scans()
    stamps, scan = history.stamps_ns, history.last_scan
    if at is not None:
        stamp_ns = history.parse_moment(at)
        scan = min(scan, int(np.searchsorted(stamps, stamp_ns, side="right")) - 1)
        if scan < history.first_scan:
            first = history.format_moment(int(stamps[history.first_scan]))
            raise TimeError(
                f"no measurement at or before {history.format_moment(stamp_ns)}: the first is at {first};"
                " choose a later moment"
            )
    return _at_scans(history, np.array([scan]), walls, configurations, near_m)[0]


def high_dynamics(
    history: History,
    every_s: float = 0.0,
    *,
    walls: NDArray[np.int8] | None = None,
    configurations: Sequence[Configuration] = (),
    near_m: float = 0.0,
) -> list[HighDynamic]:
    """Fig. 11 for the measurements of a whole period, in one go.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    every_s : float, seconds
        Least time from one chosen measurement to the next; 0 for all of them.
    walls, configurations, near_m
        As in `high_dynamic`.
    """
    history.require_scans()
    if not 0 <= every_s < np.inf:
        raise ConfigError(f"every_s = {every_s!r} cannot work; wanted seconds, 0 or more")
    scans = np.arange(history.first_scan, history.last_scan + 1)
    if every_s > 0:
        elapsed_ns = history.stamps_ns[scans] - history.stamps_ns[scans[0]]
        step_ns = int(min(every_s * NS_PER_S, LONGEST_NS)) - ROUNDING_NS
        chosen, after = [], 0
        while after < len(scans):
            chosen.append(after)
            after = max(after + 1, int(np.searchsorted(elapsed_ns, elapsed_ns[after] + step_ns)))
        scans = scans[chosen]
    return _at_scans(history, scans, walls, configurations, near_m)


def _at_scans(
    history: History,
    scans: NDArray[np.int64],
    walls: NDArray[np.int8] | None,
    configurations: Sequence[Configuration],
    near_m: float,
) -> list[HighDynamic]:
    """Fig. 11 at chosen scans, given by their numbers in rising order."""
    if not 0 <= near_m < np.inf:
        raise ConfigError(f"near_m = {near_m!r} cannot work; wanted metres, 0 or more")
    if walls is None:
        walls = static_map(history, weight="interval")
    explained = static_cells(history, walls)
    for configuration in configurations:
        numbers = [history.tiles.cell_number(row, col) for row, col in configuration.cells.tolist()]
        explained[[number for number in numbers if number != NO_CELL]] = True
    if near_m > 0:
        explained = _widened(history, explained, near_m)
    at, moving = [np.empty(0, np.int64)], [np.empty(0, np.int32)]
    for runs in history.runs():
        cells = np.repeat(runs.cells, np.diff(runs.offsets))
        kept = (runs.value > OCCUPIED_ABOVE) & ~explained[cells]
        begin = np.searchsorted(scans, runs.first[kept], side="left")
        end = np.searchsorted(scans, runs.last[kept], side="right")
        lasted = end - begin  # in chosen scans
        before = np.cumsum(lasted) - lasted
        moving.append(np.repeat(cells[kept], lasted))
        at.append(np.arange(int(lasted.sum())) - np.repeat(before - begin, lasted))
    where = np.concatenate(at)
    rows, cols = history.tiles.rows_cols(np.concatenate(moving))
    order = np.lexsort((cols, rows, where))
    where, places = where[order], np.stack([rows, cols], axis=-1)[order]
    bounds = np.searchsorted(where, np.arange(len(scans) + 1))
    points = history.tiles.spec.centres(places[:, 0], places[:, 1])
    return [
        HighDynamic(
            int(history.stamps_ns[scan]), places[bounds[k] : bounds[k + 1]], points[bounds[k] : bounds[k + 1]]
        )
        for k, scan in enumerate(scans.tolist())
    ]


def _widened(history: History, marked: NDArray[np.bool_], reach_m: float) -> NDArray[np.bool_]:
    """Per cell number: whether the centre of a marked cell is within `reach_m`."""
    from scipy.ndimage import distance_transform_edt

    if not marked.any():  # nothing to measure a distance to
        return marked
    cells_away = distance_transform_edt(~history.tiles.to_dense(marked, False))
    return np.asarray(history.tiles.from_dense(cells_away <= reach_m / history.tiles.spec.resolution_m + 1e-9))
