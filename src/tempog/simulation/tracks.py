"""People who go where they once went: recorded, or scripted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import WorldError

SAME_TIME_S = 1e-9  # far below any step, far above rounding errors


@dataclass(frozen=True, eq=False)
class Track:
    """A person who is replayed: straight from each sample to the next, absent before the first and after the last.

    Doors, the robot and walking people mind this person, who minds nobody, and so may walk into them.

    Attributes
    ----------
    samples : (n_samples, 3) float64
        t, x, y: seconds since the start of the simulation (may be negative), metres, metres; t rises.

    Examples
    --------
    >>> Track([(0.0, 1.0, 0.0), (2.0, 3.0, 0.0)]).positions([1.0, 2.0, 2.5]).tolist()
    [[2.0, 0.0], [3.0, 0.0], [nan, nan]]
    """

    samples: NDArray[np.float64]

    def __init__(self, samples: ArrayLike) -> None:
        rows = np.array(samples, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows):
            raise WorldError(f"a track of shape {rows.shape}; wanted one row t, x, y or more")
        if not np.isfinite(rows).all():
            raise WorldError(f"a track's sample {int(np.argmin(np.isfinite(rows).all(axis=1)))} is not finite")
        if (np.diff(rows[:, 0]) <= 0).any():
            k = int(np.argmax(np.diff(rows[:, 0]) <= 0)) + 1
            raise WorldError(
                f"a track's sample {k} is at {rows[k, 0]:g} s, after {rows[k - 1, 0]:g} s; wanted rising times"
            )
        object.__setattr__(self, "samples", rows)

    def positions(self, t: ArrayLike) -> NDArray[np.float64]:
        """Where the person is at the times `t` (any shape, seconds); (..., 2) metres, NaN while absent."""
        times = np.asarray(t, dtype=np.float64)
        known = self.samples[:, 0]
        here = (times >= known[0] - SAME_TIME_S) & (times <= known[-1] + SAME_TIME_S)
        xy = [np.interp(times, known, self.samples[:, k]) for k in (1, 2)]
        return np.where(here[..., None], np.stack(xy, axis=-1), np.nan)
