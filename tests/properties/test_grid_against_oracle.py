"""Grid, time index and analyses give what the paper, run line by line, gives."""

from __future__ import annotations

import itertools
import math
import shutil
import tempfile
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fed_grid import as_dict, empty_grid, feed, grid_of, intervals_of, moment
from oracle import paper
from same_answers import assert_same_surfaces, moments_of_interest
from strategies import STREAM_CELLS, STREAM_PROBS, Stream, odd_poses, odd_scans, streams
from tempog.analysis.dynamics import FALLBACK_LOOK_S, map_dynamics
from tempog.analysis.occupancy import CLAMP_PROB_HIGH, CLAMP_PROB_LOW, occupancy_grid
from tempog.analysis.static import CellClass, static_map
from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.errors import EmptyWindowError
from tempog.grid import temporal_grid, time_index
from tempog.grid.temporal_grid import TemporalGrid
from tempog.grid.time_index import TimeIndex
from tempog.pipeline import build_grid
from tempog.scans.scan import Scan, ScanLog, scan_period_s
from tempog.store import tables
from tempog.store.saved_map import open_map, save_map

UNSEEN = (5, 5)  # a cell no stream speaks about
BUFFERS = st.sampled_from([1, 2, 5, 2**19])  # intervals; small ones make many segments, which are merged
QUICK = settings(max_examples=60, deadline=None, derandomize=True)
TIE_M = 1e-7  # m; beams that meet a cell's corner more closely than this are rounded either way


def oracle_of(stream: Stream) -> dict:
    return paper.build_grid(stream.measurements, stream.gap_ns, stream.tolerance)


def look_ns(stamps: list[int]) -> float:
    """What a single look counts for: the median scan period."""
    steps = [later - earlier for earlier, later in itertools.pairwise(stamps)]
    period = paper.median(steps) if steps else 0
    return period if period > 0 else FALLBACK_LOOK_S * 1e9


def assert_close(got: dict, wanted: dict) -> None:
    assert got.keys() == wanted.keys()
    for cell, value in wanted.items():
        assert math.isclose(got[cell], value, rel_tol=1e-6, abs_tol=1e-7), cell


def assert_same_analyses(history, restricted: dict, stamps: list[int], look: float):
    """Dynamics, static map and occupancy of `history` equal the oracle's on the clipped intervals."""
    extent = history.extent
    for measure, weight in itertools.product(("mad", "std"), ("duration", "interval")):
        mean, dynamics, wanted = {}, {}, {}
        for cell, intervals in restricted.items():
            weights = paper.get_weights(intervals, weight, look)
            mean[cell] = paper.get_weighted_mean(intervals, weights)
            dynamics[cell] = paper.get_weighted_dynamics(intervals, weights, measure)
            wanted[cell] = CellClass.FREE if mean[cell] < 0.3 else CellClass.CHANGING
            if paper.is_static(dynamics[cell], mean[cell], 0.271828, 0.61803):
                wanted[cell] = CellClass.STATIC
        assert_close(as_dict(map_dynamics(history, measure=measure, weight=weight), extent), dynamics)
        classes = static_map(history, dynamics_below=0.271828, mean_above=0.61803, measure=measure, weight=weight)
        got = as_dict(classes, extent, unknown=CellClass.UNEXPLORED)
        assert {cell for cell in got if abs(mean[cell] - 0.3) > 1e-6 and got[cell] != wanted[cell]} == set()
        assert got.keys() == wanted.keys()
    if len(set(stamps)) == len(stamps):  # else stamps do not tell which scans an interval spans
        occupancy = {
            cell: paper.classic_occupancy(
                [value for start, stop, value in intervals for t in stamps if start <= t <= stop],
                CLAMP_PROB_LOW,
                CLAMP_PROB_HIGH,
            )
            for cell, intervals in restricted.items()
        }
        assert_close(as_dict(occupancy_grid(history), extent), occupancy)


# The time axis: Fig. 4 and every question asked of it.


