"""Doors among found objects: the hinge, and the leaf in each of its places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.configurations import Configuration
from tempog.analysis.evidence.shape import HINGE_GAP_M, LEAF_DEPTH_M, LEAF_LENGTH_M, Line, fit_line
from tempog.sensing.grid_spec import Extent, GridSpec

HINGE_OFF_M = 0.2  # from the hinge to the line of a leaf, and for one leaf to its end
LEAST_LENGTH_M = 0.4  # of what is seen of a leaf; less has no direction to speak of
LEAST_TURN_RAD = math.radians(15)
UNSURE_TURN_RAD = math.radians(15)  # about half a turn: a leaf may have swung on either side
LEAF_ASIDE_M = 0.12  # from the middle of a leaf to the cells beside it
JAMB_M = 0.2
TOWARDS_END = 0.02  # weight of a leaf's end beside its line: the wall hides the first part of an open leaf


class Hinge(NamedTuple):
    """Where a leaf turns, in the map frame.

    Attributes
    ----------
    x, y : float, metres
    off_m : float, metres
        The farthest that the line of a place passes from it.
    length_m : float, metres
        Of the leaf: to the farthest end that was seen.
    tips : tuple of (x, y), metres
        The leaf's other end in each place.
    """

    x: float
    y: float
    off_m: float
    length_m: float
    tips: tuple[tuple[float, float], ...]


def hinge_of(places: Sequence[Configuration], resolution_m: float) -> Hinge | None:
    """The hinge of a thing, if all its places are slender and meet in one point at their ends; else None.

    Parameters
    ----------
    places : sequence of Configuration
        Two or more.
    resolution_m : float, metres

    Notes
    -----
    The hinge is the point nearest to the lines through the places' cells, by least squares, drawn a little towards
    the ends that meet there: that decides where along them it lies if a leaf turns by 180 degrees.

    Examples
    --------
    A leaf of 0.9 m, closed along x, and open along y with its first 20 cm hidden:

    >>> closed = [(x, 0.0) for x in np.arange(0.025, 0.9, 0.05)]
    >>> opened = [(0.0, y) for y in np.arange(0.225, 0.9, 0.05)]
    >>> both = enumerate([np.array(closed), np.array(opened)])
    >>> places = [Configuration(k, np.empty((0, 2)), points, ()) for k, points in both]
    >>> hinge = hinge_of(places, 0.05)
    >>> round(abs(hinge.x), 2), round(abs(hinge.y), 2), round(hinge.length_m, 2)
    (0.0, 0.0, 0.9)
    >>> hinge_of(places[:1], 0.05) is None
    True
    """
    if len(places) < 2:
        return None
    lines = [fit_line(place.points_map, resolution_m) for place in places]
    if any(line.depth_m > LEAF_DEPTH_M or not LEAST_LENGTH_M <= line.length_m <= LEAF_LENGTH_M for line in lines):
        return None
    best: tuple[float, Hinge] | None = None
    for ends in product((0, 1), repeat=len(lines)):
        point = _meeting(lines, ends)
        hinge = _turning_about(point, lines, ends)
        if hinge is not None:
            cost = sum(float(np.linalg.norm(line.ends[end] - point)) for line, end in zip(lines, ends, strict=True))
            if best is None or cost < best[0]:
                best = cost, hinge
    return best[1] if best else None


def _meeting(lines: Sequence[Line], ends: Sequence[int]) -> NDArray[np.float64]:
    """The point nearest to some lines, and a little to their chosen ends."""
    normal, wanted = np.zeros((2, 2)), np.zeros(2)
    for line, end in zip(lines, ends, strict=True):
        across = np.eye(2) - np.outer(line.along, line.along) + TOWARDS_END * np.eye(2)
        normal += across
        wanted += across @ line.ends[end]
    return np.asarray(np.linalg.solve(normal, wanted), dtype=np.float64)


def _turning_about(point: NDArray[np.float64], lines: Sequence[Line], ends: Sequence[int]) -> Hinge | None:
    """The hinge at a point, unless some line does not begin there."""
    gaps, offs, reaches, directions = [], [], [], []
    for line, end in zip(lines, ends, strict=True):
        inward = line.along if end == 0 else -line.along
        from_point = line.ends[end] - point
        gaps.append(float(from_point @ inward))
        offs.append(abs(float(from_point[0] * inward[1] - from_point[1] * inward[0])))
        reaches.append(gaps[-1] + line.length_m)
        directions.append(inward)
    if max(offs) > HINGE_OFF_M or min(gaps) < -HINGE_OFF_M or max(gaps) > HINGE_GAP_M:
        return None
    if min(abs(gap) for gap in gaps) > HINGE_OFF_M or max(reaches) > LEAF_LENGTH_M:
        return None
    for k, one in enumerate(directions):
        if any(float(one @ other) > math.cos(LEAST_TURN_RAD) for other in directions[:k]):
            return None
    length_m = max(reaches)
    tips = [(point + length_m * direction).tolist() for direction in directions]
    return Hinge(float(point[0]), float(point[1]), max(offs), length_m, tuple((x, y) for x, y in tips))


def leaf_cells(hinge: Hinge, k: int, extent: Extent) -> NDArray[np.int32]:
    """Lattice row and col, (n, 2), of cells beside a leaf in its kth place: within `LEAF_ASIDE_M` of its middle.

    Without its first `JAMB_M`: there is the wall's end.
    """
    dx, dy = ((tip - at) / hinge.length_m for tip, at in zip(hinge.tips[k], (hinge.x, hinge.y), strict=True))
    cells, x, y = cells_around(hinge, hinge.length_m + LEAF_ASIDE_M, extent)
    along, across = x * dx + y * dy, np.abs(x * dy - y * dx)
    return cells[(along >= JAMB_M) & (along <= hinge.length_m + LEAF_ASIDE_M) & (across <= LEAF_ASIDE_M)]


def swept_cells(hinge: Hinge, extent: Extent) -> NDArray[np.int32]:
    """Lattice row and col, (n, 2), of cells that a leaf sweeps: the smallest sector that holds all its places.

    Whether a leaf that turns by about 180 degrees does so on this side or on that, its places do not say: then both.
    """
    cells, x, y = cells_around(hinge, hinge.length_m, extent)
    near = np.hypot(x, y) <= hinge.length_m + extent.resolution_m / 2
    angles = sorted(math.atan2(y_tip - hinge.y, x_tip - hinge.x) % math.tau for x_tip, y_tip in hinge.tips)
    gaps = [later - one for one, later in pairwise([*angles, angles[0] + math.tau])]
    widest = int(np.argmax(gaps))
    if gaps[widest] < math.pi + UNSURE_TURN_RAD:
        return cells[near]
    begin = angles[(widest + 1) % len(angles)]
    turned = (np.arctan2(y, x) - begin) % math.tau
    return cells[near & (turned <= math.tau - gaps[widest])]


def cells_around(
    hinge: Hinge, reach_m: float, extent: Extent
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """Cells of an extent around a hinge: lattice row and col, (n, 2), and x and y of their centres from the hinge."""
    size_m = extent.resolution_m
    spans = []
    for at, first, n in ((hinge.y, extent.row0, extent.n_rows), (hinge.x, extent.col0, extent.n_cols)):
        low, high = math.floor((at - reach_m) / size_m) - 1, math.ceil((at + reach_m) / size_m) + 1
        spans.append(np.arange(max(low, first), min(high, first + n), dtype=np.int32))
    rows, cols = (part.ravel() for part in np.meshgrid(*spans, indexing="ij"))
    cells = np.stack([rows, cols], axis=-1)
    x, y = GridSpec(size_m).centres(rows, cols).T - np.array([[hinge.x], [hinge.y]])
    return cells, x, y


def outline_of(place: Configuration, resolution_m: float) -> list[tuple[float, float]]:
    """The convex outline of a place's cells, anticlockwise, without the first point again; metres.

    >>> place = Configuration(1, np.empty((0, 2)), np.array([[0.05, 0.05], [0.15, 0.05]]), ())
    >>> outline_of(place, 0.1)
    [(0.0, 0.0), (0.2, 0.0), (0.2, 0.1), (0.0, 0.1)]
    """
    half_m = resolution_m / 2
    corners = sorted(
        {
            (round(x + dx, 6), round(y + dy, 6))
            for x, y in place.points_map.tolist()
            for dx in (-half_m, half_m)
            for dy in (-half_m, half_m)
        }
    )

    def chain(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        turned: list[tuple[float, float]] = []
        for x, y in points:
            while len(turned) > 1:
                (ax, ay), (bx, by) = turned[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 1e-9:
                    break
                turned.pop()
            turned.append((x, y))
        return turned[:-1]

    return [*chain(corners), *chain(corners[::-1])]
