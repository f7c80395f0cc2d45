"""Configurations, objects and high dynamic cells are what section IV.C, run line by line, gives."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fed_grid import grid_of, moment
from oracle import objects as oracle
from oracle import paper
from strategies import STREAM_START_NS, Stream
from tempog.analysis.configurations import Configuration, Period, find_configurations
from tempog.analysis.high_dynamic import high_dynamic, high_dynamics
from tempog.analysis.objects import associate
from tempog.analysis.series import Series, look_ns, neighbouring_pairs, series_distance, time_series
from tempog.analysis.static import CellClass
from tempog.sensing.tiles import NO_CELL

QUICK = settings(max_examples=60, deadline=None, derandomize=True)
NS = 1_000_000_000
PERIOD_NS = 100_000_000
# Two rows across the border of two tiles, at negative coordinates too.
CELLS = [(row, col) for row in (-1, 0) for col in (-2, -1, 0, 1, 2)]
P = st.sampled_from([1.0, 2.0, 0.5, 3.7])
# Off every distance and time that occurs, so that rounding does not decide.
THRESHOLDS = st.sampled_from([0.0317, 0.1234, 0.3456, 0.51])
MIN_COMMON_S = st.sampled_from([0.0, 0.3, 1.0])
SHARES = st.sampled_from([0.0, 0.1003, 0.3007])


@st.composite
def leaf_streams(draw: st.DrawFn) -> Stream:
    """Cells that change together or nearly so: each scan a few of them follow one of two doors."""
    n_scans = draw(st.integers(2, 30))
    doors = [draw(st.lists(st.booleans(), min_size=n_scans, max_size=n_scans)) for _ in range(2)]
    follows = draw(st.lists(st.sampled_from([0, 0, 1, 1, 2]), min_size=len(CELLS), max_size=len(CELLS)))
    now, stamps, statements = STREAM_START_NS, [], []
    for k in range(n_scans):
        now += draw(st.sampled_from([PERIOD_NS] * 5 + [0, 5 * NS]))
        stamps.append(now)
        seen = draw(st.lists(st.sampled_from(range(len(CELLS))), unique=True, max_size=len(CELLS)))
        said = []
        for i in sorted(seen):
            state = doors[follows[i]][k] if follows[i] < 2 else not doors[0][k]
            said.append((CELLS[i], draw(st.sampled_from([0.9] * 9 + [0.7])) if state else 0.1))
        statements.append(said)
    return Stream(stamps, statements, NS, 0.15)


def periods(max_size: int = 12) -> st.SearchStrategy[list[tuple[int, int, bool]]]:
    """A configuration's series: some touch, some leave gaps."""
    steps = st.tuples(st.sampled_from([0, 0, 0, 1, 7]), st.integers(1, 9), st.booleans())

    def laid_out(triples: list[tuple[int, int, bool]]) -> list[tuple[int, int, bool]]:
        t, found = 0, []
        for gap, length, state in triples:
            found.append((t + gap, t + gap + length, state))
            t += gap + length
        return found

    return st.lists(steps, max_size=max_size).map(laid_out)


def configuration(number: int, triples: list[tuple[int, int, bool]], x: float = 0.0) -> Configuration:
    made = tuple(Period(a * NS, b * NS, "occupied" if state else "free") for a, b, state in triples)
    return Configuration(number, np.array([[0, number]], dtype=np.int32), np.array([[x, 0.0]]), made)


def as_series(triples: list[tuple[int, int, float]]) -> Series:
    start, stop, value = (np.array(column) for column in zip(*triples, strict=True)) if triples else ([], [], [])
    return Series(np.array(start, np.int64) * NS, np.array(stop, np.int64) * NS, np.array(value, np.float32))


@given(periods(), periods(), P, MIN_COMMON_S.map(lambda s: 10 * s))
@QUICK
def test_the_distance_of_two_series_is_that_of_the_oracle(first, second, p, min_common_s):
    first, second = ([(a, b, 0.75 if state else 0.25) for a, b, state in triples] for triples in (first, second))
    wanted = oracle.minkowski_distance(first, second, p, min_common_s)
    got = series_distance(as_series(first), as_series(second), distance=p, min_common_s=min_common_s)
    assert math.isnan(got) if wanted is None else math.isclose(got, wanted, rel_tol=1e-9)
    swapped = series_distance(as_series(second), as_series(first), distance=p, min_common_s=min_common_s)
    assert math.isnan(got) or math.isclose(got, swapped, rel_tol=1e-12)


