"""Sessions and robots: chosen, refused where they are unknown or known, and kept apart where they overlap in time."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from same_history import CONFIG, assert_same, assert_same_moments, grid_of, room_scans
from tempog import LiveMap, ScanLog, open_map
from tempog.cli.app import run
from tempog.errors import MapError
from tempog.pipeline import add_to_map
from tempog.scans.npz import write_npz
from tempog.store.manifest import read_manifest
from tempog.store.saved_map import save_map

FIRST = room_scans(30)
SECOND = room_scans(25, start_s=200.0, seed=1)
OTHER = room_scans(40, start_s=101.05, seed=2)  # drives at the same time as the first


LITERAL = replace(CONFIG, sensing=replace(CONFIG.sensing, evidence="literal"))  # each scan speaks for itself


def add(root, scans, config=CONFIG, **settings) -> str:
    with LiveMap(root, config, **settings) as live:
        for scan in scans:
            live.integrate(scan)
    return live.session


@pytest.fixture
def site(quick_path):
    """Three sessions of two robots; those of a and b overlap in time."""
    root = quick_path / "map"
    add(root, FIRST, robot="a", session="monday", flush_s=0.7)
    add(root, OTHER, robot="b", session="of b")
    add(root, SECOND, robot="a", session="tuesday")
    return root


@pytest.fixture
def tempog(monkeypatch, capsys):
    def call(*words):
        monkeypatch.setattr(sys, "argv", ["tempog", *map(str, words)])
        capsys.readouterr()
        code = 0
        try:
            run()
        except SystemExit as stop:
            code = int(stop.code or 0)
        return code, *capsys.readouterr()

    return call


def test_robots_that_drive_at_the_same_time_have_strands_of_their_own(site):
    manifest = read_manifest(site)
    assert [(s.id, s.robot, s.strand, s.first_scan, s.n_scans) for s in manifest.sessions] == [
        ("monday", "a", 0, 0, 30),
        ("of b", "b", 1, 0, 40),
        ("tuesday", "a", 0, 30, 25),
    ]
    opened = open_map(site)
    assert opened.n_scans == 95
    assert (np.diff(opened.stamps_ns) >= 0).all()


def test_what_a_robot_saw_is_what_its_own_grid_says(site):
    assert_answers(open_map(site, robots=["a"]), grid_of([*FIRST, *SECOND]))
    assert_answers(open_map(site, robots=["b"]), grid_of(OTHER))


def test_what_a_session_saw_is_what_its_own_grid_says(quick_path):
    root = quick_path / "map"
    add(root, FIRST, LITERAL, session="monday", flush_s=0.7)
    add(root, OTHER, LITERAL, session="of b")
    add(root, SECOND, LITERAL, session="tuesday", flush_s=0.7)
    for name, scans in (("monday", FIRST), ("tuesday", SECOND), ("of b", OTHER)):
        assert_answers(open_map(root, sessions=[name]), grid_of(scans, LITERAL))


def test_a_later_session_knows_the_surfaces_of_earlier_ones(site):
    """So it says what the grid of both says of its period."""
    of_both, tuesday = grid_of([*FIRST, *SECOND]), open_map(site, sessions=["tuesday"])
    later = {(*cell, first - 30, last - 30, value) for *cell, first, last, value in intervals(of_both) if first >= 30}
    assert intervals(tuesday) == later
    assert_answers(open_map(site, sessions=["monday"]), grid_of(FIRST))


def test_several_sessions_are_chosen_together(site):
    both = open_map(site, sessions=["monday", "tuesday"])
    assert [session.id for session in both.sessions] == ["monday", "tuesday"]
    assert_answers(both, grid_of([*FIRST, *SECOND]))
    everything = open_map(site, robots=["a", "b"])
    assert_same(everything, open_map(site))


def assert_answers(got, wanted) -> None:
    """Intervals of all cells and answers about moments are equal; tiles that others saw may be there besides."""
    np.testing.assert_array_equal(got.stamps_ns, wanted.stamps_ns)
    np.testing.assert_array_equal(got.poses, wanted.poses)
    assert (got.n_scans, got.n_cells, got.n_intervals) == (wanted.n_scans, wanted.n_cells, wanted.n_intervals)
    assert intervals(got) == intervals(wanted)
    if got.extent == wanted.extent:
        assert_same_moments(got, wanted)
    else:
        area = wanted.extent
        for share in (0.0, 0.3, 0.8, 1.0):
            moment = np.datetime64(int(wanted.stamps_ns[int(share * (wanted.n_scans - 1))]), "ns")
            mine, yours = got.at(moment, hold=5.0), wanted.at(moment, hold=5.0)
            row, col = area.row0 - got.extent.row0, area.col0 - got.extent.col0
            n_rows, n_cols = yours.value.shape
            inside = np.s_[row : row + n_rows, col : col + n_cols]
            np.testing.assert_array_equal(mine.value[inside], yours.value)
            np.testing.assert_array_equal(mine.age_s[inside], yours.age_s)
            assert np.isnan(mine.value).sum() - np.isnan(yours.value).sum() == mine.value.size - yours.value.size


def intervals(history) -> set:
    runs = history.all_runs()
    rows, cols = history.tiles.rows_cols(runs.cell)
    columns = (rows, cols, runs.first, runs.last, runs.value)
    return set(zip(*(column.tolist() for column in columns), strict=True))


@pytest.mark.parametrize(
    ("chosen", "seen", "known"),
    [
        ({"sessions": ["wednesday"]}, "session 'wednesday'", "monday, of b, tuesday"),
        ({"sessions": ["monday", "wednesday"]}, "session 'wednesday'", "monday, of b, tuesday"),
        ({"robots": ["c"]}, "robot 'c'", "a, b"),
        ({"robots": [""]}, "robot ''", "a, b"),
    ],
)
def test_unknown_names_are_told_with_those_that_are_known(site, chosen, seen, known):
    with pytest.raises(MapError, match=f"has no {seen}; it has {known}"):
        open_map(site, **chosen)


@pytest.mark.parametrize("chosen", [{"sessions": []}, {"robots": ["b"], "sessions": ["monday"]}])
def test_names_that_no_session_has_together_are_told(site, chosen):
    with pytest.raises(MapError, match="no session of these names by these robots"):
        open_map(site, **chosen)


def test_a_sessions_name_is_new(site):
    with pytest.raises(MapError, match="has a session 'monday' already"):
        LiveMap(site, session="monday")
    with LiveMap(site) as live:  # and leaves no lock
        live.integrate(room_scans(1, start_s=900.0)[0])
    assert len({session.id for session in read_manifest(site).sessions}) == 4


def test_names_that_were_made_are_unique(quick_path):
    names = {add(quick_path / "map", room_scans(1, start_s=100.0 * k)) for k in range(8)}
    assert len(names) == 8
    assert names == {session.id for session in read_manifest(quick_path / "map").sessions}


def test_a_session_without_scans_is_none(site):
    with LiveMap(site, session="nothing"):
        pass
    assert [session.id for session in open_map(site).sessions] == ["monday", "of b", "tuesday"]


def test_sessions_of_a_map_that_was_saved_again_are_kept(quick_path):
    add(quick_path / "map", FIRST, LITERAL, robot="a", session="monday")
    add(quick_path / "map", SECOND, LITERAL, robot="a", session="tuesday")
    copy = open_map(save_map(open_map(quick_path / "map"), quick_path / "copy"))
    assert copy.sessions == open_map(quick_path / "map").sessions
    assert_answers(open_map(copy.path, sessions=["tuesday"]), grid_of(SECOND, LITERAL))


def test_the_same_scans_are_added_once(quick_path):
    root = quick_path / "map"
    add_to_map([ScanLog(FIRST)], root, CONFIG, session="monday")
    add_to_map([ScanLog(SECOND)], root, session="tuesday")
    before = (root / "map.json").read_bytes()
    with pytest.raises(MapError, match="holds these scans already, as session monday"):
        add_to_map([ScanLog(FIRST)], root)
    assert (root / "map.json").read_bytes() == before
    add_to_map([ScanLog(FIRST[:-1])], root, session="fewer")
    assert open_map(root).n_scans == 84


def test_the_same_log_is_appended_once(tempog, quick_path):
    monday, renamed, tuesday = (quick_path / name for name in ("monday.npz", "renamed.npz", "tuesday.npz"))
    write_npz(monday, FIRST)
    write_npz(tuesday, SECOND)
    renamed.write_bytes(monday.read_bytes())
    root = quick_path / "map"
    assert tempog("map", monday, "-o", root, "--session", "one", "--robot", "r", "--resolution", 0.1, "-q")[0] == 0
    before = (root / "map.json").read_bytes()
    for log in (monday, renamed):
        code, _, err = tempog("map", log, "--append", "-o", root)
        assert (code, "Traceback" in err) == (1, False)
        assert "already, as session one" in err
        code, _, err = tempog("map", tuesday, log, "--append", "-o", root)
        assert (code, "already, as session one" in err) == (1, True)
    assert (root / "map.json").read_bytes() == before
    assert tempog("map", tuesday, "--append", "-o", root, "--session", "two", "-q")[0] == 0
    code, _, err = tempog("map", tuesday, "--append", "-o", root)
    assert (code, "already, as session two" in err) == (1, True)
    code, _, err = tempog("map", tuesday, "--append", "-o", root, "--session", "two")
    assert code == 1
    answer = json.loads(tempog("info", root, "--json")[1])
    assert [(s["id"], s["robot"], s["n_scans"]) for s in answer["sessions"]] == [("one", "r", 30), ("two", "", 25)]
    text = tempog("info", root)[1]
    assert "session    one, robot r: 30 scans" in text
    assert "session    two: 25 scans" in text


def test_append_needs_a_map(tempog, quick_path):
    log = quick_path / "a.npz"
    write_npz(log, FIRST)
    code, _, err = tempog("map", log, "--append", "-o", quick_path / "none")
    assert (code, "not a tempog map" in err) == (1, True)
    assert not (quick_path / "none").exists()


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (["--session", "wednesday"], 1, "has no session 'wednesday'; it has monday, of b, tuesday"),
        (["--robot", "c"], 1, "has no robot 'c'; it has a, b"),
        (["--robot", "b", "--session", "monday"], 1, "no session of these names"),
        (["--robot", "a", "--session", "monday"], 0, ""),
    ],
)
def test_commands_choose_sessions_and_robots(tempog, site, quick_path, words, code, expected):
    result = tempog("show", site, "-o", quick_path / "x.png", *words)
    assert result[0] == code
    assert expected in result[2]
    assert "Traceback" not in result[2]
    result = tempog("history", site, "1.0", "0.5", "--json", *words)
    assert result[0] == code
    if code == 0:
        assert len(json.loads(result[1])["intervals"]) == len(grid_of(FIRST).history(1.0, 0.5))
