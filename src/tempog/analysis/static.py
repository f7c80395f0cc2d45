"""What never moves: walls, cupboards, locked doors (paper, section IV.B, Fig. 6)."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.dynamics import cell_moments
from tempog.config import Measure, Weight
from tempog.errors import ConfigError
from tempog.grid.history import History

# With hits worth 0.9 and free 0.1, a cell occupied for a share s of its observed time has mean
# 0.1 + 0.8 s and mean absolute deviation 1.6 s (1 - s). These two limits, which meet near s = 0.75, call a
# cell static that is occupied three quarters of the time: stray free readings at a wall's rim cost a few
# percent to, between passes that disagree by a cell, a quarter; a door is open for longer than that.
STATIC_DYNAMICS_BELOW = 0.3
STATIC_MEAN_ABOVE = 0.7
# A cell that is free three quarters of the time or more is floor on which something stood or passed.
FREE_MEAN_BELOW = 0.3


class CellClass(IntEnum):
    """What a cell of the static map is."""

    UNEXPLORED = -1
    FREE = 0
    STATIC = 1
    CHANGING = 2
    """Seen both occupied and free for a good part of the time: neither wall nor floor."""
    UNCERTAIN = 3
    """Occupied or free by where it is seen from: glass, or a wall's rim. Only `find_objects` tells."""


def static_map(
    grid: History,
    *,
    dynamics_below: float = STATIC_DYNAMICS_BELOW,
    mean_above: float = STATIC_MEAN_ABOVE,
    measure: Measure = "mad",
    weight: Weight = "duration",
) -> NDArray[np.int8]:
    """Which cells hold something that does not move.

    Parameters
    ----------
    grid : History
        A grid, a saved map, or a window of either.
    dynamics_below, mean_above : float, 0..0.5 and 0..1
        thres_1 and thres_2 of Fig. 6: a cell is static if its dynamics are below the first and its mean
        P(occupied) above the second.
    measure, weight
        As in `map_dynamics`; ``weight="interval"`` is the figure to the letter.

    Returns
    -------
    (n_rows, n_cols) int8, values of `CellClass`
        Row 0 is the southern edge, see `grid.extent`.

    Raises
    ------
    ConfigError
        Limits outside their range, or an unknown measure or weight.
    """
    for name, seen, top in (("dynamics_below", dynamics_below, 0.5), ("mean_above", mean_above, 1.0)):
        if not 0 <= seen <= top:
            raise ConfigError(f"{name} = {seen!r} cannot work; wanted a number from 0 to {top:g}")
    mean, dynamics = cell_moments(grid, measure, weight)
    classes = np.full(len(mean), CellClass.CHANGING, dtype=np.int8)
    classes[mean < FREE_MEAN_BELOW] = CellClass.FREE
    classes[(dynamics < dynamics_below) & (mean > mean_above)] = CellClass.STATIC
    classes[np.isnan(mean)] = CellClass.UNEXPLORED
    return grid.tiles.to_dense(classes, CellClass.UNEXPLORED)