@given(streams(), BUFFERS)
@QUICK
def test_every_cell_has_the_intervals_of_fig_4(stream, buffer):
    with patch.object(temporal_grid, "SEALED_BUFFER", buffer):
        grid = grid_of(stream)
    oracle = oracle_of(stream)
    for cell in [*STREAM_CELLS, UNSEEN]:
        assert intervals_of(grid, cell) == oracle.get(cell, [])
    assert grid.n_intervals == sum(len(intervals) for intervals in oracle.values())
    assert grid.n_cells == len(oracle)


@given(streams(), BUFFERS)
@QUICK
def test_the_sorted_set_of_all_intervals_is_that_of_fig_4(stream, buffer):
    with patch.object(temporal_grid, "SEALED_BUFFER", buffer):
        grid = grid_of(stream)
        runs = grid.all_runs()
    oracle = oracle_of(stream)
    assert (np.diff(runs.cells) > 0).all()
    got = {}
    for i, cell in enumerate(runs.cells):
        where = slice(runs.offsets[i], runs.offsets[i + 1])
        row, col = (int(place[0]) for place in grid.tiles.rows_cols(runs.cells[i : i + 1]))
        assert grid.tiles.cell_number(row, col) == cell
        got[row, col] = [
            [stream.stamps_ns[first], stream.stamps_ns[last], value]
            for first, last, value in zip(
                runs.first[where], runs.last[where], runs.value[where].tolist(), strict=True
            )
        ]
    assert got == oracle


# Holds lie well off every age that occurs: how exactly a border counts is a test of its own.
@given(streams(), BUFFERS, st.sampled_from([None, 100e-6, 0.1505, 1.0005, 3.0005, math.inf]))
@QUICK
def test_the_map_at_any_moment_is_that_of_the_oracle(stream, buffer, hold):
    with patch.object(temporal_grid, "SEALED_BUFFER", buffer):
        grid = grid_of(stream)
        oracle = oracle_of(stream)
        for t in moments_of_interest(stream.stamps_ns):
            snapshot = grid.at(moment(t), hold=hold)
            held_ns = 0 if hold is None else hold * 1e9
            states = {cell: paper.state_at(intervals, t, held_ns) for cell, intervals in oracle.items()}
            known = {cell: state for cell, state in states.items() if state is not None}
            assert as_dict(snapshot.value, snapshot.extent) == {c: value for c, (value, _) in known.items()}
            assert_close(as_dict(snapshot.age_s, snapshot.extent), {c: age / 1e9 for c, (_, age) in known.items()})
            assert snapshot.stamp_ns == t


@given(streams())
@QUICK
def test_one_cell_at_any_moment_is_that_of_the_oracle(stream):
    grid, oracle = grid_of(stream), oracle_of(stream)
    for cell, intervals in oracle.items():
        (x, y), *_ = grid.tiles.spec.centres([cell[0]], [cell[1]])
        history = grid.history(x, y)
        for t in moments_of_interest(stream.stamps_ns):
            state = paper.state_at(intervals, t)
            assert history.at(t) == (None if state is None else state[0])


@given(streams())
@QUICK
def test_the_gaps_of_every_cell_are_those_of_the_oracle(stream):
    grid = grid_of(stream)
    for cell, intervals in oracle_of(stream).items():
        (x, y), *_ = grid.tiles.spec.centres([cell[0]], [cell[1]])
        assert grid.history(x, y).gaps.tolist() == paper.gaps(intervals, stream.gap_ns)


@given(streams(), st.data(), st.sampled_from([0.0, 0.1505, math.inf]))
@QUICK
def test_changes_between_two_moments_are_those_of_the_oracle(stream, data, hold):
    grid, oracle = grid_of(stream), oracle_of(stream)
    times = st.sampled_from(moments_of_interest(stream.stamps_ns))
    t0, t1 = data.draw(times), data.draw(times)
    changes = grid.changes(moment(t0), moment(t1), hold=hold)
    points = changes.points_map.tolist()
    cells = [grid.tiles.spec.cell_of(x, y) for x, y in points]
    got = {
        cell: (before, after)
        for cell, before, after in zip(cells, changes.before.tolist(), changes.after.tolist(), strict=True)
    }
    assert got == paper.changes(oracle, t0, t1, hold * 1e9)


