"""What is on the move: occupied now, yet neither wall nor configuration (paper, section IV.C.2, Fig. 11)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration, static_cells
from tempog.analysis.static import CellClass, static_map
from tempog.errors import ConfigError, TimeError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.grid.segments import Runs
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
    in_free_places: bool = False,
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
    in_free_places : bool
        Whether what is at a configuration that is known to be free at the time counts: somebody in the open door.

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
    return _at_scans(history, np.array([scan]), walls, configurations, near_m, in_free_places)[0]


def high_dynamics(
    history: History,
    every_s: float = 0.0,
    *,
    walls: NDArray[np.int8] | None = None,
    configurations: Sequence[Configuration] = (),
    near_m: float = 0.0,
    in_free_places: bool = False,
) -> list[HighDynamic]:
    """Fig. 11 for the measurements of a whole period, in one go.

    Parameters
    ----------
    history : History
        A grid, a saved map, or a window of either.
    every_s : float, seconds
        Least time from one chosen measurement to the next; 0 for all of them.
    walls, configurations, near_m, in_free_places
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
    return _at_scans(history, scans, walls, configurations, near_m, in_free_places)


def moving_intervals(
    history: History,
    *,
    walls: NDArray[np.int8],
    configurations: Sequence[Configuration] = (),
    near_m: float = 0.0,
    in_free_places: bool = False,
) -> Runs:
    """When each cell was occupied by something on the move: what `high_dynamics` says of all scans, as intervals.

    Parameters
    ----------
    history : History
        A grid or a saved map, not a window.
    walls, configurations, near_m, in_free_places
        As in `high_dynamic`.

    Returns
    -------
    Runs
        Values are 1. An interval in a place that was free for only a part of it is cut to that.
    """
    explained = _explained(history, walls, configurations, near_m, in_free_places)
    parts = []
    for runs in history.runs():
        cells = runs.cell
        kept = (runs.value > OCCUPIED_ABOVE) & ~explained[cells]
        parts.append(np.stack([cells[kept], runs.first[kept], runs.last[kept]]))
    cell, first, last = np.concatenate([np.empty((3, 0), np.int32), *parts], axis=1)
    if in_free_places:
        disc = _disc(history, near_m)
        for configuration in configurations:
            mine = np.sort(_numbers(history, _spread_over(configuration.cells, disc)))
            at = np.minimum(np.searchsorted(mine, cell), max(len(mine) - 1, 0))
            there = mine[at] == cell if len(mine) else np.zeros(len(cell), dtype=np.bool_)
            since, until = _free_scans(history, configuration)
            begin = np.searchsorted(until, first[there], side="left")
            lasted = np.maximum(np.searchsorted(since, last[there], side="right") - begin, 0)
            which = np.arange(int(lasted.sum())) - np.repeat(np.cumsum(lasted) - lasted - begin, lasted)
            cut = (
                np.repeat(cell[there], lasted),
                np.maximum(np.repeat(first[there], lasted), since[which]),
                np.minimum(np.repeat(last[there], lasted), until[which]),
            )
            cell, first, last = (
                np.concatenate([rest[~there], part]).astype(np.int32)
                for rest, part in zip((cell, first, last), cut, strict=True)
            )
    order = np.lexsort((first, cell))
    cell, first, last = cell[order], first[order], last[order]
    return Runs.of(cell, first, last, np.ones(len(cell), dtype=np.float32))


