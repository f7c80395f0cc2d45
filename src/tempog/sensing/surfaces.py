"""Where inside each cell the hits fell: count, mean and covariance, kept while mapping.

The surface model asks whether a beam really crossed a cell's surface; analyses ask whether a surface
returned to the same place.
"""

from __future__ import annotations

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
        their mean, metres. Kept by the surface model while mapping, not saved.
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
