"""What stands still in a map: the cells that a planner may take for walls and for floor."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.kernels import add_sums
from tempog.analysis.static import CellClass
from tempog.export.map_server import FREE, OCCUPIED, UNKNOWN
from tempog.grid.history import OCCUPIED_ABOVE, History
from tempog.methods import FOR_S, SMALLEST_M
from tempog.sensing.grid_spec import Extent
from tempog.times import NS_PER_S

T = TypeVar("T", bound=np.generic)

Cells = NDArray[np.int8]
Mask = NDArray[np.bool_]
MOSTLY = 0.5  # share of the time from which on a wall's rim belongs to the wall
RIM_M = 0.15  # on three public logs 96 % of such cells are this near a wall; the others are furniture and people
FRINGE_M = 0.1  # beside a place, hits are of the thing that stood there
TRACE_M = 1.5  # who walks along the rim of what was seen leaves a trace that is no longer
TRACE_JOIN_M = 0.2  # over the gaps between sparse hits


def planning_cells(
    classes: NDArray[np.int8],
    share: NDArray[np.float32],
    seen_s: NDArray[np.float32],
    places: Mask,
    guessed: Mask,
    resolution_m: float,
) -> Cells:
    """0, 100 or -1 for each cell: what never moves, without doors, furniture and people.

    Parameters
    ----------
    classes : (n_rows, n_cols) int8, values of `CellClass`
    share, seen_s : (n_rows, n_cols) float32
        For how much of the time it was seen a cell was occupied, and that time in seconds.
    places, guessed : (n_rows, n_cols) bool
        Cells of any place, and of those that are hypotheses.
    resolution_m : float, metres

    Notes
    -----
    - Glass is occupied, and so is the rim of a wall: cells within `RIM_M` of it that were occupied for `MOSTLY` of
      the time, since poses of different passes disagree. Else what came and went leaves floor.
    - A place is floor, since a thing that leaves takes all of itself along; one that is a hypothesis was never seen
      free, and is unknown, with what is small and beside it.
    - What stands by itself, is shorter than `TRACE_M` and was seen there for less than `FOR_S` is unknown: somebody
      who was seen once, where nobody looked again.
    """
    from scipy.ndimage import distance_transform_edt

    cells = np.full(classes.shape, UNKNOWN, dtype=np.int8)
    changing = classes == CellClass.CHANGING
    cells[(classes == CellClass.FREE) | changing] = FREE
    cells[(classes == CellClass.STATIC) | (classes == CellClass.UNCERTAIN)] = OCCUPIED
    fringe_cells = FRINGE_M / resolution_m + 1e-9
    static = classes == CellClass.STATIC
    if static.any():
        rim = distance_transform_edt(~static) <= RIM_M / resolution_m + 1e-9
        if places.any():
            rim &= distance_transform_edt(~places) > fringe_cells
        cells[changing & rim & (share >= MOSTLY)] = OCCUPIED
    cells[places] = FREE
    cells[guessed] = UNKNOWN
    stands = (cells == OCCUPIED) & (classes != CellClass.UNCERTAIN)
    if guessed.any():
        beside = distance_transform_edt(~guessed) <= fringe_cells
        cells[small_groups(stands, SMALLEST_M, 0.0, resolution_m, touching=beside)] = UNKNOWN
    watched = stands & (np.nan_to_num(share * seen_s) >= FOR_S)
    trace = small_groups(stands, TRACE_M, TRACE_JOIN_M, resolution_m)
    cells[trace & ~_with_any(stands, watched, TRACE_JOIN_M, resolution_m)] = UNKNOWN
    return cells


def _groups(cells: Mask, join_m: float, resolution_m: float) -> NDArray[np.int32]:
    """A number per group of cells that are no farther apart than `join_m`, diagonals included; 0 elsewhere."""
    from scipy.ndimage import binary_dilation, label

    n = int(join_m / 2 / resolution_m + 1e-9)
    grown = binary_dilation(cells, np.ones((2 * n + 1, 2 * n + 1))) if n else cells
    groups, _ = label(grown, np.ones((3, 3)))
    return np.where(cells, groups, 0).astype(np.int32)


def small_groups(
    cells: Mask, below_m: float, join_m: float, resolution_m: float, touching: Mask | None = None
) -> Mask:
    """Cells of groups shorter than `below_m`, corner to corner; if given, only of those that touch certain cells."""
    from scipy.ndimage import find_objects

    groups = _groups(cells, join_m, resolution_m)
    boxes = find_objects(groups)
    chosen = np.zeros(len(boxes) + 1, dtype=np.bool_)
    for k, box in enumerate(boxes):
        if box is not None:
            chosen[k + 1] = np.hypot(*(side.stop - side.start for side in box)) * resolution_m < below_m
    if touching is not None:
        touched = np.zeros_like(chosen)
        touched[np.unique(groups[touching])] = True
        chosen &= touched
    return np.asarray(chosen[groups] & cells)


def _with_any(cells: Mask, marked: Mask, join_m: float, resolution_m: float) -> Mask:
    """Cells of groups in which any is marked."""
    groups = _groups(cells, join_m, resolution_m)
    chosen = np.zeros(int(groups.max(initial=0)) + 1, dtype=np.bool_)
    chosen[np.unique(groups[marked])] = True
    return np.asarray(chosen[groups] & cells)


def cell_times(history: History, extent: Extent) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Share of the time in which each cell was occupied while it was seen, and that time in seconds; NaN if never."""
    sensing, n_cells = history.config.sensing, history.tiles.n_cells
    seen_s, value = np.zeros(n_cells), np.zeros(n_cells)
    stamps_s = (history.stamps_ns - history.stamps_ns[0]) / NS_PER_S
    look_s = history.scan_period_s if history.scan_period_s > 0 else 1.0
    for runs in history.runs():
        add_sums(*runs, history.first_scan, history.last_scan, stamps_s, look_s, seen_s, value)
    with np.errstate(invalid="ignore"):
        mean = value / seen_s
    share = np.clip((mean - sensing.prob_free) / (sensing.prob_hit - sensing.prob_free), 0, 1)
    seen_s[seen_s == 0] = np.nan
    return laid(history, share.astype(np.float32), extent, np.nan), laid(
        history, seen_s.astype(np.float32), extent, np.nan
    )


