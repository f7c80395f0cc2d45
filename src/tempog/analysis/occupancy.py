"""The ordinary occupancy grid, one number per cell: the baseline (paper, Fig. 14)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.kernels import add_logodds
from tempog.errors import ConfigError
from tempog.grid.history import History

# Clamping keeps the map able to change its mind; these are OctoMap's limits (Hornung et al. 2013).
CLAMP_PROB_LOW = 0.12
CLAMP_PROB_HIGH = 0.97


def occupancy_grid(
    grid: History, *, prob_low: float = CLAMP_PROB_LOW, prob_high: float = CLAMP_PROB_HIGH
) -> NDArray[np.float32]:
    """The classic occupancy grid: log-odds updated measurement by measurement, and clamped.

    Parameters
    ----------
    grid : History
        A grid, a saved map, or a window of either.
    prob_low, prob_high : float, 0..1
        Limits of P(occupied) that the log-odds are clamped to.

    Returns
    -------
    (n_rows, n_cols) float32, 0..1
        P(occupied) at the end of the period. Row 0 is the southern edge; NaN where never observed.

    Raises
    ------
    ConfigError
        Limits that do not lie around one half.

    Notes
    -----
    Made from the history (section VI): an interval counts as one measurement per scan from its first to its
    last, so a cell that was skipped by some scans in between counts them too. Clamping makes the difference
    small: a handful of measurements reaches a limit either way.
    """
    if not 0 < prob_low < 0.5 < prob_high < 1:
        raise ConfigError(
            f"prob_low = {prob_low!r}, prob_high = {prob_high!r} cannot work; wanted 0 < low < 0.5 < high < 1"
        )
    lowest, highest = (math.log(prob / (1 - prob)) for prob in (prob_low, prob_high))
    seen = np.zeros(grid.tiles.n_cells, dtype=np.bool_)
    logodds = np.zeros(grid.tiles.n_cells)
    for runs in grid.runs():
        add_logodds(*runs, grid.first_scan, grid.last_scan, lowest, highest, seen, logodds)
    prob = (1 / (1 + np.exp(-logodds))).astype(np.float32)
    prob[~seen] = np.nan
    return grid.tiles.to_dense(prob, math.nan)
