"""The paper line by line: slow, obvious, never optimised; the kernels must agree with it.

Times are integers (nanoseconds), cells are ``(row, col)`` of the lattice, and the history of a cell, the
paper's TI(c), is a list of ``[start, stop, value]`` in time order.
"""

from __future__ import annotations

import math
import struct
from fractions import Fraction

# Section III.B: building the grid.


def float32(number):
    """The nearest single-precision number: statements and thresholds are stored so."""
    return struct.unpack("f", struct.pack("f", number))[0]


def build_grid(measurements, thres_1, thres_2):
    """Fig. 4 for ``(now, cell, value)`` in time order; returns ``{cell: [[start, stop, value], ...]}``."""
    grid = {}
    for now, cell, v in measurements:
        add_measurement(grid, now, cell, v, thres_1, thres_2)
    return grid


def add_measurement(grid, now, cell, v, thres_1, thres_2):
    """The body of Fig. 4's second loop. What the figure leaves open: the first measurement creates."""
    v = float32(v)
    if cell not in grid:
        grid[cell] = [[now, now, v]]
        return
    interval = grid[cell][-1]
    _start, stop, value = interval
    if now - stop > thres_1:
        # gaping effect
        grid[cell].append([now, now, v])
    elif float32(abs(v - value)) > float32(thres_2):
        grid[cell].append([now, now, v])
    else:
        interval[1] = now  # and the value stays the interval's first


# Asking one cell's history.


def state_at(intervals, t, hold=0):
    """``(value, age)`` at `t`, or None; a cell keeps its last state for `hold` after it was last seen."""
    latest = None
    for interval in intervals:
        start, stop, value = interval
        if start <= t:
            latest = interval
    if latest is None:
        return None
    start, stop, value = latest
    age = 0
    if t > stop:
        age = t - stop
    if age > hold:
        return None
    return value, age


def overlapping(intervals, t0, t1):
    """Section IV.D: the intervals that share a moment with ``[t0, t1]``, whole."""
    found = []
    for start, stop, value in intervals:
        if start <= t1 and stop >= t0:
            found.append([start, stop, value])
    return found


def clipped(intervals, t0, t1):
    """The same, cut off at the borders."""
    found = []
    for start, stop, value in overlapping(intervals, t0, t1):
        found.append([max(start, t0), min(stop, t1), value])
    return found


def gaps(intervals, thres_1):
    """``[stop, start]`` of each period between two intervals in which the cell was not looked at."""
    found = []
    for k in range(len(intervals) - 1):
        stop = intervals[k][1]
        start = intervals[k + 1][0]
        if start - stop > thres_1:
            found.append([stop, start])
    return found


def changes(grid, t0, t1, hold):
    """``{cell: (before, after)}`` of the cells occupied at one of two moments and free at the other."""
    found = {}
    for cell in grid:
        before = state_at(grid[cell], t0, hold)
        after = state_at(grid[cell], t1, hold)
        if before is None or after is None:
            continue
        if (before[0] > 0.5) != (after[0] > 0.5):
            found[cell] = (before[0], after[0])
    return found


# Section IV.A and IV.B.


def get_mean_value(intervals):
    total = 0.0
    for _start, _stop, value in intervals:
        total = total + value
    return total / len(intervals)


def get_cell_dynamics(intervals):
    """Fig. 5 to the letter."""
    mean = get_mean_value(intervals)
    v = 0.0
    for _start, _stop, value in intervals:
        v = v + abs(value - mean)
    return v / len(intervals)


def get_weights(intervals, weight, look):
    """1 each, or each interval's duration plus one look."""
    weights = []
    for start, stop, _value in intervals:
        weights.append(1 if weight == "interval" else stop - start + look)
    return weights


def get_weighted_mean(intervals, weights):
    total = 0.0
    for (_start, _stop, value), weight in zip(intervals, weights, strict=True):
        total = total + weight * value
    return total / sum(weights)


def get_weighted_dynamics(intervals, weights, measure):
    """Fig. 5 with weights, or the standard deviation that the text of section IV.A names."""
    mean = get_weighted_mean(intervals, weights)
    v = 0.0
    for (_start, _stop, value), weight in zip(intervals, weights, strict=True):
        deviation = abs(value - mean)
        if measure == "std":
            deviation = deviation**2
        v = v + weight * deviation
    v = v / sum(weights)
    if measure == "std":
        v = math.sqrt(v)
    return v


