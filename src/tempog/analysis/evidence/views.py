"""Which cells are occupied or free by where they are seen from, rather than by when: glass, and rims of walls.

A pane returns the beams that meet it about square and lets the others through to what stands behind it: whenever the
robot drives by, it is free, then occupied, then free. A door that is seen to change as often does so regardless of
where it is seen from.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tempog.analysis.evidence.courses import Courses
from tempog.analysis.evidence.kernels import count_views, seconds_during
from tempog.methods import EvidenceConfig
from tempog.times import NS_PER_S

N_DIRECTIONS = 24  # of 15 degrees; panes are seen within 10 to 60 degrees around square
SAME_PASS_S = 5.0  # a longer time without a look ends a visit: the robot has driven on, or turned
LOOK_S = 0.3  # directions are taken so often; a robot drives 15 cm meanwhile
SINCE_EVER_NS, FOR_EVER_NS = np.array([[limit] for limit in (np.iinfo(np.int64).min, np.iinfo(np.int64).max)])


class Scans(NamedTuple):
    """When and where from cells were seen.

    Attributes
    ----------
    stamps_ns : (n_scans,) int64
    poses : (n_scans, 3) float64
        Of the laser in the map frame.
    look_ns : int
        What a look stands for: periods last so much longer than to their last scan.
    """

    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    look_ns: int


def explained_by_view(
    courses: Courses,
    which: NDArray[np.int64],
    points_map: NDArray[np.float64],
    scans: Scans,
    settings: EvidenceConfig,
) -> NDArray[np.bool_]:
    """For some cells of `courses`, at `points_map`, whether their states follow the direction they are seen from.

    A visit is a time in which the robot saw a cell from one direction. Against each other stand: each direction has
    its own share of visits in which the cell was occupied; the cell has one share; or the cell keeps its state from
    visit to visit, and changes now and then. Shares are unknown, so that each is integrated over. The first must be
    ahead of the others by `view_above` log odds.
    """
    seconds = np.zeros((len(which), 2))
    seconds_during(*courses.measured, which, SINCE_EVER_NS, FOR_EVER_NS, seconds)
    both = np.flatnonzero((seconds >= settings.least_stay_s).all(axis=1))
    explained = np.zeros(len(which), dtype=np.bool_)
    if not len(both):
        return explained
    visits = np.zeros((len(both), N_DIRECTIONS, 2), dtype=np.int64)
    steps = np.zeros((len(both), 2, 2), dtype=np.int64)
    every = max(1, round(LOOK_S * NS_PER_S / scans.look_ns))
    same_pass_ns = round(SAME_PASS_S * NS_PER_S) + scans.look_ns
    count_views(*courses.measured, which[both], points_map[both], *scans, every, same_pass_ns, visits, steps)
    by_view = log_evidence(visits).sum(axis=1)
    by_time = math.log(0.5) + log_evidence(steps).sum(axis=1)
    by_chance = log_evidence(visits.sum(axis=1))
    explained[both] = by_view > np.maximum(by_time, by_chance) + settings.view_above
    return explained


def log_evidence(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Log probability of a course with so many of either kind (..., 2), their share being anything from 0 to 1.

    ``1 / ((n + 1) (n choose k))``.

    >>> np.exp(log_evidence(np.array([[0, 0], [0, 3], [1, 1]]))).round(3).tolist()
    [1.0, 0.25, 0.167]
    """
    from scipy.special import betaln

    return np.asarray(betaln(counts[..., 0] + 1, counts[..., 1] + 1))