def _free_scans(history: History, configuration: Configuration) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first and last scans of the periods in which a place is known to be free."""
    free = [period for period in configuration.periods if period.state == "free"]
    since, until = (
        np.searchsorted(history.stamps_ns, np.array([period[k] for period in free], dtype=np.int64), side="left")
        for k in (0, 1)
    )
    some = since < until
    return since[some], until[some] - 1


def _explained(
    history: History,
    walls: NDArray[np.int8],
    configurations: Sequence[Configuration],
    near_m: float,
    in_free_places: bool,
) -> NDArray[np.bool_]:
    """Per cell number, whether what is there is a wall or glass, or else a configuration, or near one."""
    explained = static_cells(history, walls) | static_cells(history, walls, CellClass.UNCERTAIN)
    if not in_free_places:
        for configuration in configurations:
            explained[_numbers(history, configuration.cells)] = True
    return near_cells(history, explained, near_m)


def _at_scans(
    history: History,
    scans: NDArray[np.int64],
    walls: NDArray[np.int8] | None,
    configurations: Sequence[Configuration],
    near_m: float,
    in_free_places: bool,
) -> list[HighDynamic]:
    """Fig. 11 at chosen scans, given by their numbers in rising order."""
    if not 0 <= near_m < np.inf:
        raise ConfigError(f"near_m = {near_m!r} cannot work; wanted metres, 0 or more")
    if walls is None:
        walls = static_map(history, weight="interval")
    explained = _explained(history, walls, configurations, near_m, in_free_places)
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
    where, numbers = np.concatenate(at), np.concatenate(moving)
    if in_free_places:
        kept = ~_in_taken_places(history, history.stamps_ns[scans[where]], numbers, configurations, near_m)
        where, numbers = where[kept], numbers[kept]
    rows, cols = history.tiles.rows_cols(numbers)
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


def _numbers(history: History, cells: NDArray[np.int32]) -> NDArray[np.int64]:
    """Numbers of those of some cells, (n, 2) row and col, that the history has."""
    numbers = np.array([history.tiles.cell_number(row, col) for row, col in cells.tolist()], dtype=np.int64)
    return np.asarray(numbers[numbers != NO_CELL])


def _in_taken_places(
    history: History,
    stamps_ns: NDArray[np.int64],
    numbers: NDArray[np.int32],
    configurations: Sequence[Configuration],
    near_m: float,
) -> NDArray[np.bool_]:
    """For each cell at a time: whether it is at a configuration that is not known to be free then."""
    disc = _disc(history, near_m)
    order = np.argsort(numbers, kind="stable")
    taken = np.zeros(len(numbers), dtype=np.bool_)
    for configuration in configurations:
        mine = _numbers(history, _spread_over(configuration.cells, disc))
        begin, end = (np.searchsorted(numbers, mine, side=side, sorter=order) for side in ("left", "right"))
        which = np.concatenate([np.empty(0, np.int64), *(order[a:b] for a, b in zip(begin, end, strict=True))])
        free = [period for period in configuration.periods if period.state == "free"]
        since, until = (np.array([period[k] for period in free], dtype=np.int64) for k in (0, 1))
        at = np.searchsorted(since, stamps_ns[which], side="right") - 1
        is_free = np.zeros(len(which), dtype=np.bool_)
        is_free[at >= 0] = stamps_ns[which][at >= 0] < until[at[at >= 0]]
        taken[which[~is_free]] = True
    return taken


def _disc(history: History, near_m: float) -> NDArray[np.int64]:
    """Steps in row and col, (n, 2), to all cells whose centres are so near."""
    reach = near_m / history.tiles.spec.resolution_m + 1e-9
    steps = np.arange(-int(reach), int(reach) + 1)
    up, right = np.meshgrid(steps, steps, indexing="ij")
    return np.asarray(np.stack([up, right], axis=-1)[up**2 + right**2 <= reach**2])


def _spread_over(cells: NDArray[np.int32], steps: NDArray[np.int64]) -> NDArray[np.int32]:
    """All cells that are some step from some cell, each once."""
    return np.unique((cells[:, None] + steps).reshape(-1, 2), axis=0).astype(np.int32)


def near_cells(history: History, marked: NDArray[np.bool_], reach_m: float) -> NDArray[np.bool_]:
    """Per cell number: whether the centre of a marked cell is within `reach_m`."""
    from scipy.ndimage import distance_transform_edt

    if not marked.any() or reach_m == 0:  # nothing to measure a distance to, or none to measure
        return marked
    cells_away = distance_transform_edt(~history.tiles.to_dense(marked, False))
    return np.asarray(history.tiles.from_dense(cells_away <= reach_m / history.tiles.spec.resolution_m + 1e-9))
