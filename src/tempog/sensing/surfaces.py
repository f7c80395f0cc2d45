"""Where inside each cell the hits fell: count, mean and covariance, kept while mapping.

The surface model asks whether a beam really crossed a cell's surface; analyses ask whether a surface
returned to the same place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tempog._arrays import grown

NO_SLOT = -1


class SurfaceMemory:
    """Hit-point statistics, one slot per cell that was ever hit.

    Attributes
    ----------
    slot_of_cell : (n_cells,) int32
        Slot of a numbered cell, or NO_SLOT.
    cell_of_slot : (capacity,) int32
    hit_count : (capacity,) int32
        Beams that ended in the cell.
    moments : (capacity, 5) float32
        Mean x and y of the hit points, metres from the cell's centre; then their population covariance
        xx, xy, yy in square metres.
    lines : (capacity, 3) float32
        Line through the hit points: its direction as a unit vector, and how far they reach to either side of
        their mean, metres. They follow from the moments; only the surface model keeps them while mapping.
    n_slots : int
        Slots in use.
    """

    def __init__(self) -> None:
        self.slot_of_cell: NDArray[np.int32] = np.empty(0, dtype=np.int32)
        self.cell_of_slot: NDArray[np.int32] = np.empty(0, dtype=np.int32)
        self.hit_count: NDArray[np.int32] = np.empty(0, dtype=np.int32)
        self.moments: NDArray[np.float32] = np.empty((0, 5), dtype=np.float32)
        self.lines: NDArray[np.float32] = np.empty((0, 3), dtype=np.float32)
        self.n_slots = 0

    @classmethod
    def of(
        cls,
        n_cells: int,
        cells: NDArray[np.int32],
        hit_count: NDArray[np.int32],
        moments: NDArray[np.float32],
    ) -> SurfaceMemory:
        """What is known of some of `n_cells` cells: slots in the order of `cells`, and the lines that follow."""
        from tempog.sensing.cells import find_lines

        surfaces = cls()
        surfaces.reserve(n_cells, 0)
        surfaces.n_slots = len(cells)
        surfaces.cell_of_slot, surfaces.hit_count, surfaces.moments = cells, hit_count, moments
        surfaces.lines = np.zeros((len(cells), 3), dtype=np.float32)
        find_lines(moments, surfaces.lines)
        surfaces.slot_of_cell[cells] = np.arange(len(cells), dtype=np.int32)
        return surfaces

    def reserve(self, n_cells: int, n_more: int) -> None:
        """Room for cell numbers below `n_cells` and for `n_more` new slots."""
        if n_cells > len(self.slot_of_cell):
            self.slot_of_cell = grown(self.slot_of_cell, n_cells + n_cells // 4, fill=NO_SLOT)
        needed = self.n_slots + n_more
        if needed > len(self.hit_count):
            capacity = needed + needed // 2
            self.cell_of_slot = grown(self.cell_of_slot, capacity)
            self.hit_count = grown(self.hit_count, capacity)
            self.moments = grown(self.moments, capacity)
            self.lines = grown(self.lines, capacity)

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        parts = (self.slot_of_cell, self.cell_of_slot, self.hit_count, self.moments, self.lines)
        return sum(part.nbytes for part in parts)


def pooled(
    n_cells: int, parts: Sequence[tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]]
) -> SurfaceMemory:
    """The statistics of several sets of hits as of one: cells, hit counts and moments of each (Chan et al. 1979)."""
    total = np.zeros(n_cells)
    moments = np.zeros((n_cells, 5))
    for cells, counts, of_part in parts:
        n_before, n_part = total[cells], counts.astype(np.float64)
        share = n_part / (n_before + n_part)
        x, y = (of_part[:, k] - moments[cells, k] for k in (0, 1))
        between = np.stack([x * x, x * y, y * y], axis=-1) * (share * (1 - share))[:, None]
        moments[cells, :2] += np.stack([x, y], axis=-1) * share[:, None]
        moments[cells, 2:] += (of_part[:, 2:] - moments[cells, 2:]) * share[:, None] + between
        total[cells] += n_part
    cells = np.flatnonzero(total).astype(np.int32)
    return SurfaceMemory.of(n_cells, cells, total[cells].astype(np.int32), moments[cells].astype(np.float32))
