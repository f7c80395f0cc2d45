"""Whether the poses of a map agree: how far apart the hits of one surface lie."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.doubled_walls import doubled_share
from tempog.errors import ConfigError
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.grid.segments import Runs
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import TileIndex

# Five simulated drives: of 121 places found with perfect poses, 119 are found at spreads of up to 0.016 m, 111 at
# 0.016 to 0.023 m, 86 at 0.027 to 0.034 m. Where a quarter is much worse than half, poses disagree in some rooms.
INCONSISTENT_M = 0.02
INCONSISTENT_QUARTER_M = 0.03
# Of the walls; docs/poses.md: at most 0.02 with perfect poses, at least 0.12 with doubled walls.
DOUBLED_SHARE = 0.08
REACH_M = 0.25  # of a piece of surface to either side: double walls fit in, and most door frames do not
STANDS_SHARE = 0.75  # of the time seen: walls, not people, as for static cells
LINE_SHARE = 0.6  # of a line of twice the reach is what a piece is at least long; a table's leg is no piece
LEAST_HITS = 20  # of a piece; fewer show no spread
RANGE_NOISE_M = 0.01  # standard deviation of ranges: what laser scanners scatter with the best of poses
LEAST_PIECES = 50  # of a map; a verdict on fewer would be one on a single table
MOST_PIECES = 20_000  # looked at; more are thinned out evenly


class MapWithHits(Protocol):
    """A `TemporalGrid` or a `SavedMap`: a whole history, with where hits fell and where they were seen from."""

    @property
    def tiles(self) -> TileIndex: ...
    @property
    def surfaces(self) -> SurfaceMemory: ...
    @property
    def poses(self) -> NDArray[np.float64]: ...
    def runs(self) -> Iterator[Runs]: ...


class PoseConsistency(NamedTuple):
    """How far surfaces were seen displaced, because the poses that they were seen from disagree.

    Attributes
    ----------
    spread_m : float, metres, or None
        Standard deviation of a surface's hits across it, without the noise of ranges: the median over pieces of
        surface, weighted by their hits. None where too little was seen to say.
    quarter_m : float, metres, or None
        The same, exceeded by the worst quarter instead of half of the surfaces. Furniture adds to it.
    n_pieces : int
        Pieces of surface looked at.
    doubled_share : float, 0..1, or None
        What share of the hits on walls fell where other passes looked through: passes saw them farther apart than
        `spread_m` can tell. None where too little was seen to say.
    """

    spread_m: float | None
    quarter_m: float | None
    n_pieces: int
    doubled_share: float | None = None

    @property
    def consistent(self) -> bool | None:
        """Whether `spread_m` is below 0.02 m, `quarter_m` 0.03 m, `doubled_share` 0.08; None if they are unknown."""
        if self.doubled:
            return False
        if self.spread_m is None or self.quarter_m is None:
            return None
        return self.spread_m < INCONSISTENT_M and self.quarter_m < INCONSISTENT_QUARTER_M

    @property
    def doubled(self) -> bool:
        """Whether passes saw so many walls in different places that others looked through them."""
        return self.doubled_share is not None and self.doubled_share >= DOUBLED_SHARE

    def __str__(self) -> str:
        said = []
        if self.spread_m is not None and self.quarter_m is not None:
            said.append(
                f"the same surfaces were seen {self.spread_m:.3f} m displaced between passes, a quarter of them"
                f" {self.quarter_m:.3f} m or more"
            )
        if self.doubled:
            said.append(f"{self.doubled_share:.0%} of the walls stand where other passes looked through")
        return "; ".join(said) or "too little was seen to say whether they agree"

    @property
    def warning(self) -> str | None:
        """What to tell people, if there is something to tell."""
        if self.consistent is not False:
            return None
        return (
            f"poses look inconsistent: {self}; objects found along walls may be wrong, so map a log with corrected"
            " poses if there is one"
        )

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**self._asdict(), "consistent": self.consistent}


def pose_consistency(grid: MapWithHits) -> PoseConsistency:
    """How far the same surfaces were seen displaced between passes, by the poses that the scans came with.

    Parameters
    ----------
    grid : TemporalGrid or SavedMap
        Not a window: where hits fell is kept for the whole time only.

    Returns
    -------
    PoseConsistency

    Raises
    ------
    ConfigError
        A window or an area.

    Notes
    -----
    Cells keep count, mean and covariance of the hits in them. A piece of surface is what lies up to 0.25 m around a
    cell that was occupied for 3/4 of the time it was seen, and was seen from the same side, so that the two faces
    of a wall are two pieces. With ``n_j, m_j, C_j`` of its cells, ``m`` their common mean::

        C = sum n_j (C_j + (m_j - m)(m_j - m)^T) / sum n_j
        spread = sqrt(max(smallest eigenvalue of C - (0.01 m)^2, 0))

    which no cell size limits: hits of displaced passes fall into other cells of the same piece. Simulated walls that
    were displaced by 0.018 to 0.071 m (root mean square) come out as 0.67 to 1.01 of that, those displaced by 0.01 m
    as half of it. What lies farther apart than 0.25 m is not compared, so several decimetres look like less. Error
    that is drawn anew for each scan counts like error between passes.

    Walls that were seen farther apart are found by `doubled_share`: occupied for ten scans in a row, and seen through
    in more than a quarter of all looks, in lines of 1.5 m.

    Examples
    --------
    >>> from tempog import build_grid
    >>> from tempog.simulation import corridor, simulate
    >>> pose_consistency(build_grid(simulate(corridor(), duration_s=60.0).scans)).consistent
    True
    """
    if not hasattr(grid, "surfaces"):
        raise ConfigError("a window or an area keeps no hit points; wanted the whole map")
    from scipy.spatial import cKDTree

    surfaces = grid.surfaces
    used = slice(0, surfaces.n_slots)
    hits = surfaces.hit_count[used].astype(np.float64)
    moments = surfaces.moments[used].astype(np.float64)
    means = grid.tiles.spec.centres(*grid.tiles.rows_cols(surfaces.cell_of_slot[used])) + moments[:, :2]
    share, view, longest = _seen(grid, means)
    doubled = doubled_share(means, hits, share >= STANDS_SHARE, longest)
    stands = np.flatnonzero(share >= STANDS_SHARE)
    stands = stands[:: max(1, math.ceil(len(stands) / MOST_PIECES))]
    if not len(stands):
        return PoseConsistency(None, None, 0, doubled)
    near = cKDTree(means[stands]).sparse_distance_matrix(cKDTree(means), REACH_M, output_type="ndarray")
    piece, cell = near["i"], near["j"]
    same_view = np.einsum("na,na->n", view[stands[piece]], view[cell]) > 0
    across = _pool(piece, cell, same_view, stands, hits, means, moments).across
    # Only now is it known what the sides are.
    side, of = (np.einsum("na,na->n", across[piece], view[which]) for which in (cell, stands[piece]))
    pooled = _pool(piece, cell, (side * of > 0) | (cell == stands[piece]), stands, hits, means, moments)
    line_m2 = (LINE_SHARE * REACH_M) ** 2 / 3  # variance of an even line of that half length
    kept = (pooled.hits >= LEAST_HITS) & (pooled.along_m2 >= line_m2)
    n_pieces = int(np.count_nonzero(kept))
    if n_pieces < LEAST_PIECES:
        return PoseConsistency(None, None, n_pieces, doubled)
    weight = hits[stands][kept]
    spread_m, quarter_m = (
        math.sqrt(max(_quantile(pooled.across_m2[kept], weight, q) - RANGE_NOISE_M**2, 0.0)) for q in (0.5, 0.75)
    )
    return PoseConsistency(spread_m, quarter_m, n_pieces, doubled)


def _seen(
    grid: MapWithHits, means: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Of each slot: for what share of its looks it was occupied, the direction it was seen from, its longest run."""
    surfaces = grid.surfaces
    n = surfaces.n_slots
    looks, taken, longest, view = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((n, 2))
    until = np.concatenate([np.zeros((1, 2)), np.cumsum(grid.poses[:, :2], axis=0)])
    for runs in grid.runs():
        slot = np.repeat(surfaces.slot_of_cell[runs.cells], np.diff(runs.offsets))
        known = slot >= 0
        slot, first, last, value = slot[known], runs.first[known], runs.last[known], runs.value[known]
        lasted = (last - first + 1).astype(np.float64)
        occupied = value > OCCUPIED_ABOVE
        looks += np.bincount(slot, lasted, n)
        taken += np.bincount(slot, lasted * occupied, n)
        slot, first, last, lasted = slot[occupied], first[occupied], last[occupied], lasted[occupied]
        np.maximum.at(longest, slot, lasted)
        towards = (until[last + 1] - until[first]) / lasted[:, None] - means[slot]
        towards *= (lasted / np.maximum(np.hypot(*towards.T), 1e-9))[:, None]
        view += np.stack([np.bincount(slot, towards[:, k], n) for k in (0, 1)], axis=-1)
    return np.asarray(taken / np.maximum(looks, 1), dtype=np.float64), view, longest


