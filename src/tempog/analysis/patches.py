"""Patches: changed cells that stand out, in groups."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.changed_cells import ChangedCells, Looks
from tempog.analysis.configurations import Configuration
from tempog.analysis.evidence.grouping import pairs_within
from tempog.analysis.find_objects import FoundObjects
from tempog.analysis.high_dynamic import near_cells
from tempog.analysis.moved_objects import Move
from tempog.analysis.series import neighbouring_pairs
from tempog.analysis.series_kernels import connect
from tempog.analysis.static import CellClass
from tempog.grid.history import History
from tempog.sensing.grid_spec import Bounds
from tempog.sensing.tiles import NO_CELL

PatchKind = Literal["appeared", "vanished"]

SEEN_S = 0.5  # a stay that was observed for a shorter time proves nothing: `EvidenceConfig.least_stay_s`


@dataclass(frozen=True, eq=False)
class Patch:
    """Cells near each other that all became occupied, or free.

    Attributes
    ----------
    kind : "appeared" or "vanished"
    cells : (n, 2) int32
        Lattice row and col of each cell, sorted; may be negative.
    points_map : (n, 2) float64, metres
        x and y of the cells' centres.
    bounds : Bounds
        The rectangle around its cells.
    area_m2 : float
        Of the cells: of what was hit of a thing, not of what lies within it.
    last_before_ns, first_after_ns : int
        Until just before when it was seen as before, and from when on as after; the medians over its cells.
    age_before_s, age_after_s : float, seconds
        How long before each moment it was looked at last; the medians over its cells.
    watched_s : float, seconds
        For how long it was watched while it was there, breaks of up to `BREAK_S` included; the median over its
        cells. May begin before the first moment, and end after the second.
    object_id : int, optional
        A known object that has a place there.
    """

    kind: PatchKind
    cells: NDArray[np.int32]
    points_map: NDArray[np.float64]
    bounds: Bounds
    area_m2: float
    last_before_ns: int
    first_after_ns: int
    age_before_s: float
    age_after_s: float
    watched_s: float
    object_id: int | None

    @property
    def centre_m(self) -> tuple[float, float]:
        """x and y of the mean of its cells."""
        x, y = self.points_map.mean(axis=0).tolist()
        return x, y


def stands_out(
    history: History,
    found: FoundObjects,
    moved: Sequence[Move],
    changed: ChangedCells,
    looks: Looks,
    surface_m: float,
) -> NDArray[np.bool_]:
    """Which changed cells are neither glass, nor of an object that moved, nor a surface that was seen displaced."""
    walls = history.tiles.from_dense(found.walls_over(history.extent))
    explained = walls == CellClass.UNCERTAIN
    for move in moved:
        for place in move.one.configurations:
            explained[_numbers(history, place)] = True
    explained = near_cells(history, explained, found.settings.near_m)
    # What changed is free at the other moment, so it never hides itself.
    beside_before, beside_after = (
        near_cells(history, taken, surface_m) for taken in (looks.taken_before, looks.taken_after)
    )
    beside = np.where(changed.appeared, beside_before[changed.cells], beside_after[changed.cells])
    return ~explained[changed.cells] & ~beside & (changed.seen_s >= SEEN_S)


def _numbers(history: History, place: Configuration) -> NDArray[np.int32]:
    """Numbers of a place's cells."""
    numbers = history.tiles.cell_numbers(place.cells[:, 0], place.cells[:, 1])
    return np.asarray(numbers[numbers != NO_CELL])


def find_patches(
    history: History, found: FoundObjects, changed: ChangedCells, smallest_m: float, join_m: float
) -> list[Patch]:
    """Cells of one kind in groups, the largest first."""
    resolution_m = history.tiles.spec.resolution_m
    rows, cols = history.tiles.rows_cols(changed.cells)
    order = np.lexsort((cols, rows))
    changed, rows, cols = changed.chosen(order), rows[order], cols[order]
    reach = max(1, math.floor(join_m / resolution_m + 1e-9))
    groups = grouped(rows, cols, reach)
    owners = {
        (row, col): one.id
        for one in reversed(found.objects)
        for place in one.configurations
        for row, col in place.cells.tolist()
    }
    patches = []
    for which in groups:
        cells = np.stack([rows[which], cols[which]], axis=-1)
        if np.hypot(*(np.ptp(cells, axis=0) + 1)) * resolution_m < smallest_m - 1e-9:
            continue
        here = [owners[row, col] for row, col in cells.tolist() if (row, col) in owners]
        patches.append(
            Patch(
                kind="appeared" if changed.appeared[which[0]] else "vanished",
                cells=cells,
                points_map=history.tiles.spec.centres(cells[:, 0], cells[:, 1]),
                bounds=_around(cells, resolution_m),
                area_m2=len(which) * resolution_m**2,
                last_before_ns=int(np.median(changed.last_before_ns[which])),
                first_after_ns=int(np.median(changed.first_after_ns[which])),
                age_before_s=float(np.median(changed.age_before_s[which])),
                age_after_s=float(np.median(changed.age_after_s[which])),
                watched_s=float(np.median(changed.watched_s[which])),
                object_id=max(set(here), key=here.count) if 2 * len(here) > len(which) else None,
            )
        )
    return sorted(patches, key=lambda patch: -len(patch.cells))


def _around(cells: NDArray[np.int32], resolution_m: float) -> Bounds:
    (y_min, x_min), (y_max, x_max) = cells.min(axis=0) * resolution_m, (cells.max(axis=0) + 1) * resolution_m
    return Bounds(float(x_min), float(x_max), float(y_min), float(y_max))


def grouped(rows: NDArray[np.int32], cols: NDArray[np.int32], reach: int) -> list[NDArray[np.int64]]:
    """Which of some cells, sorted by row and col, are joined by steps to neighbours, or of up to `reach` cells.

    >>> rows, cols = np.array([0, 0, 1, 5]), np.array([0, 4, 1, 5])
    >>> [group.tolist() for group in grouped(rows, cols, 1)], [group.tolist() for group in grouped(rows, cols, 4)]
    ([[0, 2], [1], [3]], [[0, 1, 2], [3]])
    """
    key_rows, key_cols = rows.astype(np.int64), cols.astype(np.int64)
    left, right = pairs_within(key_rows, key_cols, reach)
    if reach == 1:  # neighbours touch at corners, too
        left, right = neighbouring_pairs(rows, cols, 8)
    parent = np.arange(len(rows))
    connect(left, right, parent)
    order = np.argsort(parent, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(parent[order])) + 1) if len(rows) else []
