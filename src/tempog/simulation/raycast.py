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
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    angles: NDArray[np.float64],
    segments: NDArray[np.float64],
    discs: NDArray[np.float64],
    passes: NDArray[np.uint8],
    max_range: float,
    distance: NDArray[np.float64],
    hit: NDArray[np.int32],
) -> None:
    """Find the smallest positive distance of each beam from its start, exactly.

    x, y, angles  (n_beams,)         float64  where each beam starts, and its direction in the map frame
    segments    (n_segments, 4)      float64  x0, y0, x1, y1; the last four of each pane are glass
    discs       (n_discs, 3)         float64  x, y, radius
    passes      (n_panes, n_beams)   uint8    whether the beam passes through the pane
    max_range                        float64  what lies at or beyond it is not seen; may be inf
    distance    (n_beams,)           float64  to the first thing hit, or inf                    [updated]
    hit         (n_beams,)           int32    segment, n_segments + disc, or NOTHING            [updated]

    The outer loop runs over things rather than beams: a thing out of reach is dropped once per scan, and
    the inner loop reads short arrays. Of two things at one distance, the lower id wins. End points
    belong to their segment, so nothing leaks between two segments that share one. A segment seen exactly
    edge-on is hit at its nearer end; a disc around a beam's start is hit from inside. What is nowhere, at
    NaN, is not hit. All is computed relative to where the first beam starts.
    """
    n_beams = angles.shape[0]
    n_segments = segments.shape[0]
    n_solid = n_segments - 4 * passes.shape[0]
    cos = np.cos(angles)
    sin = np.sin(angles)
    start_left = np.empty(n_beams)  # how far each beam starts to the left of itself, seen from the first start
    start_ahead = np.empty(n_beams)
    moved = 0.0
    for beam in range(n_beams):
        dx, dy = x[beam] - x[0], y[beam] - y[0]
        start_left[beam] = cos[beam] * dy - sin[beam] * dx
        start_ahead[beam] = cos[beam] * dx + sin[beam] * dy
        moved = max(moved, abs(dx), abs(dy))
        distance[beam] = max_range
        hit[beam] = NOTHING

    for i in range(n_segments):
        ax = segments[i, 0] - x[0]
        ay = segments[i, 1] - y[0]
        bx = segments[i, 2] - x[0]
        by = segments[i, 3] - y[0]
        if math.isnan(ax):
            continue
        reach = max_range + moved
        if min(ax, bx) > reach or max(ax, bx) < -reach or min(ay, by) > reach or max(ay, by) < -reach:
            continue
        for beam in range(n_beams):
            c = cos[beam]
            s = sin[beam]
            a_left = c * ay - s * ax - start_left[beam]  # how far each end lies to the left of the beam
            b_left = c * by - s * bx - start_left[beam]
            if a_left * b_left > 0.0:
                continue
            a_ahead = c * ax + s * ay - start_ahead[beam]
            b_ahead = c * bx + s * by - start_ahead[beam]
            if a_left == b_left:  # both 0: edge-on
                d = min(a_ahead, b_ahead)
                if d <= 0.0:
                    d = max(a_ahead, b_ahead)
            else:
                d = a_ahead + a_left / (a_left - b_left) * (b_ahead - a_ahead)
            if 0.0 < d < distance[beam] and (i < n_solid or passes[(i - n_solid) // 4, beam] == 0):
                distance[beam] = d
                hit[beam] = i

    for j in range(discs.shape[0]):
        mx = discs[j, 0] - x[0]
        my = discs[j, 1] - y[0]
        radius = discs[j, 2]
        reach = max_range + moved + radius
        if math.isnan(mx) or abs(mx) > reach or abs(my) > reach:
            continue
        for beam in range(n_beams):
            m_left = cos[beam] * my - sin[beam] * mx - start_left[beam]
            if abs(m_left) > radius:
                continue
            m_ahead = cos[beam] * mx + sin[beam] * my - start_ahead[beam]
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
