"""Kernel: how far does each beam of one scan reach, and what does it hit?

Arrays in, arrays out, metres and radians in the map frame. No classes, no validation: `simulate` has
already cast everything that arrives here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel

NOTHING = -1  # id of what a beam without return has hit


@kernel
def cast_beams(
    x: float,
    y: float,
    angles: NDArray[np.float64],
    segments: NDArray[np.float64],
    discs: NDArray[np.float64],
    max_range: float,
    distance: NDArray[np.float64],
    hit: NDArray[np.int32],
) -> None:
    """Find the smallest positive distance of each beam from (x, y), exactly.

    x, y                              float64  where all beams start
    angles      (n_beams,)            float64  directions in the map frame
    segments    (n_segments, 4)       float64  x0, y0, x1, y1
    discs       (n_discs, 3)          float64  x, y, radius
    max_range                         float64  what lies at or beyond it is not seen; may be inf
    distance    (n_beams,)            float64  to the first thing hit, or inf                    [updated]
    hit         (n_beams,)            int32    segment, n_segments + disc, or NOTHING            [updated]

    The outer loop runs over things rather than beams: a thing out of reach is dropped once per scan, and
    the inner loop reads two short arrays. Of two things at one distance, the lower id wins. End points
    belong to their segment, so nothing leaks between two segments that share one. A segment seen exactly
    edge-on is hit at its nearer end; a disc around (x, y) is hit from inside. What is nowhere, at NaN, is
    not hit.
    """
    n_beams = angles.shape[0]
    n_segments = segments.shape[0]
    cos = np.cos(angles)
    sin = np.sin(angles)
    for beam in range(n_beams):
        distance[beam] = max_range
        hit[beam] = NOTHING

    for i in range(n_segments):
        ax = segments[i, 0] - x
        ay = segments[i, 1] - y
        bx = segments[i, 2] - x
        by = segments[i, 3] - y
        if math.isnan(ax):
            continue
        if min(ax, bx) > max_range or max(ax, bx) < -max_range:
            continue
        if min(ay, by) > max_range or max(ay, by) < -max_range:
            continue
        for beam in range(n_beams):
            c = cos[beam]
            s = sin[beam]
            a_left = c * ay - s * ax  # how far each end lies to the left of the beam
            b_left = c * by - s * bx
            if a_left * b_left > 0.0:
                continue
            a_ahead = c * ax + s * ay
            b_ahead = c * bx + s * by
            if a_left == b_left:  # both 0: edge-on
                d = min(a_ahead, b_ahead)
                if d <= 0.0:
                    d = max(a_ahead, b_ahead)
            else:
                d = a_ahead + a_left / (a_left - b_left) * (b_ahead - a_ahead)
            if 0.0 < d < distance[beam]:
                distance[beam] = d
                hit[beam] = i

    for j in range(discs.shape[0]):
        mx = discs[j, 0] - x
        my = discs[j, 1] - y
        radius = discs[j, 2]
        reach = max_range + radius
        if math.isnan(mx) or abs(mx) > reach or abs(my) > reach:
            continue
        for beam in range(n_beams):
            m_left = cos[beam] * my - sin[beam] * mx
            if abs(m_left) > radius:
                continue
            m_ahead = cos[beam] * mx + sin[beam] * my
            half_chord = math.sqrt((radius - m_left) * (radius + m_left))
            d = m_ahead - half_chord
            if d <= 0.0:
                d = m_ahead + half_chord
            if 0.0 < d < distance[beam]:
                distance[beam] = d
                hit[beam] = n_segments + j

    for beam in range(n_beams):
        if hit[beam] == NOTHING:
            distance[beam] = math.inf