@given(periods(), periods(), MIN_COMMON_S.map(lambda s: 10 * s))
@QUICK
def test_the_jaccard_distance_is_that_of_the_oracle(first, second, min_common_s):
    first, second = ([(a, b, 0.75 if state else 0.25) for a, b, state in triples] for triples in (first, second))
    wanted = oracle.jaccard_distance(first, second, min_common_s)
    got = series_distance(as_series(first), as_series(second), distance="jaccard", min_common_s=min_common_s)
    assert math.isnan(got) if wanted is None else math.isclose(got, wanted, rel_tol=1e-9, abs_tol=1e-12)


@given(st.sets(st.tuples(st.integers(-4, 4), st.integers(-4, 4))), st.sampled_from([4, 8]))
@QUICK
def test_pairs_of_neighbours_are_all_and_each_once(cells, neighbourhood):
    cells = sorted(cells)
    rows, cols = ([cell[k] for cell in cells] for k in (0, 1))
    left, right = neighbouring_pairs(rows, cols, neighbourhood)
    wanted = {
        (cells.index(cell), cells.index(other))
        for cell in cells
        for other in oracle.get_neighbouring_cells(cell, neighbourhood)
        if other in cells and cell < other
    }
    got = list(zip(left.tolist(), right.tolist(), strict=True))
    assert len(got) == len(set(got))
    assert set(got) == wanted


@given(leaf_streams(), st.data(), st.sampled_from([4, 8]), P, THRESHOLDS, MIN_COMMON_S, st.booleans())
@QUICK
def test_configurations_and_high_dynamic_cells_are_those_of_the_oracle(
    stream, data, neighbourhood, p, threshold, min_common_s, whole
):
    history = grid_of(stream)
    grid = paper.build_grid(stream.measurements, stream.gap_ns, stream.tolerance)
    inside = stream.stamps_ns
    if not whole:
        t0, t1 = sorted(data.draw(st.sampled_from(inside)) for _ in range(2))
        inside = [t for t in inside if t0 <= t <= t1]
        history = history.window(moment(t0), moment(t1))
        grid = {cell: paper.clipped(intervals, t0, t1) for cell, intervals in grid.items()}
        grid = {cell: intervals for cell, intervals in grid.items() if intervals}
    static = set(data.draw(st.lists(st.sampled_from(CELLS), max_size=3)))
    walls = np.zeros(history.extent.shape, dtype=np.int8)
    for row, col in static:
        place = (row - history.extent.row0, col - history.extent.col0)
        if 0 <= place[0] < walls.shape[0] and 0 <= place[1] < walls.shape[1]:
            walls[place] = CellClass.STATIC
    look = look_ns(history)
    settings_of_both = (p, threshold, min_common_s * 1e9, neighbourhood, look, 0.3)
    wanted = oracle.find_configurations(grid, static, *settings_of_both)
    got = find_configurations(
        history, walls, distance=p, threshold=threshold, min_common_s=min_common_s, neighbourhood=neighbourhood
    )
    assert [c.id for c in got] == list(range(1, len(wanted) + 1))
    assert [[tuple(cell) for cell in c.cells.tolist()] for c in got] == [cells for cells, _ in wanted]
    states = [[[a, b, state == "occupied"] for a, b, state in c.periods] for c in got]
    assert states == [series for _, series in wanted]
    if len(set(stream.stamps_ns)) == len(stream.stamps_ns):  # else stamps do not tell scans apart
        near = data.draw(st.sampled_from([0, 1, 1.5, 2, 2.3, 500]))  # cells; the last is wider than any map here
        explained = {"walls": walls, "configurations": got, "near_m": near * 0.05}
        now = data.draw(st.sampled_from(inside))
        moving = high_dynamic(history, moment(now), **explained)
        assert moving.stamp_ns == now
        known_static = {cell for cell in static if history.tiles.cell_number(*cell) != NO_CELL}
        assert [tuple(cell) for cell in moving.cells.tolist()] == oracle.find_highly_dynamic(
            grid, known_static, wanted, now, near
        )
        every = high_dynamics(history, **explained)
        assert [one.stamp_ns for one in every] == inside
        at_now = next(one for one in every if one.stamp_ns == now)
        np.testing.assert_array_equal(at_now.cells, moving.cells)
        np.testing.assert_array_equal(at_now.points_map, moving.points_map)