@given(streams(), BUFFERS)
@QUICK
def test_analyses_of_the_whole_history_are_those_of_the_oracle(stream, buffer):
    with patch.object(temporal_grid, "SEALED_BUFFER", buffer):
        grid = grid_of(stream)
        assert_same_analyses(grid, oracle_of(stream), stream.stamps_ns, look_ns(stream.stamps_ns))


@given(streams())
@QUICK
def test_fig_5_to_the_letter_is_the_unweighted_mean_absolute_deviation(stream):
    grid = grid_of(stream)
    wanted = {cell: paper.get_cell_dynamics(intervals) for cell, intervals in oracle_of(stream).items()}
    assert_close(as_dict(map_dynamics(grid, measure="mad", weight="interval"), grid.extent), wanted)


@given(streams(), BUFFERS, st.data())
@QUICK
def test_a_window_answers_as_the_oracle_restricted_to_it(stream, buffer, data):
    with patch.object(temporal_grid, "SEALED_BUFFER", buffer):
        grid, oracle = grid_of(stream), oracle_of(stream)
        times = st.sampled_from(moments_of_interest(stream.stamps_ns))
        t0, t1 = sorted((data.draw(times), data.draw(times)))
        inside = [stamp for stamp in stream.stamps_ns if t0 <= stamp <= t1]
        if not inside:
            with pytest.raises(EmptyWindowError):
                grid.window(moment(t0), moment(t1))
            return
        window = grid.window(moment(t0), moment(t1))
        assert window.n_scans == len(inside)
        assert window.duration_s == (inside[-1] - inside[0]) / 1e9
        whole = {cell: paper.overlapping(intervals, t0, t1) for cell, intervals in oracle.items()}
        whole = {cell: intervals for cell, intervals in whole.items() if intervals}
        for cell in [*STREAM_CELLS, UNSEEN]:
            assert intervals_of(window, cell) == whole.get(cell, [])
        assert window.n_intervals == sum(len(intervals) for intervals in whole.values())
        assert window.n_cells == len(whole)
        clipped = {cell: paper.clipped(found, inside[0], inside[-1]) for cell, found in whole.items()}
        assert_same_analyses(window, clipped, inside, look_ns(stream.stamps_ns))
        for t in inside:
            states = {cell: paper.state_at(intervals, t, math.inf) for cell, intervals in whole.items()}
            snapshot = window.at(moment(t), hold=math.inf)
            assert as_dict(snapshot.value, snapshot.extent) == {
                cell: state[0] for cell, state in states.items() if state is not None
            }


@given(streams(), st.data())
@QUICK
def test_a_window_of_a_window_is_the_window_of_both_periods(stream, data):
    grid = grid_of(stream)
    stamps = st.sampled_from(stream.stamps_ns)
    (a0, a1), (b0, b1) = (sorted((data.draw(stamps), data.draw(stamps))) for _ in range(2))
    assume(any(max(a0, b0) <= stamp <= min(a1, b1) for stamp in stream.stamps_ns))
    nested = grid.window(moment(a0), moment(a1)).window(moment(b0), moment(b1))
    direct = grid.window(moment(max(a0, b0)), moment(min(a1, b1)))
    assert (nested.first_scan, nested.last_scan) == (direct.first_scan, direct.last_scan)
    assert nested.n_intervals == direct.n_intervals
    np.testing.assert_array_equal(map_dynamics(nested), map_dynamics(direct))


# One history, however it came about.


@given(streams(), BUFFERS)
@QUICK
def test_later_scans_never_change_earlier_history(stream, buffer):
    with patch.object(temporal_grid, "SEALED_BUFFER", buffer):
        grid = empty_grid(stream)
        earlier = {}
        for stamp_ns in stream.stamps_ns:
            feed(grid, stamp_ns)
            now = {cell: intervals_of(grid, cell) for cell in STREAM_CELLS}
            for cell, intervals in earlier.items():
                kept = now[cell][: len(intervals)]
                assert kept[:-1] == intervals[:-1]
                if intervals:  # the last one was open: it may go on, but began then and is what it was
                    assert kept[-1][0::2] == intervals[-1][0::2]
                    assert kept[-1][1] >= intervals[-1][1]
            earlier = now


