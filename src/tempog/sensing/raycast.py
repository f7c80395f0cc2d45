"""Kernels from beams to evidence: which cells does each beam cross, and what does it say about them?

Metres, radians; no validation: `Sensor.sense` has checked and cast.

A scan is worked on in a window: a rectangle of cells that holds all its beams, aligned to tiles, with its
corner at cell (row0, col0). `state` and `note` have one entry per cell of the window, row by row, and 2**shift
entries per row, so that an entry's row and column are a shift and a mask away.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tempog._jit import kernel

# What a window's cell is, in `state`.
UNTOUCHED = 0
FREE = 1
HIT = 2
PROTECTED = 3
KNOWN_SURFACE = 4

# Settings of `no_return` as integers.
NEVER = 0
ALWAYS = 1
NEIGHBOURS = 2

# A cell beside a wall gets under a fifth of the wall's hits if the wall's face is a standard deviation away.
STRAY_RATIO = 4
# Beams that cross a surface at less than this angle say nothing about it (sine of 17 degrees): where a beam
# that nearly runs along a wall crosses it depends on the last half degree of the robot's heading.
MIN_CROSSING_SINE = 0.3


@kernel
def aim(
    angles: NDArray[np.float64],
    ranges: NDArray[np.float32],
    x: float,
    y: float,
    theta: float,
    sensor_max: float,
    max_range: float,
    no_return: int,
    flanked: bool,
    end_x: NDArray[np.float64],
    end_y: NDArray[np.float64],
    reach: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
) -> tuple[float, float, float, float]:
    """Where each beam ends and what that means; returns the bounds (x_min, x_max, y_min, y_max).

    flanked: a run of beams without return reaches no farther than the nearer of the two returns beside
    it, since indoors such a run is dark or shiny material more often than open space

    end_x, end_y (n_beams,) map frame, metres   [written]
    reach        (n_beams,) metres; 0 for a beam that says nothing   [written]
    is_hit       (n_beams,) whether a surface is at the end   [written]
    """
    n = angles.shape[0]
    farthest = min(max_range, sensor_max)
    flank = farthest
    for i in range(n):
        r = ranges[i]
        is_hit[i] = False
        reach[i] = 0.0
        if r > 0 and r < sensor_max:
            is_hit[i] = r <= max_range
            reach[i] = min(float(r), max_range)
            flank = reach[i]
        elif r >= sensor_max and no_return != NEVER:
            frees = no_return == ALWAYS
            if not frees and n > 1:
                before = i == 0 or ranges[i - 1] >= sensor_max
                after = i == n - 1 or ranges[i + 1] >= sensor_max
                frees = before and after
            if frees:
                reach[i] = flank if flanked else farthest
    if flanked and no_return != NEVER:
        flank = farthest
        for i in range(n - 1, -1, -1):
            if ranges[i] < sensor_max:
                if reach[i] > 0:
                    flank = reach[i]
            else:
                reach[i] = min(reach[i], flank)
    x_min, x_max, y_min, y_max = x, x, y, y
    for i in range(n):
        direction = theta + angles[i]
        end_x[i] = x + reach[i] * math.cos(direction)
        end_y[i] = y + reach[i] * math.sin(direction)
        x_min, x_max = min(x_min, end_x[i]), max(x_max, end_x[i])
        y_min, y_max = min(y_min, end_y[i]), max(y_max, end_y[i])
    return x_min, x_max, y_min, y_max


@kernel
def mark_hits(
    end_x: NDArray[np.float64],
    end_y: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    row0: int,
    col0: int,
    shift: int,
    resolution: float,
    state: NDArray[np.uint8],
    touched: NDArray[np.int32],
) -> int:
    """State the cells that beams end in; returns how many, the first entries of `touched`."""
    n = 0
    for i in range(end_x.shape[0]):
        if is_hit[i]:
            row = math.floor(end_y[i] / resolution) - row0
            col = math.floor(end_x[i] / resolution) - col0
            k = (row << shift) + col
            if state[k] != HIT:
                state[k] = HIT
                touched[n] = k
                n += 1
    return n


@kernel
def mark_hits_at_surfaces(
    end_x: NDArray[np.float64],
    end_y: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    row0: int,
    col0: int,
    shift: int,
    resolution: float,
    snap: float,
    min_hits: int,
    directory: NDArray[np.int32],
    dir_row0: int,
    dir_col0: int,
    slot_of_cell: NDArray[np.int32],
    hit_count: NDArray[np.int32],
    state: NDArray[np.uint8],
    touched: NDArray[np.int32],
) -> int:
    """As `mark_hits`, but a stray hit counts for the surface beside it.

    Range noise puts a few of a wall's hits into the cells before and behind it. A hit at most `snap` from a
    neighbouring cell that has at least `min_hits` hits, and STRAY_RATIO times as many as its own, is one.
    """
    n = 0
    for i in range(end_x.shape[0]):
        if not is_hit[i]:
            continue
        row, col = math.floor(end_y[i] / resolution), math.floor(end_x[i] / resolution)
        off_y, off_x = end_y[i] - row * resolution, end_x[i] - col * resolution
        tile = directory[(row >> 3) - dir_row0, (col >> 3) - dir_col0]
        slot = -1
        if tile >= 0:
            slot = slot_of_cell[tile * 64 + (row & 7) * 8 + (col & 7)]
        own = 0
        if slot >= 0:
            own = hit_count[slot]
        best, best_row, best_col = max(STRAY_RATIO * (own + 1), min_hits), row, col
        for r in range(row - (off_y <= snap), row + (resolution - off_y <= snap) + 1):
            for c in range(col - (off_x <= snap), col + (resolution - off_x <= snap) + 1):
                tile = directory[(r >> 3) - dir_row0, (c >> 3) - dir_col0]
                if tile >= 0:
                    slot = slot_of_cell[tile * 64 + (r & 7) * 8 + (c & 7)]
                    if slot >= 0 and hit_count[slot] >= best:
                        best, best_row, best_col = hit_count[slot], r, c
        k = ((best_row - row0) << shift) + best_col - col0
        if state[k] != HIT:
            state[k] = HIT
            touched[n] = k
            n += 1
    return n


@kernel
def protect_surfaces(
    end_x: NDArray[np.float64],
    end_y: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    row0: int,
    col0: int,
    shift: int,
    resolution: float,
    protect: float,
    bridge: float,
    collinear: float,
    state: NDArray[np.uint8],
) -> None:
    """Mark the cells within `protect` of the surfaces in this scan, so that none of them is called free.

    Surfaces are the hits, and the line between neighbouring hits that are at most `bridge` apart and have
    the hit before or after them within `collinear` of their line.
    """
    n = end_x.shape[0]
    radius = protect / resolution
    ring = math.ceil(radius)
    step = 0.5 * resolution
    for i in range(n):
        if not is_hit[i]:
            continue
        samples = 1
        dx, dy = 0.0, 0.0
        if i + 1 < n and is_hit[i + 1]:
            dx, dy = end_x[i + 1] - end_x[i], end_y[i + 1] - end_y[i]
            gap = math.hypot(dx, dy)
            if gap > step and gap <= bridge:
                in_line = False
                if i > 0 and is_hit[i - 1]:
                    off = dx * (end_y[i - 1] - end_y[i]) - dy * (end_x[i - 1] - end_x[i])
                    in_line = abs(off) <= collinear * gap
                if not in_line and i + 2 < n and is_hit[i + 2]:
                    off = dx * (end_y[i + 2] - end_y[i]) - dy * (end_x[i + 2] - end_x[i])
                    in_line = abs(off) <= collinear * gap
                if in_line:
                    samples = math.ceil(gap / step)
        for j in range(samples):
            x = (end_x[i] + j / samples * dx) / resolution - col0
            y = (end_y[i] + j / samples * dy) / resolution - row0
            row, col = int(y), int(x)
            for r in range(row - ring, row + ring + 1):
                for c in range(col - ring, col + ring + 1):
                    k = np.uint64((r << shift) + c)
                    if state[k] == UNTOUCHED:  # rarely: successive hits lie close together
                        off_x, off_y = max(c - x, x - c - 1, 0.0), max(r - y, y - r - 1, 0.0)
                        if off_x * off_x + off_y * off_y <= radius * radius:
                            state[k] = PROTECTED


@kernel
def walk(
    start_x: float,
    start_y: float,
    ux: float,
    uy: float,
    limit: float,
    shift: int,
    resolution: float,
    path: NDArray[np.uint32],
) -> int:
    """The cells that a beam leaves before `limit` metres, in order; returns how many.

    start_x, start_y   where the beam starts, in cells from the window's corner
    ux, uy             its direction, a unit vector
    path (n_rows + n_cols or more,) uint32: entries of the window   [written]

    From cell border to cell border as Amanatides and Woo (Eurographics 1987) do, but column by column: which
    border comes next cannot be predicted, how many rows a column takes nearly can.
    """
    next_x, next_y, per_col, per_row = math.inf, math.inf, math.inf, math.inf
    step_x, step_y = 1, 1 << shift
    if ux > 0:
        per_col = resolution / ux
        next_x = (int(start_x) + 1 - start_x) * per_col
    elif ux < 0:
        step_x = -1
        per_col = -resolution / ux
        next_x = (start_x - int(start_x)) * per_col
    if uy > 0:
        per_row = resolution / uy
        next_y = (int(start_y) + 1 - start_y) * per_row
    elif uy < 0:
        step_y = -(1 << shift)
        per_row = -resolution / uy
        next_y = (start_y - int(start_y)) * per_row
    k = (int(start_y) << shift) + int(start_x)
    n = 0
    while next_x <= limit:
        while next_y < next_x:
            path[np.uint64(n)] = k  # unsigned: Numba then leaves out the test for negative indices
            n += 1
            k += step_y
            next_y += per_row
        path[np.uint64(n)] = k
        n += 1
        k += step_x
        next_x += per_col
    while next_y <= limit:
        path[np.uint64(n)] = k
        n += 1
        k += step_y
        next_y += per_row
    return n


@kernel
def free_literal(
    x: float,
    y: float,
    end_x: NDArray[np.float64],
    end_y: NDArray[np.float64],
    reach: NDArray[np.float64],
    row0: int,
    col0: int,
    shift: int,
    resolution: float,
    path: NDArray[np.uint32],
    state: NDArray[np.uint8],
    touched: NDArray[np.int32],
    n_touched: int,
) -> int:
    """State every cell that a beam leaves before its end as free; returns the new `n_touched`.

    touched needs room for one entry more than the window has cells.
    """
    n = n_touched
    start_x, start_y = x / resolution - col0, y / resolution - row0
    for i in range(end_x.shape[0]):
        length = reach[i]
        if length <= 0:
            continue
        ux, uy = (end_x[i] - x) / length, (end_y[i] - y) / length
        n_crossed = walk(start_x, start_y, ux, uy, length, shift, resolution, path)
        for j in range(n_crossed):
            k = path[np.uint64(j)]
            # Without a branch: whether another beam was here before cannot be predicted either.
            touched[np.uint64(n)] = k
            n += state[k] == UNTOUCHED
            state[k] = max(state[k], FREE)
    return n


@kernel
def free_surface(
    x: float,
    y: float,
    end_x: NDArray[np.float64],
    end_y: NDArray[np.float64],
    reach: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    row0: int,
    col0: int,
    shift: int,
    resolution: float,
    margin: float,
    clear_behind: float,
    min_hits: int,
    directory: NDArray[np.int32],
    dir_row0: int,
    dir_col0: int,
    slot_of_cell: NDArray[np.int32],
    hit_count: NDArray[np.int32],
    moments: NDArray[np.float32],
    lines: NDArray[np.float32],
    path: NDArray[np.uint32],
    state: NDArray[np.uint8],
    note: NDArray[np.int32],
    touched: NDArray[np.int32],
    n_touched: int,
) -> int:
    """As `free_literal`, but free only what is surely clear; returns the new `n_touched`.

    A cell is left out where a surface is near in this scan (state PROTECTED), and where the beam leaves it
    less than `margin` before its end. A cell with at least `min_hits` hit points in its past holds a known
    surface: only a beam that crosses the line through those points, within their extent, and ends at least
    `clear_behind` behind that line, measured square to it, finds the surface gone. `note` keeps the
    surface's slot for the window's cell.
    """
    mask = (1 << shift) - 1
    n = n_touched
    start_x, start_y = x / resolution - col0, y / resolution - row0
    for i in range(end_x.shape[0]):
        if reach[i] <= 0:
            continue
        length = reach[i]
        limit = length - margin if is_hit[i] else length
        ux, uy = (end_x[i] - x) / length, (end_y[i] - y) / length
        n_crossed = walk(start_x, start_y, ux, uy, limit, shift, resolution, path)
        for j in range(n_crossed):
            k = path[np.uint64(j)]
            here = state[k]
            if here == UNTOUCHED:
                row, col = np.int64(k >> shift) + row0, np.int64(k & mask) + col0
                tile = directory[(row >> 3) - dir_row0, (col >> 3) - dir_col0]
                slot = -1
                if tile >= 0:
                    slot = slot_of_cell[tile * 64 + (row & 7) * 8 + (col & 7)]
                    if slot >= 0 and hit_count[slot] < min_hits:
                        slot = -1
                if slot < 0:
                    state[k] = FREE
                    touched[n] = k
                    n += 1
                else:
                    note[k] = slot
                    here = KNOWN_SURFACE
                    state[k] = here
            if here == KNOWN_SURFACE:
                surface = np.uint64(note[k])
                ex, ey = lines[surface, 0], lines[surface, 1]
                if ex == 0 and ey == 0:
                    ex, ey = -uy, ux
                crossing = ux * ey - uy * ex
                if abs(crossing) >= MIN_CROSSING_SINE:
                    px = (np.int64(k & mask) + col0 + 0.5) * resolution + moments[surface, 0] - x
                    py = (np.int64(k >> shift) + row0 + 0.5) * resolution + moments[surface, 1] - y
                    at_beam = (px * ey - py * ex) / crossing
                    at_line = (px * uy - py * ux) / crossing
                    if (
                        at_beam >= 0
                        and at_beam <= limit
                        and (not is_hit[i] or (length - at_beam) * abs(crossing) >= clear_behind)
                        and abs(at_line) <= lines[surface, 2]
                    ):
                        state[k] = FREE
                        touched[n] = k
                        n += 1
    return n
