"""Two histories that must give the same answers, to the last bit."""

from __future__ import annotations

import itertools
import math

import numpy as np

from fed_grid import moment
from tempog.analysis.dynamics import map_dynamics
from tempog.analysis.occupancy import occupancy_grid
from tempog.analysis.series import time_series
from tempog.analysis.static import static_map
from tempog.grid.history import History
from tempog.sensing.surfaces import SurfaceMemory

HOLDS = [None, 0.0, 100e-6, 0.1505, 1.0005, 3.0005, math.inf]
COUNTS = ("n_scans", "n_intervals", "n_cells", "duration_s", "first_scan", "last_scan", "extent", "gap_s")


def moments_of_interest(stamps_ns: list[int]) -> list[int]:
    """Every stamp, the nanoseconds beside it, and times far outside."""
    beside = {stamp + off for stamp in stamps_ns for off in (-1, 0, 1)}
    return sorted(beside | {stamps_ns[0] - 10**10, stamps_ns[-1] + 10**10})


def assert_same_states(got: History, wanted: History, t_ns: int, hold: float | None) -> None:
    """The map at a moment."""
    mine, theirs = got.at(moment(t_ns), hold), wanted.at(moment(t_ns), hold)
    assert mine[2:] == theirs[2:]
    np.testing.assert_array_equal(mine.value, theirs.value)
    np.testing.assert_array_equal(mine.age_s, theirs.age_s)


def assert_same_analyses(got: History, wanted: History) -> None:
    """Counts, and what analyses make of the period."""
    for name in COUNTS:
        assert getattr(got, name) == getattr(wanted, name), name
    np.testing.assert_array_equal(got.stamps_ns, wanted.stamps_ns)
    np.testing.assert_array_equal(got.poses, wanted.poses)
    for measure, weight in itertools.product(("mad", "std"), ("duration", "interval")):
        how = {"measure": measure, "weight": weight}
        np.testing.assert_array_equal(map_dynamics(got, **how), map_dynamics(wanted, **how))
        np.testing.assert_array_equal(static_map(got, **how), static_map(wanted, **how))
    np.testing.assert_array_equal(occupancy_grid(got), occupancy_grid(wanted))


def assert_same_series(got: History, wanted: History) -> None:
    """Time series of all cells, of which many were never seen."""
    cells = [lattice_cells(history) for history in (got, wanted)]
    np.testing.assert_array_equal(*cells)
    series = [
        time_series(history, history.tiles.cell_numbers(*mine.T.astype(np.int32)))
        for history, mine in zip((got, wanted), cells, strict=True)
    ]
    for name in ("offsets", "start_ns", "stop_ns", "value"):
        np.testing.assert_array_equal(*(getattr(one, name) for one in series), name)


def lattice_cells(history: History) -> np.ndarray:
    """Row and col of every cell of a history's tiles, sorted."""
    rows, cols = history.tiles.rows_cols(np.arange(history.tiles.n_cells, dtype=np.int32))
    return np.unique(np.stack([rows, cols], axis=-1), axis=0)


def assert_same_cells(got: History, wanted: History, cells: list[tuple[int, int]]) -> None:
    """The histories of some lattice cells."""
    for row, col in cells:
        (x, y), *_ = wanted.tiles.spec.centres([row], [col])
        mine, theirs = got.history(x, y), wanted.history(x, y)
        for name in ("start_ns", "stop_ns", "value", "gaps"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name), f"{name} of {row, col}")


def assert_same_changes(got: History, wanted: History, t0_ns: int, t1_ns: int, hold: float) -> None:
    """What changed between two moments."""
    mine, theirs = (history.changes(moment(t0_ns), moment(t1_ns), hold=hold) for history in (got, wanted))
    for columns in (mine, theirs):
        assert len(np.unique(columns.points_map, axis=0)) == len(columns.points_map)
    order = [np.lexsort(columns.points_map.T) for columns in (mine, theirs)]
    for a, b in zip(mine, theirs, strict=True):
        np.testing.assert_array_equal(a[order[0]], b[order[1]])


def assert_same_intervals(got: History, wanted: History) -> None:
    """All intervals, by cell and time."""
    tables = []
    for history in (got, wanted):
        runs = history.all_runs()
        assert (np.diff(runs.cells) > 0).all()
        rows, cols = history.tiles.rows_cols(runs.cell)
        order = np.lexsort((runs.first, cols, rows))
        tables.append([column[order] for column in (rows, cols, runs.first, runs.last, runs.value)])
    for a, b in zip(*tables, strict=True):
        np.testing.assert_array_equal(a, b)


def assert_same_surfaces(got: SurfaceMemory, wanted: SurfaceMemory, *, with_lines: bool = False) -> None:
    """Hit statistics of every numbered cell; slots may be in another order."""
    names = ("cell_of_slot", "hit_count", "moments", *(["lines"] if with_lines else []))
    order = [np.argsort(one.cell_of_slot[: one.n_slots]) for one in (got, wanted)]
    for name in names:
        np.testing.assert_array_equal(getattr(got, name)[order[0]], getattr(wanted, name)[order[1]], name)
    for one in (got, wanted):
        slots = np.arange(one.n_slots)
        np.testing.assert_array_equal(one.slot_of_cell[one.cell_of_slot[slots]], slots)
