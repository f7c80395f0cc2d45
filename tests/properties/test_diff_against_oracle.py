"""What changed between two moments equals the slow oracle."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fed_grid import grid_of, intervals_of, moment
from oracle import diff as oracle
from strategies import Stream, streams
from tempog import map_diff
from tempog.analysis.changed_cells import BREAK_S, changed_cells, looks_at
from tempog.analysis.evidence.courses import smoothed_courses
from tempog.analysis.evidence.find import for_looks_every, steady_look_ns
from tempog.analysis.patches import grouped
from tempog.analysis.series import Intervals
from tempog.methods import EvidenceConfig

QUICK = settings(max_examples=80, deadline=None, derandomize=True)


def two_of(data: st.DataObject, stamps: list[int]) -> tuple[int, int]:
    """Two moments of a log, at scans and between them, the earlier one first."""
    at = st.one_of(st.sampled_from(stamps), st.integers(stamps[0], stamps[-1]))
    before, after = sorted([data.draw(at), data.draw(at)])
    return before, after


@st.composite
def turning(draw: st.DrawFn) -> Stream:
    """Cells that hold a state for many looks, so that smoothing leaves changes."""
    cells = [(0, 0), (0, 1), (3, -2), (-1, 9)]
    courses = [
        [draw(st.sampled_from([0.1, 0.9])) for _ in range(draw(st.integers(1, 4))) for _ in range(draw(st.just(10)))]
        for _ in cells
    ]
    n = max(map(len, courses))
    missing = draw(st.sets(st.tuples(st.integers(0, len(cells) - 1), st.integers(0, n - 1)), max_size=40))
    statements = [
        [(cells[c], courses[c][k]) for c in range(len(cells)) if k < len(courses[c]) and (c, k) not in missing]
        for k in range(n)
    ]
    stamps = np.cumsum([draw(st.sampled_from([100_000_000, 100_000_000, 3_000_000_000])) for _ in range(n)])
    return Stream((stamps + 10**12).tolist(), statements, 500_000_000, 0.2)


@QUICK
@given(st.one_of(streams(), turning()), st.data())
def test_changed_cells_are_those_of_the_oracle(stream: Stream, data: st.DataObject) -> None:
    grid = grid_of(stream)
    before, after = two_of(data, stream.stamps_ns)
    looks = looks_at(grid, before, after, math.inf)
    changed = changed_cells(grid, before, after, looks)
    numbers = np.arange(grid.tiles.n_cells, dtype=np.int32)
    look = steady_look_ns(grid)
    courses = smoothed_courses(Intervals.of(grid, look), numbers, for_looks_every(look / 1e9, EvidenceConfig()))
    rows, cols = (values.tolist() for values in grid.tiles.rows_cols(numbers))
    wanted = {}
    for number in numbers.tolist():
        raw = intervals_of(grid, (rows[number], cols[number]))
        known = bool(raw) and raw[0][0] <= before
        again = oracle.seen_again(raw, before, after)
        assert looks.compared[number] == (known and again)
        if not (known and again and any(value > 0.5 for _, _, value in raw)):
            continue
        where = slice(courses.offsets[number], courses.offsets[number + 1])
        periods = (courses.start_ns, courses.stop_ns, courses.state)
        course = list(zip(*(values[where].tolist() for values in periods), strict=True))
        answer = oracle.change(course, before, after, BREAK_S * 1e9)
        if answer is not None:
            wanted[number] = answer
    assert changed.cells.tolist() == sorted(wanted)
    for k, number in enumerate(changed.cells.tolist()):
        appeared, last_before, first_after, watched, seen = wanted[number]
        assert (changed.appeared[k], changed.last_before_ns[k]) == (appeared, last_before)
        assert changed.first_after_ns[k] == first_after
        np.testing.assert_allclose([changed.watched_s[k], changed.seen_s[k]], [watched / 1e9, seen / 1e9])


@QUICK
@given(st.sets(st.tuples(st.integers(-6, 6), st.integers(-6, 6)), max_size=30), st.integers(1, 5))
def test_groups_are_those_of_the_oracle(cells: set[tuple[int, int]], reach: int) -> None:
    ordered = sorted(cells)
    rows, cols = np.array(ordered, dtype=np.int32).reshape(-1, 2).T
    found = [frozenset(ordered[k] for k in group) for group in grouped(rows, cols, reach)]
    assert sum(map(len, found)) == len(cells)
    assert set(found) == oracle.groups(cells, reach)


@settings(QUICK, max_examples=30)
@given(st.one_of(streams(), turning()), st.data())
def test_nothing_changes_within_a_moment(stream: Stream, data: st.DataObject) -> None:
    grid = grid_of(stream)
    at, _ = two_of(data, stream.stamps_ns)
    diff = map_diff(grid, moment(at), moment(at), for_s=0.0, smallest_m=0.0, surface_m=0.0)
    assert (diff.changes, diff.brief) == ((), ())
    assert diff.areas.compared_m2 == diff.areas.first_seen_m2 == 0.0


@settings(QUICK, max_examples=30)
@given(st.one_of(streams(), turning()), st.data())
def test_areas_make_up_all_that_is_known_at_either_moment(stream: Stream, data: st.DataObject) -> None:
    grid = grid_of(stream)
    before, after = two_of(data, stream.stamps_ns)
    hold = data.draw(st.sampled_from([0.0, 0.5, 3.0, math.inf]))
    diff = map_diff(grid, moment(before), moment(after), hold=hold)
    either = [~np.isnan(grid.at(moment(stamp), hold).value) for stamp in (before, after)]
    cell_m2 = grid.tiles.spec.resolution_m**2
    assert math.isclose(sum(diff.areas), np.count_nonzero(either[0] | either[1]) * cell_m2)
    assert math.isclose(diff.areas.not_seen_again_m2, np.count_nonzero(diff.not_seen_again) * cell_m2)