@given(streams(), st.data())
@QUICK
def test_questions_in_between_do_not_change_the_answers(stream, data):
    with patch.object(temporal_grid, "SEALED_BUFFER", data.draw(BUFFERS)):
        asked = empty_grid(stream)
        for stamp_ns in stream.stamps_ns:
            feed(asked, stamp_ns)
            question = data.draw(st.sampled_from(["none", "at", "history", "dynamics", "window", "runs"]))
            if question == "at":
                asked.at(moment(stamp_ns), hold=1.0)
            elif question == "history":
                intervals_of(asked, STREAM_CELLS[0])
            elif question == "dynamics":
                map_dynamics(asked)
            elif question == "window":
                _ = asked.window(moment(stamp_ns), moment(stamp_ns)).n_intervals
            elif question == "runs":
                asked.all_runs()
        quiet = grid_of(stream)
        for got, wanted in zip(asked.all_runs(), quiet.all_runs(), strict=True):
            np.testing.assert_array_equal(got, wanted)
        for cell in STREAM_CELLS:
            assert intervals_of(asked, cell) == intervals_of(quiet, cell)


@given(streams())
@settings(QUICK, max_examples=30)
def test_a_question_leaves_few_segments_each_over_twice_as_large_as_all_newer_ones(stream):
    with patch.object(temporal_grid, "SEALED_BUFFER", 1):
        grid = grid_of(stream)
        *segments, _still_open = grid.runs()
    sizes = [runs.n_intervals for runs in segments]
    assert all(size > 2 * sum(sizes[k + 1 :]) for k, size in enumerate(sizes[:-1]))
    # every interval that is no longer open, once
    assert sum(sizes) == grid.n_intervals - grid.n_cells


@given(odd_scans(max_scans=12), st.sampled_from(["literal", "surface"]))
@settings(QUICK, max_examples=20)
def test_a_batch_is_the_same_as_scan_by_scan(scans, evidence):
    period = max(scan_period_s([scan.stamp_ns for scan in scans]), 0.1)
    config = MapConfig(SensingConfig(evidence=evidence, max_range_m=5.0), GridConfig(0.1, gap_s=4.0))
    assume(not period > 4.0)
    one_by_one, batch = TemporalGrid(config), TemporalGrid(config)
    for scan in scans:
        one_by_one.integrate(scan)
    batch.integrate_many(scans)
    front_door = build_grid(ScanLog(scans), config, gap="4s")
    for other in (batch, front_door):
        for got, wanted in zip(other.all_runs(), one_by_one.all_runs(), strict=True):
            np.testing.assert_array_equal(got, wanted)
        np.testing.assert_array_equal(other.stamps_ns, one_by_one.stamps_ns)
        np.testing.assert_array_equal(other.poses, one_by_one.poses)
        n = one_by_one.surfaces.n_slots
        assert other.surfaces.n_slots == n
        np.testing.assert_array_equal(other.surfaces.moments[:n], one_by_one.surfaces.moments[:n])


@given(streams(), st.sampled_from([3, 2**18]), st.data())
@settings(QUICK, max_examples=15)
def test_a_saved_map_answers_what_the_grid_answered(stream, rows_per_group, data):
    grid = grid_of(stream)
    folder = Path(tempfile.mkdtemp())
    try:
        with patch.object(tables, "ROWS_PER_GROUP", rows_per_group):
            path = save_map(grid, folder / "map")
        lazily, saved = open_map(path), open_map(path)
        assert_same_answers(grid, saved, stream)
        # a single cell is read from a part of the file, before anything else is asked
        for cell in [*STREAM_CELLS, UNSEEN]:
            assert intervals_of(lazily, cell) == intervals_of(grid, cell)
        t0, t1 = sorted(data.draw(st.sampled_from(stream.stamps_ns)) for _ in range(2))
        assert_same_answers(grid.window(moment(t0), moment(t1)), saved.window(moment(t0), moment(t1)), stream)
    finally:
        shutil.rmtree(folder)


