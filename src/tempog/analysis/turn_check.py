"""Whether scans turn as their poses say: finds clocks that differ, mirrored axes and headings of something else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.scans.scan import Scan
from tempog.scans.trajectory import wrapped
from tempog.times import NS_PER_S

PAIR_S = 0.5  # between the two scans of a pair: long enough to turn, short enough to see the same
LONGEST_PAIR_S = 2.0  # of thinned logs; in a longer time too much of what is seen changes
TURN_RAD = (math.radians(5), math.radians(60))  # told, of the pairs looked at; who turns less tells little
MOST_PAIRS = 200
LEAST_PAIRS = 20
MOST_BEAMS = 120  # of a scan, thinned out evenly
SEARCHED_RAD = math.radians(75)  # turns that are tried, to either side
STEP_RAD, FINE_STEP_RAD = math.radians(1), math.radians(0.1)
SAME_M = 0.1  # of two readings in one direction; a few times the noise, and what half a step of search shifts at 10 m
LEAST_SEEN_AGAIN = 0.4  # of the beams, for a turn to be judged
LEAST_FIT = 0.5  # of readings that fit; else too much has changed, or the place looks alike all around
MOST_OTHER_FIT = 0.9  # of the best fit, by turns farther off than AMBIGUOUS_RAD
AMBIGUOUS_RAD = math.radians(8)
MOST_ERROR_RAD = math.radians(20)  # a single pair counts for no more
INCONSISTENT_RAD = math.radians(2.5)
LAGS_S = np.arange(-100, 101) / 100
EXPLAINED = 0.6  # of the error that an explanation has to leave at most


class TurnCheck(NamedTuple):
    """How well scans turn as their poses say.

    Attributes
    ----------
    error_deg : float, degrees, or None
        Root mean square of the difference between the turn told by poses and that of the scans, in pairs half a
        second apart in which the robot turns. None where it turned too seldom, or what was seen does not tell.
    n_pairs : int
        Pairs with a turn that could be judged.
    offset_s : float, seconds, or None
        What to add to the stamps of the poses, so that they fit: the error is then at most 0.6 of what it is.
    mirrored : bool
        The poses turn to the other side.
    """

    error_deg: float | None
    n_pairs: int
    offset_s: float | None = None
    mirrored: bool = False

    @property
    def consistent(self) -> bool | None:
        """Whether `error_deg` is below 2.5 degrees; None if it is unknown."""
        return None if self.error_deg is None else self.error_deg < math.degrees(INCONSISTENT_RAD)

    @property
    def warning(self) -> str | None:
        """What to tell people, if there is something to tell."""
        if self.consistent is not False:
            return None
        said = (
            f"poses look inconsistent: in turns, half a second apart, scans are {self.error_deg:.1f} degrees off them"
        )
        if self.mirrored:
            return f"{said}, as if they turned to the other side: is an axis mirrored, or the laser upside down?"
        if self.offset_s is not None:
            way = "behind" if self.offset_s > 0 else "ahead"
            return (
                f"{said}, as if their clock were {abs(self.offset_s):.2f} s {way}:"
                f" where they come from a file, add {self.offset_s:+.2f} s to --pose-offset"
            )
        return f"{said}: are they of this laser, and of this log?"

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**self._asdict(), "consistent": self.consistent}


def turn_check(scans: Sequence[Scan]) -> TurnCheck:
    """Whether scans turn as their poses say, judged by pairs of scans in which the robot turns.

    Parameters
    ----------
    scans : sequence of Scan
        Of one laser, in time order, such as a ScanLog.

    Returns
    -------
    TurnCheck

    Notes
    -----
    Readings of the second scan are laid over the first, by the told translation and turns of -75 to 75 degrees. The
    turn that fits best, with every pair of readings counting as ``1 / (1 + (difference / 0.1 m)^2)``, is that of
    the scans. Walls in sight tell it to a few tenths of a degree, whatever the map looks like. At most 200 pairs are
    looked at. The told turns are then compared at other times, within a second, and mirrored.

    Examples
    --------
    >>> from tempog.simulation import corridor, simulate
    >>> turn_check(simulate(corridor(), duration_s=60.0).scans).consistent
    True
    """
    stamps_ns = np.array([scan.stamp_ns for scan in scans], dtype=np.int64)
    headings = np.unwrap([scan.theta for scan in scans]) if len(scans) else np.zeros(0)
    t = (stamps_ns - stamps_ns[:1]) / NS_PER_S
    second = np.searchsorted(t, t + PAIR_S - 1e-6)
    first = np.flatnonzero(second < len(scans))
    second = second[first]
    short = t[second] - t[first] <= LONGEST_PAIR_S
    told = np.abs(headings[second] - headings[first])
    one, other, seen = _judged(scans, first, second, short & (told >= TURN_RAD[0]) & (told <= TURN_RAD[1]))
    n_pairs = len(seen)
    if n_pairs < LEAST_PAIRS:
        # Does it turn, and the poses do not say so?
        one, other, seen = _judged(scans, first, second, short)
        error = _error(seen - (headings[other] - headings[one])) if len(seen) >= LEAST_PAIRS else 0.0
        return TurnCheck(math.degrees(error) if error >= INCONSISTENT_RAD else None, n_pairs)
    error = _error(seen - (headings[other] - headings[one]))
    if error < INCONSISTENT_RAD:
        return TurnCheck(math.degrees(error), n_pairs)
    mirrored = _error(seen + (headings[other] - headings[one]))
    lagging = [
        _error(seen - (np.interp(t[other] + lag, t, headings) - np.interp(t[one] + lag, t, headings)))
        for lag in LAGS_S
    ]
    best = int(np.argmin(lagging))
    if mirrored <= min(EXPLAINED * error, lagging[best]):
        return TurnCheck(math.degrees(error), n_pairs, mirrored=True)
    # Poses that fit when they are taken from later are stamped too late.
    offset_s = -float(LAGS_S[best]) if lagging[best] <= EXPLAINED * error else None
    return TurnCheck(math.degrees(error), n_pairs, offset_s)


def _judged(
    scans: Sequence[Scan], first: NDArray[np.intp], second: NDArray[np.intp], usable: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Some of the usable pairs, evenly from all of them, and how far the scans of each are turned, if they tell."""
    chosen = np.flatnonzero(usable)
    if len(chosen) > MOST_PAIRS:
        chosen = chosen[np.linspace(0, len(chosen) - 1, MOST_PAIRS).astype(np.intp)]
    one, other = first[chosen], second[chosen]
    seen = np.array([_turn_seen(scans[i], scans[j]) for i, j in zip(one, other, strict=True)], dtype=np.float64)
    known = np.isfinite(seen)
    return one[known], other[known], seen[known]


