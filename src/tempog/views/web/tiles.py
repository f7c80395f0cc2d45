"""Tiles of the picture: codes of their pixels at a moment, or of a period."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.sensing.grid_spec import Extent
from tempog.times import MAX_NS, NS_PER_S
from tempog.views.web.blocks import PIXELS, PLACES, SIDE, Blocks, Where
from tempog.views.web.kernels import ages_at, held_states_at, mark_occupied, states_at
from tempog.views.web.layers import N_AGES

Codes = NDArray[np.uint8]
SHORTEST_FADE_S, LONGEST_FADE_S = 60.0, 7 * 86_400.0
NO_CLASSES = np.empty(0, dtype=np.int32)  # of ages: all that was seen is of the first, whose code is 1, as of FREE
LEAST_FADE_S = 1.0  # age from which on the veil begins


class MomentScans(NamedTuple):
    """A moment by the numbers of scans.

    Attributes
    ----------
    until : int
        The last scan up to the moment; -1 before the first.
    oldest : int
        The scan from which on a last look is recent enough; 0 if any is.
    ages (N_AGES - 1,) int32
        Scans, descending: who was seen by the kth or later is of age class k at most.
    """

    until: int
    oldest: int
    ages: NDArray[np.int32]


def fade_s(duration_s: float) -> float:
    """The age from which on the veil is densest, for a history of some length; seconds."""
    return min(max(duration_s, SHORTEST_FADE_S), LONGEST_FADE_S)


def scans_at(stamps_ns: NDArray[np.int64], stamp_ns: int, hold_s: float, longest_s: float) -> MomentScans:
    """A moment by the numbers of scans, as `History.at` has it.

    Parameters
    ----------
    stamps_ns : (n_scans,) int64
    stamp_ns : int
    hold_s : float, seconds
        For how long a pixel keeps its last known state; `inf` for ever.
    longest_s : float, seconds
        See `fade_s`.
    """
    until = int(np.searchsorted(stamps_ns, stamp_ns, side="right")) - 1
    hold_ns = round(min(hold_s * NS_PER_S, MAX_NS))
    oldest = int(np.searchsorted(stamps_ns, max(stamp_ns - hold_ns, -MAX_NS), side="left"))
    limits_ns = (np.geomspace(LEAST_FADE_S, longest_s, N_AGES - 1) * NS_PER_S).astype(np.int64)
    since_ns = np.maximum(stamp_ns, -MAX_NS + limits_ns) - limits_ns
    return MomentScans(until, oldest, np.searchsorted(stamps_ns, since_ns, side="left").astype(np.int32))


def occupancy_codes(blocks: Blocks, where: Where, moment: MomentScans) -> Codes | None:
    """Which pixels are occupied (2) or free (1) at a moment; None if nothing was ever seen there.

    A pixel of several cells is occupied if one of them is, and else free if one of them is.
    """
    if moment.until < 0 or blocks.is_empty(where):
        return None
    codes = np.zeros(PIXELS, dtype=np.uint8)
    if moment.oldest > 0 and where.z > 0:
        ages_at(*blocks.looks(where), moment.until, moment.oldest, NO_CLASSES, PLACES, codes)
        mark_occupied(*blocks.occupied(where), moment.until, moment.oldest, PLACES, codes)
    elif moment.oldest > 0:
        held_states_at(*blocks.cells(where), moment.until, moment.oldest, PLACES, codes)
    else:
        states_at(*blocks.states(where), moment.until, PLACES, codes)
    return codes.reshape(SIDE, SIDE)


def age_codes(blocks: Blocks, where: Where, moment: MomentScans) -> Codes | None:
    """How long ago any of each pixel's cells was seen, in classes from 1; None if nothing was ever seen there."""
    if moment.until < 0 or blocks.is_empty(where):
        return None
    codes = np.zeros(PIXELS, dtype=np.uint8)
    ages_at(*blocks.looks(where), moment.until, moment.oldest, moment.ages, PLACES, codes)
    return codes.reshape(SIDE, SIDE)


def seen_codes(blocks: Blocks, where: Where, scan: int) -> Codes | None:
    """Which pixels (1) a scan saw; None if nothing was ever seen there."""
    if scan < 0 or blocks.is_empty(where):
        return None
    codes = np.zeros(PIXELS, dtype=np.uint8)
    ages_at(*blocks.looks(where), scan, scan, NO_CLASSES, PLACES, codes)
    return codes.reshape(SIDE, SIDE)


@dataclass(frozen=True)
class Pyramid:
    """Codes of every cell of a map, and of 2 x 2, 4 x 4 ... cells: what does not depend on a moment.

    Attributes
    ----------
    levels : tuple of (row0, col0, (n_rows, n_cols) uint8)
        By zoom; row 0 is the southern one.
    """

    levels: tuple[tuple[int, int, Codes], ...]

    @classmethod
    def of(cls, codes: Codes, extent: Extent, n_zooms: int) -> Pyramid:
        """All levels of codes over an extent."""
        row0, col0 = extent.row0, extent.col0
        levels = [(row0, col0, np.ascontiguousarray(codes))]
        for _ in range(1, n_zooms):
            before = np.pad(codes, [(row0 % 2, (row0 + codes.shape[0]) % 2), (col0 % 2, (col0 + codes.shape[1]) % 2)])
            row0, col0 = row0 // 2, col0 // 2
            n_rows, n_cols = before.shape
            codes = before.reshape(n_rows // 2, 2, n_cols // 2, 2).max(axis=(1, 3))
            levels.append((row0, col0, codes))
        return cls(tuple(levels))

    def codes(self, where: Where) -> Codes | None:
        """The codes of a tile, its northern row first; None if there is nothing."""
        row0, col0, codes = self.levels[where.z]
        first_row, first_col = where.row * SIDE - row0, where.col * SIDE - col0
        rows = slice(max(first_row, 0), max(min(first_row + SIDE, codes.shape[0]), 0))
        cols = slice(max(first_col, 0), max(min(first_col + SIDE, codes.shape[1]), 0))
        part = codes[rows, cols]
        if not part.any():
            return None
        whole = np.zeros((SIDE, SIDE), dtype=np.uint8)
        top, left = rows.start - first_row, cols.start - first_col
        whole[top : top + part.shape[0], left : left + part.shape[1]] = part
        return whole[::-1]

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(codes.nbytes for _, _, codes in self.levels)