def assert_same_answers(grid, saved, stream: Stream) -> None:
    np.testing.assert_array_equal(saved.stamps_ns, grid.stamps_ns)
    for name in ("config", "extent", "n_scans", "n_intervals", "n_cells", "duration_s", "start_ns"):
        assert getattr(saved, name) == getattr(grid, name), name
    for t in moments_of_interest(stream.stamps_ns):
        for got, wanted in zip(saved.at(moment(t), 1.0)[:2], grid.at(moment(t), 1.0)[:2], strict=True):
            np.testing.assert_array_equal(got, wanted)
    for cell in [*STREAM_CELLS, UNSEEN]:
        assert intervals_of(saved, cell) == intervals_of(grid, cell)
    ends = moment(stream.stamps_ns[0]), moment(stream.stamps_ns[-1])
    for got, wanted in zip(saved.changes(*ends), grid.changes(*ends), strict=True):
        np.testing.assert_array_equal(got, wanted)
    for measure, weight in itertools.product(("mad", "std"), ("duration", "interval")):
        how = {"measure": measure, "weight": weight}
        np.testing.assert_array_equal(map_dynamics(saved, **how), map_dynamics(grid, **how))
        np.testing.assert_array_equal(static_map(saved, **how), static_map(grid, **how))
    np.testing.assert_array_equal(occupancy_grid(saved), occupancy_grid(grid))


@given(odd_scans(max_scans=8))
@settings(QUICK, max_examples=10)
def test_a_saved_map_of_real_scans_has_their_poses_and_hit_points(scans):
    grid = TemporalGrid(MapConfig(SensingConfig(max_range_m=5.0), GridConfig(gap_s=4.0)))
    for scan in scans:
        grid.integrate(scan)
    folder = Path(tempfile.mkdtemp())
    try:
        saved = open_map(save_map(grid, folder / "map"))
        np.testing.assert_array_equal(saved.poses, grid.poses)
        assert_same_surfaces(saved.surfaces, grid.surfaces)
    finally:
        shutil.rmtree(folder)


# The time index of section III.A.


def fill_index(intervals, order: int, with_nulls: bool) -> TimeIndex:
    """A time index of one cell's history; unseen times as null intervals if wanted."""
    index = TimeIndex(order)
    for start, stop, value in intervals:
        if with_nulls and index.last is not None and start - index.last.stop > 2:
            index.append(index.last.stop + 1, start - 1, None)
        index.append(start, start, value)
        index.extend(stop)
    return index


def nodes_by_level(index: TimeIndex) -> list[list]:
    levels = [[index._root]]
    while isinstance(levels[-1][0], time_index._Inner):
        levels.append([child for node in levels[-1] for child in node.children])
    return levels


@st.composite
def interval_lists(draw):
    """Histories of one cell with up to a few hundred intervals; some touch, some last no time at all."""
    t, intervals = 0, []
    for _ in range(draw(st.integers(0, 150))):
        t += draw(st.integers(0, 4))
        start = t
        t += draw(st.integers(0, 5))
        intervals.append([start, t, draw(st.sampled_from(STREAM_PROBS))])
    return intervals


@given(streams(), st.integers(3, 6), st.booleans())
@QUICK
def test_the_time_index_and_the_grid_agree(stream, order, with_nulls):
    grid = grid_of(stream)
    for cell in oracle_of(stream):
        intervals = intervals_of(grid, cell)
        index = fill_index(intervals, order, with_nulls)
        assert [list(entry) for entry in index if entry.value is not None] == intervals
        for t in moments_of_interest(stream.stamps_ns):
            state = paper.state_at(intervals, t)
            assert index.at(t) == (None if state is None else state[0])


@given(interval_lists(), st.integers(3, 7))
@QUICK
def test_the_time_index_answers_every_moment_and_window_as_the_oracle(intervals, order):
    index = fill_index(intervals, order, with_nulls=False)
    end = intervals[-1][1] + 2 if intervals else 2
    assert [list(entry) for entry in index] == intervals
    assert len(index) == len(intervals)
    for t in range(-1, end):
        state = paper.state_at(intervals, t)
        assert index.at(t) == (None if state is None else state[0])
    for t0 in range(-1, end, 3):
        for t1 in (t0, t0 + 1, t0 + 7, end):
            assert [list(entry) for entry in index.window(t0, t1)] == paper.overlapping(intervals, t0, t1)


