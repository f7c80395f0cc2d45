"""What changed between two moments, cell by cell, in slow and obvious Python.

A course is the smoothed periods of a cell, ``[(start, stop, occupied), ...]`` in time order; moments are nanoseconds.
"""

from __future__ import annotations

import math


def state_at(course, moment):
    """Which period says what is known at a moment: the last that began; None if none did."""
    known = None
    for k, (start, _, _) in enumerate(course):
        if start <= moment:
            known = k
    return known


def run_around(course, k):
    """The first and the last period of the same state around period k, whatever gaps are between them."""
    first = last = k
    while first > 0 and course[first - 1][2] == course[k][2]:
        first -= 1
    while last + 1 < len(course) and course[last + 1][2] == course[k][2]:
        last += 1
    return first, last


def change(course, before, after, longest_break):
    """``(appeared, last_before, first_after, watched, seen)`` of a cell, or None if it is as it was."""
    k, m = state_at(course, before), state_at(course, after)
    if course[k][2] == course[m][2]:
        return None
    runs = [run_around(course, k), run_around(course, m)]
    appeared = bool(course[m][2])
    first, last = runs[1] if appeared else runs[0]
    seen = [sum(stop - start for start, stop, _ in course[a : b + 1]) for a, b in runs]
    new = runs[1][0]
    watched = seen[appeared]
    for k in range(first, last):
        break_ = course[k + 1][0] - course[k][1]
        if break_ <= longest_break:
            watched += break_
    return appeared, course[new - 1][1], course[new][0], watched, min(seen)


def seen_again(intervals, before, after):
    """Whether a cell's raw intervals say that it was looked at after one moment, up to another."""
    return any(stop > before and start <= after and min(stop, after) > before for start, stop, _ in intervals)


def groups(cells, reach):
    """Sets of cells that steps of up to `reach` cells join; steps to all eight neighbours if that is one cell."""
    left, found = set(cells), []
    while left:
        todo = [left.pop()]
        group = set(todo)
        while todo:
            row, col = todo.pop()
            for other in list(left):
                up, right = abs(other[0] - row), abs(other[1] - col)
                if math.hypot(up, right) <= reach or (reach == 1 and max(up, right) == 1):
                    left.remove(other)
                    group.add(other)
                    todo.append(other)
        found.append(frozenset(group))
    return set(found)
