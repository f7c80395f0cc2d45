"""What a laser at shin height sees of people: two legs that swing as they walk."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

LEG_RADIUS_M = 0.06
LEGS_APART_M = 0.3
STRIDE_M = 1.4  # walked until the same leg is in front again
LONGEST_SWING_M = 0.2  # of a leg before and behind the body's middle
SMALLEST_BODY_M = LEGS_APART_M / 2 + LEG_RADIUS_M  # radius of a disc that holds both legs
STILL_M = 1e-6  # who moves by less from scan to scan keeps looking where they looked


class Legs:
    """The legs of all people, from scan to scan.

    Each leg stays within the body: it swings by at most `LONGEST_SWING_M`, or less if the body is narrow.
    """

    def __init__(self, n_people: int, radius_m: float) -> None:
        self.swing_m = min(LONGEST_SWING_M, math.sqrt((radius_m - LEG_RADIUS_M) ** 2 - (LEGS_APART_M / 2) ** 2))
        self.heading = np.zeros(n_people)
        self.phase = 0.5 + 2.4 * np.arange(n_people)  # rad; not everybody in step
        self.was = np.full((n_people, 2), np.nan)

    def step(self, where: NDArray[np.float64]) -> NDArray[np.float64]:
        """Middles of the left and the right leg, (n_people, 2, 2) metres, of people who are at `where` now."""
        x, y = np.nan_to_num(where - self.was).T
        self.was = where.copy()
        walked = np.hypot(x, y)
        self.heading = np.where(walked > STILL_M, np.arctan2(y, x), self.heading)
        self.phase += 2 * np.pi * walked / STRIDE_M
        ahead = np.stack([np.cos(self.heading), np.sin(self.heading)], axis=-1)
        left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
        swing = self.swing_m * np.sin(self.phase)[:, None] * ahead
        aside = LEGS_APART_M / 2 * left
        return np.stack([where + aside + swing, where - aside - swing], axis=1)
