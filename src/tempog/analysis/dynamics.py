"""How much each cell's occupancy changes (paper, section IV.A, Fig. 5)."""

from __future__ import annotations

import math
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.kernels import add_deviations, add_sums
from tempog.config import Measure, Weight
from tempog.errors import ConfigError
from tempog.grid.history import History
from tempog.times import NS_PER_S

FALLBACK_LOOK_S = 1.0  # s; what a single look counts for in a history of one scan, which has no scan period


class CellMoments(NamedTuple):
    """Mean and spread of every numbered cell's values; NaN where the cell was never observed."""

    mean: NDArray[np.float64]
    spread: NDArray[np.float64]


def map_dynamics(grid: History, *, measure: Measure = "mad", weight: Weight = "duration") -> NDArray[np.float32]:
    """How much each cell's occupancy changes: 0 never, 0.5 as much as possible.

    Parameters
    ----------
    grid : History
        A grid, a saved map, or a window of either.
    measure : "mad" or "std"
        Mean absolute deviation (Fig. 5) or standard deviation (the text of section IV.A).
    weight : "duration" or "interval"
        ``interval`` counts each interval once however long it lasted, as Fig. 5 does. ``duration`` weighs
        it by its time within the period, plus one scan period, so that a wall is not called dynamic for
        a few stray readings.

    Returns
    -------
    (n_rows, n_cols) float32, 0..0.5, no unit
        Row 0 is the southern edge, see `grid.extent`. NaN where the cell was never observed.

    Raises
    ------
    ConfigError
        An unknown measure or weight.

    Examples
    --------
    A beam that ends 2 m away, passes, and ends there again; unweighted that is Fig. 5's 1-0-1:

    >>> from tempog import Scan, TemporalGrid, map_dynamics
    >>> grid = TemporalGrid()
    >>> for t, distance in enumerate([2.0, 3.0, 2.0]):
    ...     grid.integrate(Scan(t, (0.02, 0.02, 0.0), angles=[0.0], ranges=[distance]))
    >>> dynamics = map_dynamics(grid, weight="interval")
    >>> round(float(dynamics[grid.extent.index_of(2.02, 0.02)] / 0.8), 3)  # 0.8 from free to hit
    0.444
    """
    spread = cell_moments(grid, measure, weight).spread
    return grid.tiles.to_dense(spread.astype(np.float32), math.nan)


def cell_moments(grid: History, measure: Measure, weight: Weight) -> CellMoments:
    """Mean and spread of each numbered cell's interval values; see `map_dynamics` for the parameters."""
    for name, seen, choices in (("measure", measure, Measure), ("weight", weight, Weight)):
        if seen not in get_args(choices):
            raise ConfigError(f"{name} = {seen!r} cannot work; wanted one of {', '.join(get_args(choices))}")
    n_cells = grid.tiles.n_cells
    sum_weight, sum_value, sum_deviation = (np.zeros(n_cells) for _ in range(3))
    if grid.n_scans:
        stamps_s = (grid.stamps_ns - grid.stamps_ns[0]) / NS_PER_S
        look_s = math.nan
        if weight == "duration":
            look_s = grid.scan_period_s if grid.scan_period_s > 0 else FALLBACK_LOOK_S
        period = (grid.first_scan, grid.last_scan, stamps_s, look_s)
        for runs in grid.runs():
            add_sums(*runs, *period, sum_weight, sum_value)
        with np.errstate(invalid="ignore"):
            mean = sum_value / sum_weight
        for runs in grid.runs():
            add_deviations(*runs, *period, mean, measure == "std", sum_deviation)
    with np.errstate(invalid="ignore"):
        mean = sum_value / sum_weight
        spread = sum_deviation / sum_weight
    return CellMoments(mean, np.sqrt(spread) if measure == "std" else spread)