def is_static(dynamics, mean, thres_1, thres_2):
    """Fig. 6."""
    if dynamics < thres_1 and mean > thres_2:  # noqa: SIM103 - as in the figure
        return True
    return False


def median(numbers):
    numbers = sorted(numbers)
    n = len(numbers)
    if n % 2 == 1:
        return numbers[n // 2]
    return (numbers[n // 2 - 1] + numbers[n // 2]) / 2


# The classic occupancy grid (Fig. 14).


def classic_occupancy(values, prob_low, prob_high):
    """P(occupied) after measurements one by one, by log-odds clamped after each."""
    lowest = math.log(prob_low / (1 - prob_low))
    highest = math.log(prob_high / (1 - prob_high))
    logodds = 0.0
    for value in values:
        logodds = logodds + math.log(value / (1 - value))
        logodds = min(max(logodds, lowest), highest)
    return 1 / (1 + math.exp(-logodds))


# The inverse sensor model of one scan, in exact arithmetic.


def border_crossings(x0, y0, x1, y1, resolution):
    """Where the segment crosses cell borders, as exact fractions of its length; with 0 and 1, in order."""
    side = Fraction(resolution)
    crossings = {Fraction(0), Fraction(1)}
    for start, end in ((Fraction(x0), Fraction(x1)), (Fraction(y0), Fraction(y1))):
        if start == end:
            continue
        low, high = min(start, end), max(start, end)
        for line in range(math.ceil(low / side), math.floor(high / side) + 1):
            crossings.add((line * side - start) / (end - start))
    return sorted(crossings)


def cells_of_segment(x0, y0, x1, y1, resolution):
    """The cells that a segment passes through, in order."""
    side = Fraction(resolution)
    crossings = border_crossings(x0, y0, x1, y1, resolution)
    cells = []
    for k in range(len(crossings) - 1):
        middle = (crossings[k] + crossings[k + 1]) / 2
        x = Fraction(x0) + middle * (Fraction(x1) - Fraction(x0))
        y = Fraction(y0) + middle * (Fraction(y1) - Fraction(y0))
        cells.append((math.floor(y / side), math.floor(x / side)))
    return cells


def is_no_return(reading, sensor_max):
    """REP-117: +inf, or a reading at or beyond the sensor's maximum. NaN and -inf compare false."""
    return reading >= sensor_max


def beam_end(i, ranges, sensor_max, max_range, no_return):
    """``(reach, is_hit)`` of beam `i`, or None if it says nothing."""
    reading = ranges[i]
    if is_no_return(reading, sensor_max):
        frees = no_return == "always"
        if no_return == "neighbours" and len(ranges) > 1:
            frees = True
            if i > 0 and not is_no_return(ranges[i - 1], sensor_max):
                frees = False
            if i + 1 < len(ranges) and not is_no_return(ranges[i + 1], sensor_max):
                frees = False
        if not frees:
            return None
        return min(max_range, sensor_max), False
    if not reading > 0:
        return None
    if reading > max_range:
        return max_range, False
    return reading, True


def beam_segments(pose, angles, ranges, sensor_max, max_range, no_return):
    """``(x1, y1, is_hit)`` of each beam that says something."""
    x, y, theta = pose
    ranges = [float32(reading) for reading in ranges]
    segments = []
    for i in range(len(ranges)):
        end = beam_end(i, ranges, sensor_max, max_range, no_return)
        if end is not None:
            reach, is_hit = end
            direction = theta + angles[i]
            segments.append((x + reach * math.cos(direction), y + reach * math.sin(direction), is_hit))
    return segments


def literal_evidence(pose, angles, ranges, sensor_max, max_range, no_return, resolution):
    """``{cell: "hit" or "free"}``: one statement per cell, hit before free.

    The cell a beam ends in is a hit; every cell it leaves before its end is free.
    """
    evidence = {}
    side = Fraction(resolution)
    for x1, y1, is_hit in beam_segments(pose, angles, ranges, sensor_max, max_range, no_return):
        for cell in cells_of_segment(pose[0], pose[1], x1, y1, resolution)[:-1]:
            if cell not in evidence:
                evidence[cell] = "free"
        if is_hit:
            evidence[math.floor(Fraction(y1) / side), math.floor(Fraction(x1) / side)] = "hit"
    return evidence
