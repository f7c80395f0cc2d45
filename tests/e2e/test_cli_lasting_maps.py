"""Maps that logs are added to, that are pruned, compacted and merged, as a user calls for it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from format_1 import save_format_1
from same_history import grid_of, room_scans
from tempog import Scan, open_map, write_npz
from tempog.simulation import corridor, simulate


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> tuple[Path, Path]:
    """The corridor's first minute, and the second an hour later."""
    folder = tmp_path_factory.mktemp("logs")
    scans = simulate(corridor(seed=0), duration_s=120, seed=0).scans
    later = [Scan(s.t + 3600, (s.x, s.y, s.theta), s.angles, s.ranges, s.max_range) for s in scans[600:]]
    for name, part in (("first", scans[:600]), ("second", later)):
        write_npz(folder / f"{name}.npz", part)
    return folder / "first.npz", folder / "second.npz"


@pytest.fixture
def site(tempog, logs, tmp_path) -> Path:
    """A map of both logs."""
    path = tmp_path / "site.tempog"
    assert tempog("map", logs[0], "-o", path, "--robot", "r1", "--session", "monday", "-q").code == 0
    words = ("--append", "--robot", "r2", "--session", "tuesday", "--window", "24h", "--json")
    result = tempog("map", logs[1], "-o", path, *words)
    assert (result.code, json.loads(result.out)["session"]) == (0, "tuesday")
    return path


def test_the_format_that_is_told_is_that_of_the_map(tempog, tmp_path):
    path = save_format_1(grid_of(room_scans(20)), tmp_path / "old")
    for version, command in ((1, "info"), (2, "compact")):
        assert tempog(command, path).code == 0
        assert json.loads(tempog("info", path, "--json").out)["format_version"] == version


def test_logs_added_one_by_one_are_the_map_of_both(tempog, site, logs, tmp_path):
    tempog("map", *logs, "-o", tmp_path / "both.tempog", "-q")
    one_by_one, both = open_map(site), open_map(tmp_path / "both.tempog")
    for mine, yours in zip(one_by_one.all_runs(), both.all_runs(), strict=True):
        np.testing.assert_array_equal(mine, yours)


def test_sessions_are_listed_and_chosen(tempog, site, tmp_path):
    listed = tempog("info", site).out
    assert "monday, robot r1: 600 scans" in listed
    sessions = json.loads(tempog("info", site, "--json").out)["sessions"]
    assert [(one["id"], one["robot"], one["n_scans"]) for one in sessions] == [
        ("monday", "r1", 600),
        ("tuesday", "r2", 600),
    ]
    assert json.loads(tempog("info", site, "--json").out)["format_version"] == 2
    every = json.loads(tempog("history", site, 6.98, 2.53, "--json").out)["intervals"]
    mine = json.loads(tempog("history", site, 6.98, 2.53, "--robot", "r2", "--json").out)["intervals"]
    assert 0 < len(mine) < len(every)
    assert mine == every[-len(mine) :]
    assert tempog("show", site, "--session", "monday", "-o", tmp_path / "m.png").code == 0
    unknown = tempog("show", site, "--session", "friday", "-o", tmp_path / "f.png")
    assert unknown.code == 1
    assert "no session 'friday'; it has monday, tuesday" in unknown.err


def test_what_is_in_the_map_already_is_not_added(tempog, site, logs, tmp_path):
    before = json.loads(tempog("info", site, "--json").out)
    same_file = tempog("map", logs[0], "-o", site, "--append")
    write_npz(tmp_path / "copy.npz", np_scans(logs[1]))
    same_scans = tempog("map", tmp_path / "copy.npz", "-o", site, "--append")
    assert (same_file.code, same_scans.code) == (1, 1)
    assert "as session monday; it stays as it is" in same_file.err
    assert "as session tuesday; it stays as it is" in same_scans.err
    assert json.loads(tempog("info", site, "--json").out) == before