def _error(apart: NDArray[np.float64]) -> float:
    """Root mean square of angles, each limited."""
    return float(np.sqrt(np.mean(np.minimum(np.abs(wrapped(apart)), MOST_ERROR_RAD) ** 2)))


def _turn_seen(first: Scan, second: Scan) -> float:
    """By how much the second scan is turned against the first; NaN where they do not tell."""
    angles, ranges = _returns(first)
    beams, distances = _returns(second)
    if min(len(angles), len(beams)) < 2:
        return math.nan
    step = max(1, math.ceil(len(beams) / MOST_BEAMS))
    beams, distances = beams[::step], distances[::step]
    away = complex(second.x - first.x, second.y - first.y) * complex(math.cos(first.theta), -math.sin(first.theta))
    coarse = np.arange(-SEARCHED_RAD, SEARCHED_RAD + STEP_RAD / 2, STEP_RAD)
    fits = _fits(coarse, away, angles, ranges, beams, distances)
    best = int(np.argmax(fits))
    elsewhere = fits[np.abs(coarse - coarse[best]) > AMBIGUOUS_RAD]
    if fits[best] < LEAST_FIT or elsewhere.max() > MOST_OTHER_FIT * fits[best]:
        return math.nan
    fine = coarse[best] + np.arange(-STEP_RAD, STEP_RAD + FINE_STEP_RAD / 2, FINE_STEP_RAD)
    return float(fine[np.argmax(_fits(fine, away, angles, ranges, beams, distances))])


def _returns(scan: Scan) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles, in order, and ranges of the beams that hit something."""
    hit = (scan.ranges > 0) & (scan.ranges < scan.max_range) & np.isfinite(scan.ranges)
    angles = wrapped(scan.angles[hit])
    order = np.argsort(angles)
    return angles[order], scan.ranges[hit][order].astype(np.float64)


def _fits(
    turns: NDArray[np.float64],
    away: complex,
    angles: NDArray[np.float64],
    ranges: NDArray[np.float64],
    beams: NDArray[np.float64],
    distances: NDArray[np.float64],
) -> NDArray[np.float64]:
    """How well the second scan's readings lie on the first one's, for each turn: 0..1."""
    points = away + distances * np.exp(1j * (beams + turns[:, None]))
    bearing, distance = np.angle(points), np.abs(points)
    right = np.clip(np.searchsorted(angles, bearing), 1, len(angles) - 1)
    nearer = bearing - angles[right - 1] < angles[right] - bearing
    near = np.where(nearer, right - 1, right)
    spacing = float(np.median(np.diff(angles)))
    met = np.abs(bearing - angles[near]) <= 1.5 * spacing
    fit = met / (1 + ((distance - ranges[near]) / SAME_M) ** 2)
    n_met = np.count_nonzero(met, axis=1)
    return np.where(n_met >= LEAST_SEEN_AGAIN * len(beams), fit.sum(axis=1) / np.maximum(n_met, 1), 0.0)
