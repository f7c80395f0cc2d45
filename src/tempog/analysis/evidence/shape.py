"""What shape says about two places being those of one thing: a common hinge, or near, and about as large."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.methods import EvidenceConfig

# Of a leaf's cells, as a standard deviation: half a leaf's thickness, a cell, and who leans on it.
LEAF_DEPTH_M = 0.07
LEAF_LENGTH_M = 1.6
HINGE_OFF_M = 0.15  # from a leaf's end to the line of another place of it: its thickness, and a cell
HINGE_GAP_M = 0.75  # ... and from there to the first that is seen of it: the wall hides the rest
LONGER = 1.4  # times the longer of the two: how far from the hinge a place may reach; neither is seen as a whole
LEAST_TURN_RAD = math.radians(15)  # less is no other place
# Lengths on a lattice are often just as long as a limit: with this much more, it is not rounding that decides.
ROUNDING_M = 1e-6


class Line(NamedTuple):
    """The straight line that fits some cells best, in the map frame.

    `begin_m` and `end_m` are measured along it from the middle, `depth_m` is the standard deviation across.
    """

    middle: NDArray[np.float64]
    along: NDArray[np.float64]
    begin_m: float
    end_m: float
    depth_m: float

    @property
    def length_m(self) -> float:
        """From end to end."""
        return self.end_m - self.begin_m

    @property
    def ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Both ends, x and y."""
        return self.middle + self.begin_m * self.along, self.middle + self.end_m * self.along


def fit_line(points_map: NDArray[np.float64], resolution_m: float) -> Line:
    """The line through the centres of some cells.

    >>> import numpy as np
    >>> line = fit_line(np.array([[0.05, 0.05], [0.15, 0.05], [0.25, 0.05]]), 0.1)
    >>> round(line.length_m, 3), round(line.depth_m, 3)
    (0.3, 0.0)
    """
    middle = points_map.mean(axis=0)
    centred = points_map - middle
    values, axes = np.linalg.eigh(centred.T @ centred / len(centred))
    r = centred @ axes[:, 1]
    half_m = resolution_m / 2
    depth_m = math.sqrt(max(float(values[0]), 0.0))
    return Line(middle, axes[:, 1], float(r.min()) - half_m, float(r.max()) + half_m, depth_m)


def hinges(line: Line, other: Line) -> tuple[int, ...]:
    """About which ends of the first, 0 or 1, one leaf may turn from the first line to the other.

    >>> import numpy as np
    >>> closed = fit_line(np.array([[x, 0.0] for x in np.arange(0.0, 0.9, 0.05)]), 0.05)
    >>> hinges(closed, fit_line(np.array([[0.0, y] for y in np.arange(0.2, 0.9, 0.05)]), 0.05))
    (0,)
    >>> hinges(closed, fit_line(np.array([[x, 1.0] for x in np.arange(0.0, 0.9, 0.05)]), 0.05))
    ()
    """
    if (
        max(line.depth_m, other.depth_m) > LEAF_DEPTH_M
        or max(line.length_m, other.length_m) > LEAF_LENGTH_M + ROUNDING_M
    ):
        return ()
    found = []
    for k, (end, inward) in enumerate(zip(line.ends, (line.along, -line.along), strict=True)):
        from_middle = end - other.middle
        r = float(from_middle @ other.along)
        off = abs(float(from_middle[0] * other.along[1] - from_middle[1] * other.along[0]))
        gap = max(other.begin_m - r, r - other.end_m)
        away = other.along if r < (other.begin_m + other.end_m) / 2 else -other.along
        reach = gap + other.length_m
        if (
            float(inward @ away) <= math.cos(LEAST_TURN_RAD)
            and off <= HINGE_OFF_M + ROUNDING_M
            and -HINGE_OFF_M - ROUNDING_M <= gap <= HINGE_GAP_M + ROUNDING_M
            and reach <= LONGER * max(line.length_m, other.length_m) + ROUNDING_M
        ):
            found.append(k)
    return tuple(found)


def near_odds(
    points_map: NDArray[np.float64], others_map: NDArray[np.float64], size_ratio: float, settings: EvidenceConfig
) -> float:
    """Log odds, by the distance between two places and their sizes, that they are of one thing."""
    from scipy.spatial import cKDTree

    apart_m = float(cKDTree(points_map).query(others_map)[0].min())
    odds = settings.hinge_bonus if apart_m <= settings.hinge_m + ROUNDING_M else -settings.distance_cost * apart_m
    return odds - settings.size_cost * max(0.0, abs(math.log(size_ratio)) - 0.3)