def standing_cells(history: History, at_ns: int, extent: Extent) -> Mask:
    """Cells whose latest state by a moment is occupied, and was watched for `FOR_S` until then."""
    stamps = history.stamps_ns
    until = min(history.last_scan, int(np.searchsorted(stamps, at_ns, side="right")) - 1)
    standing = np.zeros(history.tiles.n_cells, dtype=np.bool_)
    for runs in history.latest_runs(until):
        begun = np.concatenate([[0], np.cumsum(runs.first <= until)])
        count = begun[runs.offsets[1:]] - begun[runs.offsets[:-1]]
        cells, latest = runs.cells[count > 0], (runs.offsets[:-1] + count - 1)[count > 0]
        watched_ns = stamps[np.minimum(runs.last[latest], until)] - stamps[runs.first[latest]]
        in_period = runs.last[latest] >= history.first_scan
        occupied = (runs.value[latest] > OCCUPIED_ABOVE) & (watched_ns >= FOR_S * NS_PER_S)
        standing[cells[in_period]] = occupied[in_period]
    return laid(history, standing, extent, False)


def laid(history: History, per_cell: NDArray[T], extent: Extent, fill: float) -> NDArray[T]:
    """A per-cell array of a history over another extent."""
    return over(extent, history.tiles.to_dense(per_cell, fill), history.extent, fill)


def over(extent: Extent, dense: NDArray[T], where: Extent, fill: float) -> NDArray[T]:
    """An array over one extent (`where`) as one over another, with `fill` where it says nothing."""
    laid_over = np.full(extent.shape, fill, dtype=dense.dtype)
    laid_over[where.part_of(extent)] = dense[extent.part_of(where)]
    return laid_over


def seen_extent(found: FoundObjects) -> Extent | None:
    """The rectangle of all cells that were seen; None if none was."""
    seen = found.walls != CellClass.UNEXPLORED
    rows, cols = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    whole = found.extent
    n_rows, n_cols = int(rows[-1] - rows[0]) + 1, int(cols[-1] - cols[0]) + 1
    return Extent(whole.row0 + int(rows[0]), whole.col0 + int(cols[0]), n_rows, n_cols, whole.resolution_m)