class _Pieces(NamedTuple):
    """Of each piece: number of hits, their variance across and along it, and its normal."""

    hits: NDArray[np.float64]
    across_m2: NDArray[np.float64]
    along_m2: NDArray[np.float64]
    across: NDArray[np.float64]


def _pool(
    piece: NDArray[np.int64],
    cell: NDArray[np.int64],
    kept: NDArray[np.bool_],
    middle: NDArray[np.int64],
    hits: NDArray[np.float64],
    means: NDArray[np.float64],
    moments: NDArray[np.float64],
) -> _Pieces:
    """The common covariance of the cells of each piece, those pairs of piece and cell that are kept."""
    piece, cell = piece[kept], cell[kept]
    weight, apart = hits[cell], means[cell] - means[middle[piece]]
    n = np.maximum(np.bincount(piece, weight, len(middle)), 1)
    x, y = (np.bincount(piece, weight * apart[:, k], len(middle)) / n for k in (0, 1))
    xx, xy, yy = (
        np.bincount(piece, weight * (moments[cell, 2 + k] + apart[:, a] * apart[:, b]), len(middle)) / n
        for k, (a, b) in enumerate(((0, 0), (0, 1), (1, 1)))
    )
    xx, xy, yy = xx - x * x, xy - x * y, yy - y * y
    half, middle_m2 = (xx - yy) / 2, (xx + yy) / 2
    root = np.hypot(half, xy)
    angle = np.arctan2(xy, half) / 2
    return _Pieces(n, middle_m2 - root, middle_m2 + root, np.stack([-np.sin(angle), np.cos(angle)], axis=-1))


def _quantile(values: NDArray[np.float64], weights: NDArray[np.float64], share: float) -> float:
    """The least value that a share of the weights does not exceed."""
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order[int(np.searchsorted(below, share * below[-1]))]])
