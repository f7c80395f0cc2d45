"""Long periods without a scan, which pictures of time leave out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PAUSE_S = 60.0  # shorter breaks belong to the drive
LONG_SHARE = 0.1  # of the time driven: shorter pauses leave enough room for the rest


def pauses_s(stamps_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(n, 2)`` seconds: begin and end of the long periods without a scan.

    >>> pauses_s(np.array([0.0, 50.0, 100.0, 86_400.0, 86_450.0])).tolist()
    [[100.0, 86400.0]]
    """
    lengths = np.diff(stamps_s)
    driven_s = float(lengths[lengths <= PAUSE_S].sum())
    before = np.flatnonzero(lengths > max(PAUSE_S, LONG_SHARE * driven_s))
    return np.stack([stamps_s[before], stamps_s[before + 1]], axis=-1)
