"""A map on disk, live or opened, answers what a grid in memory answers that was fed the same."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator
from concurrent.futures import wait
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fed_grid import as_dict, begin_session, config_of, empty_grid, feed, intervals_of, listening, moment
from fixed_history import a_folder, slowly_merged
from questions import ask, ask_all
from same_answers import assert_same_intervals, assert_same_states, moments_of_interest
from strategies import Stream, streams
from tempog.analysis.dynamics import map_dynamics
from tempog.grid.history import History
from tempog.grid.segments import join
from tempog.grid.temporal_grid import TemporalGrid
from tempog.store import committer, session_writer, strand, tables
from tempog.store.live_map import LiveMap
from tempog.store.saved_map import open_map

QUICK = settings(max_examples=40, deadline=None, derandomize=True)
ANY_SCANS_S = 1e-9  # s; a scan period that no gap threshold is too short for
WINDOWS = st.sampled_from([None, 1e-9, 0.05, 0.5, 3.0])


@contextlib.contextmanager
def small_segments(fanout: int, intervals: int, rows: int = 3) -> Iterator[None]:
    """Segments are merged early, and are read in small pieces."""
    with (
        patch.object(committer, "FANOUT", fanout),
        patch.object(committer, "SEGMENT_INTERVALS", intervals),
        patch.object(tables, "ROWS_PER_GROUP", rows),
        patch.object(strand, "HELD_STATES", 1),
    ):
        yield


def map_live(data: st.DataObject, stream: Stream, path: Path, grid: TemporalGrid) -> None:
    """Integrate a stream into a map on disk and into a grid, in some sessions, and ask both all the way."""
    what_next = st.sampled_from(["go on"] * 4 + ["flush", "flush", "ask", "new session"])
    live, session = None, 0
    for k, stamp_ns in enumerate(stream.stamps_ns):
        if live is None:
            window, flush_s = data.draw(WINDOWS), data.draw(st.sampled_from([0.15, 2.0, 1e6]))
            how = {"window": window, "flush_s": flush_s, "scan_period_s": ANY_SCANS_S}
            live = LiveMap(path, config_of(stream), session=str(session), journal=data.draw(st.booleans()), **how)
            begin_session(grid)
        feed(live, stamp_ns, x=k)
        feed(grid, stamp_ns, x=k)
        then = data.draw(what_next)
        if then == "flush":
            live.flush()
        elif then == "ask":
            ask(data, live, grid, stream.stamps_ns[: k + 1])
        elif then == "new session":
            live.close()
            if data.draw(st.booleans()):
                ask(data, live, grid, stream.stamps_ns[: k + 1])
            live, session = None, session + 1
    if live is not None:
        ask_all(data, live, grid, stream.stamps_ns)
        live.close()
        ask_all(data, live, grid, stream.stamps_ns)


@given(streams(), st.sampled_from([2, 3, 8]), st.sampled_from([4, 20, 2**21]), st.data())
@QUICK
def test_a_live_map_and_the_map_it_leaves_answer_as_the_grid(stream, fanout, intervals, data):
    with a_folder() as folder, small_segments(fanout, intervals):
        grid = empty_grid(stream)
        with listening(stream):
            map_live(data, stream, folder / "map", grid)
        saved = open_map(folder / "map")
        assert saved.repaired == []
        ask_all(data, saved, grid, stream.stamps_ns)
        ask_all(data, open_map(folder / "map"), grid, stream.stamps_ns)


@given(streams(), st.data())
@settings(QUICK, max_examples=15)
def test_a_session_that_is_added_as_a_whole_answers_as_the_grid(stream, data):
    with (
        a_folder() as folder,
        small_segments(2, 8),
        patch.object(session_writer, "FLUSH_INTERVALS", data.draw(st.integers(1, 9))),
    ):
        grid = empty_grid(stream)
        with (
            listening(stream),
            LiveMap(folder / "map", config_of(stream), at_once=False, scan_period_s=ANY_SCANS_S) as live,
        ):
            for k, stamp_ns in enumerate(stream.stamps_ns):
                feed(live, stamp_ns)
                feed(grid, stamp_ns)
                if data.draw(st.integers(0, 3)) == 0:
                    ask(data, live, grid, stream.stamps_ns[: k + 1])
            assert open_map(folder / "map").n_scans == 0
        ask_all(data, open_map(folder / "map"), grid, stream.stamps_ns)


@given(streams(max_scans=15), streams(max_scans=15), st.data())
@settings(QUICK, max_examples=25)
def test_a_live_map_beside_what_others_saw_meanwhile_answers_as_the_oracle(stream, others, data):
    shift = data.draw(st.sampled_from([-(10**9), 0, 1, 123_456_789])) + stream.stamps_ns[0] - others.stamps_ns[0]
    stamps = [stamp_ns + shift for stamp_ns in others.stamps_ns]
    others = replace(others, stamps_ns=stamps, gap_ns=stream.gap_ns)
    early, late = sorted((stream, others), key=lambda one: one.stamps_ns[-1], reverse=True)
    known, mine = empty_grid(early), empty_grid(late)
    with a_folder() as folder, small_segments(2, 8):
        with (
            listening(early),
            LiveMap(folder / "map", config_of(early), session="0", scan_period_s=ANY_SCANS_S) as first,
        ):
            for stamp_ns in early.stamps_ns:
                feed(known, stamp_ns)
                feed(first, stamp_ns)
        follows = early.stamps_ns[-1] <= late.stamps_ns[0]
        how = {"session": "1", "flush_s": data.draw(st.sampled_from([0.15, 1e6])), "scan_period_s": ANY_SCANS_S}
        with listening(late), LiveMap(folder / "map", config_of(late), **how) as live:
            for k, stamp_ns in enumerate(late.stamps_ns):
                feed(live, stamp_ns, x=k)
                feed(mine, stamp_ns, x=k)
                then = data.draw(st.sampled_from(["go on", "flush", "ask"]))
                if then == "flush":
                    live.flush()
                elif then == "ask" and not follows:
                    wanted = slowly_merged([mine, known])
                    ask(data, live, wanted, wanted.stamps_ns.tolist())
        assert len(open_map(folder / "map").manifest.strands) == 1 + (not follows)
        if not follows:
            wanted = slowly_merged([known, mine])
            ask_all(data, open_map(folder / "map"), wanted, wanted.stamps_ns.tolist())
            ask_all(data, open_map(folder / "map", sessions=["1"]), slowly_merged([mine]), late.stamps_ns)


def test_a_period_and_an_area_of_a_live_map_stay_what_they_are_while_it_grows(tmp_path):
    """Scans and tiles of another robot get other numbers meanwhile."""
    second, cells = 10**9, [(0, 0), (7, 7), (0, 7), (-1, -1), (-400, 3)]
    known = Stream([k * second + 1 for k in range(20)], [[(cells[4], 0.9)]] * 20, second, 0.1)
    mine = Stream(
        [k * second for k in range(5, 15)],
        [[(cells[0], 0.9 if k % 2 else 0.1), (cells[k // 3], 0.3)] for k in range(1, 11)],
        second,
        0.1,
    )
    with (
        listening(known),
        LiveMap(tmp_path / "map", config_of(known), session="0", scan_period_s=ANY_SCANS_S) as live,
    ):
        for stamp_ns in known.stamps_ns:
            feed(live, stamp_ns)

    def answers(history: History) -> list:
        states = history.at(moment(6 * second), hold=math.inf)
        return [
            history.n_scans,
            history.n_intervals,
            as_dict(states.value, states.extent),
            as_dict(map_dynamics(history), history.extent),
            *([*map(tuple, intervals_of(history, cell))] for cell in cells),
        ]

    with listening(mine), LiveMap(tmp_path / "map", config_of(mine), session="1", scan_period_s=ANY_SCANS_S) as live:
        for k, stamp_ns in enumerate(mine.stamps_ns):
            if k == 5:
                period = live.window(moment(0), moment(7 * second))
                parts = [
                    period,
                    period.area(-0.4, 0.4, -0.4, 0.4),
                    live.area(-0.4, 0.4, -0.4, 0.4),
                    live.area(-1, 1, -21, -19),
                ]
                before = [answers(part) for part in parts[:2]]
            feed(live, stamp_ns)
        assert (period.tiles.n_tiles, live.tiles.n_tiles) == (2, 3)
        assert [answers(part) for part in parts[:2]] == before
        assert len(intervals_of(parts[2], cells[0])) >= 5
        assert len(intervals_of(parts[3], cells[4])) == 1
        assert period.poses.shape == (25, 3)


def test_commits_that_waited_for_each_other_are_not_taken_for_each_other(tmp_path):
    """While the disk is slow several are handed over, and then written at one go."""
    stamps = [k * 10**9 for k in range(5)]
    stream = Stream(stamps, [[((0, 0), 0.9 if k % 2 else 0.1), ((0, 7), 0.5)] for k in range(5)], 10**9, 0.1)
    grid, disk_is_free = empty_grid(stream), threading.Event()
    with listening(stream):
        live = LiveMap(tmp_path / "map", config_of(stream), flush_s=0.5, scan_period_s=ANY_SCANS_S)
        for k, stamp_ns in enumerate(stamps):
            feed(live, stamp_ns)
            feed(grid, stamp_ns)
            if k == 0:
                live.flush()
                live._writer._committer._worker.submit(disk_is_free.wait)
    disk_is_free.set()
    live.flush()
    assert_same_intervals(live, grid)
    live.close()


def test_a_commit_that_ends_during_a_question_does_not_change_the_answer(tmp_path):
    stamps = [k * 10**9 for k in range(5)]
    stream = Stream(stamps, [[((0, 0), 0.9 if k % 2 else 0.1), ((0, 7), 0.5)] for k in range(5)], 10**9, 0.1)
    grid, disk_is_free = empty_grid(stream), threading.Event()
    with (
        listening(stream),
        LiveMap(tmp_path / "map", config_of(stream), flush_s=2, scan_period_s=ANY_SCANS_S) as live,
    ):
        for k, stamp_ns in enumerate(stamps):
            feed(live, stamp_ns)
            feed(grid, stamp_ns)
            if k == 0:
                live.flush()
                live._writer._committer._worker.submit(disk_is_free.wait)
        sets = live.runs()
        parts = [next(sets)]
        disk_is_free.set()
        wait(live._writer._futures)
        assert live.n_scans == len(stamps)
        parts += sets
    for got, wanted in zip(join(parts), grid.all_runs(), strict=True):
        np.testing.assert_array_equal(got, wanted)


def test_a_later_session_may_have_a_longer_gap_threshold(tmp_path):
    """What was mapped with it is interrupted for longer than the map's own allows."""
    second = 10**9
    stamps = [0, 10 * second, 12 * second, 19 * second]
    said = [[((0, 0), 0.9)], [((0, 0), 0.9)], [((0, 7), 0.9)], [((0, 0), 0.9)]]
    stream = Stream(stamps, said, 9 * second, 0.0)
    grid = empty_grid(stream)
    with listening(stream):
        for number, (gap_ns, scans) in enumerate([(second, stamps[:1]), (9 * second, stamps[1:])]):
            how = {"session": str(number), "scan_period_s": ANY_SCANS_S}
            with LiveMap(tmp_path / "map", config_of(Stream([], [], gap_ns, 0.0)), **how) as live:
                begin_session(grid)
                for stamp_ns in scans:
                    feed(live, stamp_ns)
                    feed(grid, stamp_ns)
                    live.flush()
                history = live if number else None
    for got in (history, open_map(tmp_path / "map")):
        for t_ns in moments_of_interest(stamps):
            assert_same_states(got, grid, t_ns, None)