@given(interval_lists(), st.integers(3, 7))
@QUICK
def test_null_intervals_are_kept_in_the_leaves_and_answer_none(intervals, order):
    index = fill_index(intervals, order, with_nulls=True)
    entries = list(index)
    assert [list(entry) for entry in entries if entry.value is not None] == intervals
    for null in (entry for entry in entries if entry.value is None):
        assert index.at(null.start) is None
        assert null in list(index.window(null.start, null.stop))


@given(interval_lists(), st.integers(3, 7))
@QUICK
def test_the_time_index_keeps_the_invariants_of_section_3a(intervals, order):
    index = fill_index(intervals, order, with_nulls=True)
    levels = nodes_by_level(index)
    leaves, inner_levels = levels[-1], levels[:-1]
    assert len(levels) == index.depth
    # the root has 2..n children unless it is a leaf
    assert not inner_levels or 2 <= len(inner_levels[0][0].children) <= order
    for level in inner_levels[1:]:
        assert all(math.ceil(order / 2) <= len(node.children) <= order for node in level[:-1])
        assert 1 <= len(level[-1].children) <= order  # the rightmost spine, in append mode
    # leaves lie on one level, and hold all keys in order
    assert all(isinstance(leaf, time_index._Leaf) for leaf in leaves)
    assert all(1 <= len(leaf.entries) <= order for leaf in leaves if len(index))
    assert [entry for leaf in leaves for entry in leaf.entries] == list(index)
    # linked in order
    assert all(leaf.next is later for leaf, later in itertools.pairwise(leaves))
    assert leaves[-1].next is None
    # k pointers and k - 1 separators, each the first time below its right neighbour
    for node in itertools.chain.from_iterable(inner_levels):
        assert node.separators == [child.lowest for child in node.children[1:]]


@given(st.integers(0, 400), st.integers(3, 7))
@settings(QUICK, max_examples=30)
def test_appending_creates_a_bounded_number_of_nodes_per_interval(n_intervals, order):
    created = []

    class CountedLeaf(time_index._Leaf):
        def __init__(self):
            created.append(self)
            super().__init__()

    class CountedInner(time_index._Inner):
        def __init__(self, children):
            created.append(self)
            super().__init__(children)

    with patch.object(time_index, "_Leaf", CountedLeaf), patch.object(time_index, "_Inner", CountedInner):
        index = TimeIndex(order)
        for k in range(n_intervals):
            index.append(k, k, 0.5)
    # closed nodes are full, so each level has 1/order of the nodes below it, and one that is filling
    assert len(created) <= n_intervals / (order - 1) + index.depth
    assert sum(len(level) for level in nodes_by_level(index)) == len(created)


# One scan to evidence.

RESOLUTION_M = 0.0503  # m; no simple fraction of the poses
MAX_RANGE_M = 4.2


def segments_of(scan: Scan, no_return: str) -> list:
    return paper.beam_segments(
        (scan.x, scan.y, scan.theta),
        scan.angles.tolist(),
        scan.ranges.tolist(),
        scan.max_range,
        MAX_RANGE_M,
        no_return,
    )


def nearest_tie_m(scan: Scan, no_return: str) -> float:
    """How close any beam comes to a corner of a cell, or its end to a border."""
    nearest = math.inf
    for x1, y1, _ in segments_of(scan, no_return):
        crossings = paper.border_crossings(scan.x, scan.y, x1, y1, RESOLUTION_M)
        length = math.hypot(x1 - scan.x, y1 - scan.y)
        steps = [float(b - a) * length for a, b in itertools.pairwise(crossings)]
        nearest = min(nearest, *steps)
    return nearest


def literal_grid(no_return: str) -> TemporalGrid:
    sensing = SensingConfig(evidence="literal", no_return=no_return, max_range_m=MAX_RANGE_M)
    grid = TemporalGrid(MapConfig(sensing, GridConfig(RESOLUTION_M, gap_s=1.0)))
    grid._mapper.gap_judged = True
    return grid