def np_scans(log: Path) -> list[Scan]:
    from tempog import open_scans

    return list(open_scans(log))


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("--append", "--resolution", "0.1"), 2, "leave out --resolution"),
        (("--append", "--force"), 2, "give one or the other"),
        (("--append", "--window", "soon"), 2, "'soon' is not a duration"),
        (("--append", "--session", "monday"), 1, "has a session 'monday' already"),
        ((), 1, "use --append to add to it"),
    ],
)
def test_what_does_not_go_with_adding_is_said(tempog, site, tmp_path, words, code, message):
    scans = [Scan(9000.0 + k, (0, 0, 0), [0.0], [1.0]) for k in range(3)]
    write_npz(tmp_path / "new.npz", scans)
    result = tempog("map", tmp_path / "new.npz", "-o", site, *words)
    assert (result.code, message in result.err) == (code, True), result.err
    assert open_map(site).n_scans == 1200


def test_pruning_says_what_goes_and_asks(tempog, site):
    asked = tempog("prune", site, "--keep", "10min")
    assert asked.code == 2
    assert "600 of 1 200 scans" not in asked.err
    assert "go for ever" in asked.out
    assert "add --yes" in asked.err
    assert open_map(site).n_scans == 1200
    said = json.loads(tempog("prune", site, "--keep", "10min", "--dry-run", "--json").out)
    done = json.loads(tempog("prune", site, "--keep", "10min", "--yes", "--json").out)
    assert said["n_intervals"] == done["n_intervals"] > 10_000
    assert done["deleted"]
    assert done["n_bytes"] > 0
    info = json.loads(tempog("info", site, "--json").out)
    assert [one["id"] for one in info["sessions"]] == ["tuesday"]
    assert info["pruned"][0]["n_intervals"] == done["n_intervals"]
    assert "pruned" in tempog("info", site).out
    assert "older      " in tempog("info", site).out
    assert "nothing is that old" in tempog("prune", site, "--keep", "10min").out


def test_what_was_pruned_is_said_where_it_is_asked_for(tempog, site, tmp_path):
    assert tempog("prune", site, "--keep", "10min", "--yes").code == 0
    early = tempog("show", site, "--at", "+30", "-o", tmp_path / "early.png")
    late = tempog("show", site, "--at", "+3665", "-o", tmp_path / "late.png")
    assert (early.code, late.code) == (0, 0)
    assert "was pruned" in early.err
    assert "was pruned" not in late.err
    assert "was pruned" in tempog("diff", site, "--between", "+30", "+3665").err


def test_pruning_needs_to_be_told_how_much(tempog, site):
    for words in (
        (),
        ("--keep", "1h", "--before", "+10"),
        ("--keep", "never"),
        ("--keep", "30"),
        ("--before", "noon"),
    ):
        assert tempog("prune", site, *words).code == 2
    assert tempog("prune", site, "--before", "+100", "--forget", "-y").code == 0
    assert open_map(site).n_scans == 600


def test_a_map_is_compacted(tempog, site):
    before = open_map(site).all_runs()
    result = tempog("compact", site)
    assert (result.code, "2 segments" in result.out, "-> 1 segment" in result.out) == (0, True, True)
    for mine, yours in zip(open_map(site).all_runs(), before, strict=True):
        np.testing.assert_array_equal(mine, yours)


def test_maps_are_merged(tempog, logs, tmp_path):
    tempog("map", logs[0], "-o", tmp_path / "a.tempog", "-q")
    tempog("map", logs[1], "-o", tmp_path / "b.tempog", "-q")
    words = ("merge", tmp_path / "a.tempog", tmp_path / "b.tempog", "-o", tmp_path / "c.tempog")
    assert json.loads(tempog(*words, "--json").out)["n_scans"] == 1200
    n_intervals = [open_map(tmp_path / f"{name}.tempog").n_intervals for name in "abc"]
    assert n_intervals[2] == n_intervals[0] + n_intervals[1]
    assert tempog(*words).code == 1
    assert tempog(*words, "--force").code == 0
    assert tempog("merge", tmp_path / "a.tempog", "-o", tmp_path / "d.tempog").code == 2