@given(leaf_streams())
@settings(QUICK, max_examples=30)
def test_the_time_series_of_cells_are_those_of_the_oracle(stream):
    history = grid_of(stream)
    grid = paper.build_grid(stream.measurements, stream.gap_ns, stream.tolerance)
    assume(grid)
    numbers = np.array([history.tiles.cell_number(*cell) for cell in grid], dtype=np.int32)
    series = time_series(history, numbers)
    for k, cell in enumerate(grid):
        got = [list(period) for period in zip(*(column.tolist() for column in series[k]), strict=True)]
        assert got == oracle.get_time_series(grid[cell], look_ns(history))


@given(st.lists(periods(), max_size=5), st.integers(2, 4), SHARES, SHARES, MIN_COMMON_S.map(lambda s: 10 * s))
@QUICK
def test_objects_are_those_of_the_oracle(series, max_states, none_share, both_share, min_common_s):
    places = [configuration(k + 1, triples) for k, triples in enumerate(series)]
    shares = {"none_share": none_share, "both_share": both_share, "min_common_s": min_common_s}
    got = associate(places, max_states=max_states, within_m=None, **shares)
    wanted = oracle.find_objects(series, max_states, none_share, both_share, min_common_s)
    assert [[c.id - 1 for c in found.configurations] for found in got] == wanted
    for found in got:
        several = [series[c.id - 1] for c in found.configurations]
        combination = oracle.combine(several)
        assert found.common_s == sum(duration for duration, _ in combination)
        assert found.none_s == sum(duration for duration, states in combination if sum(states) == 0)
        assert found.both_s == sum(duration for duration, states in combination if sum(states) > 1)
        assert found.common_s == sum((b - a) / NS for a, b, _ in found.timeline)
        assert all(later.start_ns >= earlier.stop_ns for earlier, later in itertools.pairwise(found.timeline))


@given(st.lists(st.floats(-9, 9), min_size=2, max_size=12), st.sampled_from([0.5, 2.0, 5.0]))
@QUICK
def test_only_configurations_near_each_other_are_compared_and_all_of_them(places, within_m):
    assume(all(abs(abs(a - b) - within_m) > 1e-9 for a in places for b in places))
    series = [(0, 9, True), (9, 18, False)], [(0, 9, False), (9, 18, True)]
    made = [configuration(k + 1, series[k % 2], x) for k, x in enumerate(places)]
    found = associate(made, max_states=2, within_m=within_m)
    wanted = [
        (i + 1, j + 1)
        for i, j in itertools.combinations(range(len(places)), 2)
        if (i + j) % 2 and abs(places[i] - places[j]) <= within_m
    ]
    assert [tuple(c.id for c in one.configurations) for one in found] == wanted


def test_a_callable_distance_is_asked_only_where_the_common_time_suffices():
    asked = []

    def always_close(first: Series, second: Series) -> float:
        asked.append((len(first.value), len(second.value)))
        return 0.0

    long, short = as_series([(0, 10, 1.0), (10, 20, 0.0)]), as_series([(0, 1, 1.0)])
    assert series_distance(long, long, distance=always_close, min_common_s=5) == 0
    assert math.isnan(series_distance(long, short, distance=always_close, min_common_s=5))
    assert asked == [(2, 2)]


@pytest.mark.parametrize("distance", ["euclid", 0, -1.0, math.inf, math.nan])
def test_a_distance_that_is_none_is_refused(distance):
    one = as_series([(0, 10, 1.0)])
    with pytest.raises(ValueError, match="distance"):
        series_distance(one, one, distance=distance)
