"""Histories put together are what the slow overlay of their intervals is."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from fed_grid import begin_session, empty_grid, feed, grid_of
from fixed_history import a_folder, cells_of, slowly_merged, strand_of_small_segments
from oracle.overlay import latest_begun, overlay
from questions import ask_all
from same_answers import assert_same_states, moments_of_interest
from strategies import NS, Stream, odd_scans, streams
from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.grid.merged import Merged
from tempog.grid.overlay import overlay as overlay_kernel
from tempog.grid.temporal_grid import TemporalGrid
from tempog.sensing.cells import find_lines
from tempog.sensing.evidence import Sensor

QUICK = settings(max_examples=60, deadline=None, derandomize=True)


def as_kept(number: float) -> float:
    """As a history keeps it."""
    return float(np.float32(number))


VALUES = [as_kept(0.1), as_kept(0.25), as_kept(0.9)]


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
    assert all(last < first for (_, last, _), (first, _, _) in itertools.pairwise(got))
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


# Whole histories.


@st.composite
def grids_at_one_time(draw, most: int = 3) -> list[TemporalGrid]:
    """Grids of sessions in areas that overlap or not, with their own order of tiles; their scans interleave."""
    grids = []
    for number in range(draw(st.integers(1, most))):
        stream = draw(streams(max_scans=20))
        begin_ns, down, right = (
            draw(st.sampled_from([0, 1, NS // 3, 30 * NS])),
            *draw(st.sampled_from([(0, 0), (0, 0), (8, 0), (3, -5), (0, 800)])),
        )
        stamps = [stamp + begin_ns for stamp in stream.stamps_ns]
        said = [[((row + down, col + right), prob) for (row, col), prob in one] for one in stream.statements]
        grid = empty_grid(Stream(stamps, said, stream.gap_ns, stream.tolerance))
        grid.session_of = []
        for k, stamp_ns in enumerate(stamps):
            if k == 0 or draw(st.integers(0, 7)) == 0:
                begin_session(grid)
                grid.session_of.append(k)
            feed(grid, stamp_ns, x=100 * number + k)
        grids.append(grid)
    return grids


@given(grids_at_one_time(), st.sampled_from([None, 1, 4]), st.data())
@settings(QUICK, max_examples=40)
def test_histories_put_together_answer_as_the_oracle(grids, most_intervals, data):
    with a_folder() as folder:
        parts = grids
        if most_intervals is not None:
            parts = [strand_of_small_segments(grid, folder / str(k), most_intervals) for k, grid in enumerate(grids)]
        ask_all(data, Merged(parts), slowly_merged(grids), Merged(grids).stamps_ns.tolist())


def test_a_state_ends_with_the_look_before_another_one_is_believed():
    stamps = [k * NS for k in range(6)]
    of = {0: [0, 2, 5], 1: [3]}  # robot 1 sees the cell free between two looks of robot 0 that see it occupied
    grids = []
    for robot, scans in of.items():
        said = [[((0, 0), 0.1 if robot else 0.9)] for _ in scans]
        grids.append(grid_of(Stream([stamps[k] for k in scans], said, 10 * NS, 0.2)))
    merged, wanted = Merged(grids), slowly_merged(grids)
    assert cells_of(merged)[0, 0] == [(0, 1, as_kept(0.9)), (2, 2, as_kept(0.1)), (3, 3, as_kept(0.9))]
    for hold in (None, 0.1, 1.0):
        for t_ns in moments_of_interest(stamps):
            assert_same_states(merged, wanted, t_ns, hold)


@given(grids_at_one_time(2), st.sampled_from([None, 3]), st.data())
@settings(QUICK, max_examples=40)
def test_chosen_sessions_answer_as_if_there_were_no_others(grids, most_intervals, data):
    kept = []
    for grid in grids:
        ends = [*grid.session_of[1:], grid.n_scans]
        kept.append(np.repeat([data.draw(st.booleans()) for _ in ends], np.diff([0, *ends])))
    assume(any(one.any() for one in kept))
    with a_folder() as folder:
        parts = grids
        if most_intervals is not None:
            parts = [strand_of_small_segments(grid, folder / str(k), most_intervals) for k, grid in enumerate(grids)]
        wanted = slowly_merged(grids, kept)
        ask_all(data, Merged(parts, kept), wanted, wanted.stamps_ns.tolist())


@given(streams(), streams(), st.data())
@settings(QUICK, max_examples=20)
def test_what_began_after_the_other_ended_follows_it(stream, later, data):
    shift = stream.stamps_ns[-1] - later.stamps_ns[0] + data.draw(st.sampled_from([0, 1, NS]))
    later = Stream([t + shift for t in later.stamps_ns], later.statements, stream.gap_ns, stream.tolerance)
    both = Stream(
        stream.stamps_ns + later.stamps_ns,
        stream.statements + later.statements,
        stream.gap_ns,
        stream.tolerance,
    )
    one = empty_grid(both)
    for k, stamp_ns in enumerate(both.stamps_ns):
        if k == len(stream.stamps_ns):
            begin_session(one)
        feed(one, stamp_ns)
    ask_all(data, Merged([grid_of(stream), grid_of(later)]), one, both.stamps_ns)


def hit_points(scans, config: MapConfig) -> np.ndarray:
    """Where beams hit something, metres; (n, 2)."""
    sensor, points = Sensor(config), []
    for scan in scans:
        sensor._aim(scan)
        points.append(np.stack([sensor._end_x, sensor._end_y], axis=-1)[sensor._is_hit])
    return np.concatenate([np.empty((0, 2)), *points])


@given(odd_scans(max_scans=6), odd_scans(max_scans=6), st.booleans())
@settings(QUICK, max_examples=40)
def test_hit_statistics_put_together_are_those_of_all_hits(scans, others, beside):
    """... to the rounding of the float32 that each part keeps."""
    config = MapConfig(SensingConfig(max_range_m=5.0), GridConfig(gap_s=4.0))
    parts = [scans, scans[::-1][:1], others if beside else []]
    grids = []
    for part in parts:
        if part and (not grids or np.hypot(part[0].x - scans[0].x, part[0].y - scans[0].y) < 100.0):
            grids.append(TemporalGrid(config))
            grids[-1].integrate_many(part)
    merged = Merged(grids)
    points = hit_points([scan for part in parts[: len(grids)] for scan in part], config)
    spec, surfaces = merged.tiles.spec, merged.surfaces
    rows, cols = (np.floor(points[:, k] / spec.resolution_m).astype(int) for k in (1, 0))
    by_cell: dict = {}
    for row, col, point in zip(rows.tolist(), cols.tolist(), points, strict=True):
        by_cell.setdefault((row, col), []).append(point)
    assert surfaces.n_slots == len(by_cell)
    for (row, col), hits in by_cell.items():
        slot = surfaces.slot_of_cell[merged.tiles.cell_number(row, col)]
        (centre,) = spec.centres([row], [col])
        offsets = np.array(hits) - centre
        mean = offsets.mean(axis=0)
        xx, xy, _, yy = ((offsets - mean).T @ (offsets - mean) / len(hits)).ravel()
        assert surfaces.hit_count[slot] == len(hits)
        np.testing.assert_allclose(surfaces.moments[slot, :2], mean, atol=1e-8, rtol=1e-6)
        np.testing.assert_allclose(surfaces.moments[slot, 2:], (xx, xy, yy), atol=1e-10, rtol=1e-6)
    lines = surfaces.lines.copy()
    find_lines(surfaces.moments, lines)
    np.testing.assert_array_equal(surfaces.lines, lines)
