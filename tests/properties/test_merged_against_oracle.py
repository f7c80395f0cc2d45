"""Histories put together are what the slow overlay of their intervals is."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from oracle.overlay import latest_begun, overlay
from tempog.grid.overlay import overlay as overlay_kernel

QUICK = settings(max_examples=60, deadline=None, derandomize=True)
VALUES = [np.float32(value).item() for value in (0.1, 0.25, 0.9)]


@st.composite
def cell_parts(draw) -> list[list[tuple[int, int, float]]]:
    """Intervals of one cell in some parts; they touch, overlap, begin together and last one scan."""
    parts = []
    for _ in range(draw(st.integers(1, 4))):
        scan, part = draw(st.integers(0, 8)), []
        for _ in range(draw(st.integers(0, 5))):
            length = draw(st.sampled_from([0, 0, 1, 2, 5, 12]))
            part.append((scan, scan + length, draw(st.sampled_from(VALUES[:: draw(st.integers(1, 2))]))))
            scan += length + draw(st.sampled_from([1, 1, 2, 6]))
        parts.append(part)
    return parts


def overlaid(cells: list[list[list[tuple[int, int, float]]]]) -> list[list[tuple[int, int, float]]]:
    """Each cell's intervals by the kernel."""
    rows = [
        (cell, first, number, last, value)
        for cell, parts in enumerate(cells)
        for number, part in enumerate(parts)
        for first, last, value in part
    ]
    rows.sort()
    cell, first, _, last, value = (np.array([row[k] for row in rows]) for k in range(5))
    out = [np.empty(2 * len(rows), dtype=kind) for kind in (np.int32, np.int32, np.int32, np.float32)]
    columns = (*(column.astype(np.int32) for column in (cell, first, last)), value.astype(np.float32))
    n = overlay_kernel(*columns, *out)
    result: list = [[] for _ in cells]
    for of, *interval in zip(*(column[:n].tolist() for column in out), strict=True):
        result[of].append(tuple(interval))
    return result


@given(st.lists(cell_parts(), min_size=1, max_size=4))
@settings(QUICK, max_examples=150)
# A state that was interrupted goes on beneath one that says the same: one interval, however late one looks.
@example([[[(0, 30, 0.5)], [(5, 10, 0.25)], [(8, 25, 0.5)]]])
# Of three that begin together the last one counts, and it says what was said before.
@example([[[(0, 9, 0.5)], [(4, 8, 0.25)], [(4, 5, 0.5)]]])
def test_overlaid_intervals_are_those_of_the_oracle(cells):
    for parts, got in zip(cells, overlaid(cells), strict=True):
        assert got == overlay(parts)


@given(cell_parts())
@QUICK
def test_at_each_scan_the_state_that_began_latest_counts(parts):
    (got,) = overlaid([parts])
    assert all(last < first for (_, last, _), (first, _, _) in pairwise(got))
    states = {scan: value for first, last, value in got for scan in range(first, last + 1)}
    for scan in range(80):
        state = latest_begun(parts, scan)
        assert states.get(scan) == (None if state is None else state[2])


@given(cell_parts())
@QUICK
def test_one_history_alone_stays_as_it_is(parts):
    assert overlaid([[parts[0]]]) == [parts[0]]


@given(cell_parts(), st.integers(0, 40), st.integers(0, 20))
@settings(QUICK, max_examples=200)
def test_a_period_of_a_cell_does_not_depend_on_what_was_before_or_after(parts, since, length):
    until = since + length
    inside = [[one for one in part if one[0] <= until and one[1] >= since] for part in parts]
    clipped = [
        [
            (max(first, since), min(last, until), value)
            for first, last, value in intervals
            if first <= until and last >= since
        ]
        for intervals in (*overlaid([inside]), *overlaid([parts]))
    ]
    assert clipped[0] == clipped[1]
