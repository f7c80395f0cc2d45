"""Section IV.C line by line: configurations, objects, high dynamic cells. Slow, obvious, never optimised.

A history is ``{cell: [[start, stop, value], ...]}`` as in `oracle.paper`; a time series has the same form, but its
periods end where the next begins or one look after the last. Times are integers (nanoseconds).
"""

from __future__ import annotations

import itertools
import math

# Time series (Fig. 8).


def get_time_series(intervals, look):
    """An interval lasts until a look after it was last seen, or until the next begins."""
    series = []
    for k in range(len(intervals)):
        start, stop, value = intervals[k]
        stop = stop + look
        if k + 1 < len(intervals):
            stop = min(stop, intervals[k + 1][0])
        series.append([start, stop, value])
    return series


def value_during(series, t0, t1):
    """The value throughout ``[t0, t1)``, in which no series changes; None where not observed."""
    for start, stop, value in series:
        if start <= t0 and t1 <= stop:
            return value
    return None


def stretches(several):
    """All ``(t0, t1)`` between moments at which one of several series changes."""
    moments = set()
    for series in several:
        for start, stop, _value in series:
            moments.add(start)
            moments.add(stop)
    return list(itertools.pairwise(sorted(moments)))


def minkowski_distance(series1, series2, p, min_common):
    """Over commonly observed time, divided by it; None if that is too short."""
    total = 0.0
    common = 0
    for t0, t1 in stretches([series1, series2]):
        value1 = value_during(series1, t0, t1)
        value2 = value_during(series2, t0, t1)
        if value1 is None or value2 is None:
            continue
        common = common + (t1 - t0)
        total = total + abs(value1 - value2) ** p * (t1 - t0)
    if common == 0 or common < min_common:
        return None
    return (total / common) ** (1 / p)


def jaccard_distance(series1, series2, min_common):
    """Of the commonly observed time in which one was occupied, the share in which the other was not."""
    common = 0
    either = 0
    both = 0
    for t0, t1 in stretches([series1, series2]):
        value1 = value_during(series1, t0, t1)
        value2 = value_during(series2, t0, t1)
        if value1 is None or value2 is None:
            continue
        common = common + (t1 - t0)
        if value1 > 0.5 or value2 > 0.5:
            either = either + (t1 - t0)
        if value1 > 0.5 and value2 > 0.5:
            both = both + (t1 - t0)
    if common == 0 or common < min_common or either == 0:
        return None
    return 1 - both / either


# Step 1, Fig. 7.


def was_occupied(intervals):
    return any(value > 0.5 for _start, _stop, value in intervals)


def get_neighbouring_cells(cell, neighbourhood):
    row, col = cell
    cells = [(row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)]
    if neighbourhood == 8:
        cells += [(row - 1, col - 1), (row - 1, col + 1), (row + 1, col - 1), (row + 1, col + 1)]
    return cells


def find_configurations(grid, static, p, threshold, min_common, neighbourhood, look, seen_share):
    """``[(cells, periods), ...]``: sorted cells of each pattern, and its combined series."""
    series = {}
    for cell in grid:
        if cell not in static and was_occupied(grid[cell]):
            series[cell] = get_time_series(grid[cell], look)
    pattern_of = {cell: {cell} for cell in series}
    for c in series:
        for n in get_neighbouring_cells(c, neighbourhood):
            if n not in series:
                continue
            distance = minkowski_distance(series[c], series[n], p, min_common)
            if distance is not None and distance < threshold:
                joined = pattern_of[c] | pattern_of[n]
                for cell in joined:
                    pattern_of[cell] = joined
    patterns = []
    for cell in sorted(series):
        pattern = sorted(pattern_of[cell])
        if len(pattern) > 1 and pattern[0] == cell:
            patterns.append((pattern, get_pattern_series([series[c] for c in pattern], seen_share)))
    return patterns


def get_pattern_series(several, seen_share):
    """``[[start, stop, occupied], ...]``: the majority of the cells seen, while enough of them were."""
    periods = []
    for t0, t1 in stretches(several):
        values = [value_during(series, t0, t1) for series in several]
        seen = [value for value in values if value is not None]
        if len(seen) == 0 or len(seen) < seen_share * len(several):
            continue
        occupied = [value for value in seen if value > 0.5]
        state = len(occupied) > len(seen) / 2
        if len(periods) > 0 and periods[-1][1] == t0 and periods[-1][2] == state:
            periods[-1][1] = t1
        else:
            periods.append([t0, t1, state])
    return periods


# Step 2, Fig. 10.


def combine(several):
    """``[(duration, states), ...]`` of the time in which all were seen; the rest is filtered out."""
    combination = []
    for t0, t1 in stretches(several):
        states = [value_during(series, t0, t1) for series in several]
        if None not in states:
            combination.append((t1 - t0, states))
    return combination


def is_valid_object(several, none_share, both_share, min_common):
    """The combined series has the occupied value at any time; somebody in the doorway is tolerated."""
    combination = combine(several)
    common = sum(duration for duration, _states in combination)
    if common == 0 or common < min_common:
        return False
    for k in range(len(several)):
        if not any(states[k] for _duration, states in combination):
            return False
    none = sum(duration for duration, states in combination if sum(states) == 0)
    both = sum(duration for duration, states in combination if sum(states) > 1)
    return none <= none_share * common and both <= both_share * common


def find_objects(patterns, max_states, none_share, both_share, min_common):
    """Indices of each object's patterns, all combinations of 2, then of 3, ... tried."""
    objects = []
    for k in range(2, max_states + 1):
        for combination in itertools.combinations(range(len(patterns)), k):
            if is_valid_object([patterns[i] for i in combination], none_share, both_share, min_common):
                objects.append(list(combination))
    return objects


# Fig. 11.


def find_highly_dynamic(grid, static, patterns, now, near=0):
    """Cells occupied at the measurement `now`, and more than `near` cells from static ones and patterns."""
    found = []
    explained = list(static)
    for cells, _periods in patterns:
        explained = explained + list(cells)
    for cell in grid:
        for start, stop, value in grid[cell]:
            if start <= now <= stop and value > 0.5:
                if not any(math.dist(cell, other) <= near for other in explained):
                    found.append(cell)
                break
    return sorted(set(found))