@given(odd_scans(max_beams=8), st.sampled_from(["never", "always", "neighbours"]))
@settings(QUICK, max_examples=100)
def test_literal_evidence_of_a_scan_is_that_of_the_oracle(scans, no_return):
    (scan,) = scans
    assume(nearest_tie_m(scan, no_return) > TIE_M)
    grid = literal_grid(no_return)
    grid.integrate(scan)
    snapshot = grid.at(moment(scan.stamp_ns))
    assert as_dict(snapshot.value, snapshot.extent) == {
        cell: paper.float32(0.9 if said == "hit" else 0.1) for cell, said in literal_oracle(scan, no_return).items()
    }


def literal_oracle(scan: Scan, no_return: str) -> dict:
    return paper.literal_evidence(
        (scan.x, scan.y, scan.theta),
        scan.angles.tolist(),
        scan.ranges.tolist(),
        scan.max_range,
        MAX_RANGE_M,
        no_return,
        RESOLUTION_M,
    )


@given(odd_scans(max_scans=8, max_beams=4), st.sampled_from(["never", "always", "neighbours"]), BUFFERS)
@settings(QUICK, max_examples=30)
def test_scans_become_the_history_that_the_whole_oracle_gives(scans, no_return, buffer):
    assume(all(nearest_tie_m(scan, no_return) > TIE_M for scan in scans))
    with patch.object(temporal_grid, "SEALED_BUFFER", buffer):
        grid = literal_grid(no_return)
        measurements = []
        for scan in scans:
            grid.integrate(scan)
            for cell, said in literal_oracle(scan, no_return).items():
                measurements.append((scan.stamp_ns, cell, 0.9 if said == "hit" else 0.1))
        oracle = paper.build_grid(measurements, 10**9, 0.2)
        assert grid.n_cells == len(oracle)
        for cell, intervals in oracle.items():
            assert intervals_of(grid, cell) == intervals


@given(odd_poses(), st.integers(1, 400), st.sampled_from(["literal", "surface"]))
@settings(QUICK, max_examples=100)
def test_a_ray_moves_one_cell_per_step(pose, hundredths, evidence):
    sensing = SensingConfig(evidence=evidence, free_margin_m=0, protect_m=0)
    grid = TemporalGrid(MapConfig(sensing, GridConfig(RESOLUTION_M)))
    scan = Scan(0.0, pose, [0.1], [hundredths * 0.0101])
    statements = grid._mapper.sensor.sense(scan, grid.tiles, grid.surfaces)
    rows, cols = (place.tolist() for place in grid.tiles.rows_cols(statements.cells))
    hit, *free = zip(rows, cols, strict=True)
    way = [*free, hit]
    assert way[0] == grid.tiles.spec.cell_of(pose[0], pose[1])
    for (row, col), (next_row, next_col) in itertools.pairwise(way):
        assert abs(next_row - row) + abs(next_col - col) == 1


@given(odd_scans(max_scans=6))
@settings(QUICK, max_examples=40)
def test_the_surface_model_calls_free_only_what_the_literal_model_does(scans):
    said = {}
    for evidence in ("literal", "surface"):
        sensing = SensingConfig(evidence=evidence, max_range_m=MAX_RANGE_M, snap_m=0)
        grid = TemporalGrid(MapConfig(sensing, GridConfig(RESOLUTION_M, gap_s=4.0)))
        said[evidence] = []
        for scan in scans:
            statements = grid._mapper.sensor.sense(scan, grid.tiles, grid.surfaces)
            places = zip(*(place.tolist() for place in grid.tiles.rows_cols(statements.cells)), strict=True)
            said[evidence].append(dict(zip(places, statements.prob.tolist(), strict=True)))
    for surface, literal in zip(said["surface"], said["literal"], strict=True):
        assert surface.items() <= literal.items()
        hits = {cell for cell, prob in literal.items() if prob > 0.5}
        assert hits == {cell for cell, prob in surface.items() if prob > 0.5}
