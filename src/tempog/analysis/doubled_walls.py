"""Walls that stood where others looked through: what poses far apart from each other make of one wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

LASTING_SCANS = 10  # in a row that a cell was occupied; who walks is gone sooner
WALL_REACH_M = 0.75  # to either side; leaves of doors, people and most furniture are shorter than twice that
WALL_SHARE = 0.6  # of a line of twice the reach is what a wall at least fills; much of it may be hidden
WALL_SPREAD_M = 0.06  # across it, as standard deviation: of cells of 0.1 m in one line, seen at a slant
LEAST_CELLS = 50  # of walls; a share of fewer says little
MOST_CELLS = 5_000  # looked at; more are thinned out evenly, since on a crowded floor each has hundreds around it


def doubled_share(
    means: NDArray[np.float64],
    hits: NDArray[np.float64],
    stands: NDArray[np.bool_],
    longest: NDArray[np.float64],
) -> float | None:
    """What share of the hits on walls fell on walls that were seen through at other times.

    Parameters
    ----------
    means : (n, 2) float64, metres
        Where the hits of each cell fell.
    hits : (n,) float64
        How many.
    stands : (n,) bool
        Whether the cell was occupied most of the time that it was seen.
    longest : (n,) float64
        For how many scans in a row it was occupied.

    Returns
    -------
    float, 0..1, or None
        None where too few walls were seen to say.

    Notes
    -----
    A wall is a cell that lasted, in a line of 1.5 m with others alike: all standing, or all seen through. A pass
    whose poses are farther off than a wall is thick sees through where the wall stood for another.
    """
    lasting = longest >= LASTING_SCANS
    doubled = _walls(means, hits, lasting & ~stands)
    standing = _walls(means, hits, lasting & stands)
    if doubled[0] + standing[0] < LEAST_CELLS:
        return None
    return doubled[1] / (doubled[1] + standing[1])


def _walls(means: NDArray[np.float64], hits: NDArray[np.float64], kept: NDArray[np.bool_]) -> tuple[float, float]:
    """How many of some cells lie in straight lines of their kind, and how many hits those have."""
    from scipy.spatial import cKDTree

    cells = np.flatnonzero(kept)
    middles = cells[:: max(1, math.ceil(len(cells) / MOST_CELLS))]
    if not len(middles):
        return 0.0, 0.0
    near = cKDTree(means[middles]).sparse_distance_matrix(cKDTree(means[cells]), WALL_REACH_M, output_type="ndarray")
    middle = near["i"]
    apart = means[cells[near["j"]]] - means[middles[middle]]
    n = np.bincount(middle, minlength=len(middles)).astype(np.float64)  # at least 1: itself
    x, y = (np.bincount(middle, apart[:, k], len(middles)) / n for k in (0, 1))
    xx, xy, yy = (
        np.bincount(middle, apart[:, a] * apart[:, b], len(middles)) / n for a, b in ((0, 0), (0, 1), (1, 1))
    )
    xx, xy, yy = xx - x * x, xy - x * y, yy - y * y
    root = np.hypot((xx - yy) / 2, xy)
    across_m2, along_m2 = (xx + yy) / 2 - root, (xx + yy) / 2 + root
    # Variance of an even line of that half length.
    wall = (along_m2 >= (WALL_SHARE * WALL_REACH_M) ** 2 / 3) & (across_m2 <= WALL_SPREAD_M**2)
    thinned = len(cells) / len(middles)
    return thinned * float(np.count_nonzero(wall)), thinned * float(hits[middles[wall]].sum())
