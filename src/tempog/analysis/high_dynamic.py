"""What is on the move: occupied now, yet neither wall nor configuration (paper, section IV.C.2, Fig. 11)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration, static_cells
from tempog.analysis.static import static_map
from tempog.errors import TimeError
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.sensing.tiles import NO_CELL
from tempog.times import Moment


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

    Raises
    ------
    TimeError
        No measurement at or before `at` in the period.
    ConfigError
        `walls` of another extent, or `at` is no moment.

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
    if walls is None:
        walls = static_map(history, weight="interval")
    moving = np.zeros(history.tiles.n_cells, dtype=np.bool_)
    for runs in history.runs():
        hit = (runs.value > OCCUPIED_ABOVE) & (runs.first <= scan) & (runs.last >= scan)
        moving[np.repeat(runs.cells, np.diff(runs.offsets))[hit]] = True
    moving &= ~static_cells(history, walls)
    for configuration in configurations:
        numbers = [history.tiles.cell_number(row, col) for row, col in configuration.cells.tolist()]
        moving[[number for number in numbers if number != NO_CELL]] = False
    rows, cols = history.tiles.rows_cols(np.flatnonzero(moving).astype(np.int32))
    order = np.lexsort((cols, rows))
    rows, cols = rows[order], cols[order]
    return HighDynamic(int(stamps[scan]), np.stack([rows, cols], axis=-1), history.tiles.spec.centres(rows, cols))
