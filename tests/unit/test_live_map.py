"""What a live map promises beside the answers of a grid: windows that are held, settings, sessions, what stays."""

from __future__ import annotations

from dataclasses import replace
from threading import Event

import numpy as np
import pytest

from same_history import CONFIG, assert_same, grid_of, room_scans
from tempog import LiveMap, map_dynamics, open_map
from tempog.errors import ConfigError, ExtentError, MapError, ScanError
from tempog.scans.scan import Scan
from tempog.store import committer
from tempog.store.journal import JournalWriter
from tempog.store.upkeep import merge


def moved(scans: list[Scan], x_m: float) -> list[Scan]:
    """The same room elsewhere."""
    return [
        Scan(0.0, (scan.x + x_m, scan.y, scan.theta), scan.angles, scan.ranges, stamp_ns=scan.stamp_ns)
        for scan in scans
    ]


def test_windows_and_areas_that_are_held_do_not_change_when_a_second_robot_maps_on(tmp_path):
    scans = room_scans(120)
    with LiveMap(tmp_path / "m", CONFIG, robot="a") as live:
        live.integrate_many(scans[40:])
    with LiveMap(tmp_path / "m", robot="b", flush_s=1.0) as live:
        live.integrate_many(room_scans(40, seed=1)[:20])
        window, area = live.window(scans[50].t, scans[90].t), live.area(-1.0, 1.0, -1.0, 2.0)
        n_scans = live.n_scans

        def answers():
            start_ns, stop_ns = (int(window.stamps_ns[k]) for k in (window.first_scan, window.last_scan))
            return start_ns, stop_ns, list(window.history(0.0, 1.95)), map_dynamics(window), map_dynamics(area)

        before = answers()
        assert before[:2] == (scans[50].stamp_ns, scans[90].stamp_ns)
        assert before[2]
        live.integrate_many(moved(room_scans(40, seed=1)[20:], 20.0))  # new tiles, and scans between the others
        assert live.n_scans == n_scans + 20
        after = answers()
    assert after[:3] == before[:3]
    for mine, yours in zip(after[3:], before[3:], strict=True):
        np.testing.assert_array_equal(mine, yours)
    assert window.poses.shape == (n_scans, 3)


def test_a_session_may_reach_farther_than_the_map_was_allowed_to(tmp_path):
    scans = room_scans(60)
    small, large = (replace(CONFIG, grid=replace(CONFIG.grid, max_cells=n)) for n in (10_000, 2**26))
    with LiveMap(tmp_path / "m", small) as live:
        live.integrate_many(scans[:20])
        with pytest.raises(ExtentError, match="raise --max-cells"):
            live.integrate(moved(scans, 50.0)[20])
    with LiveMap(tmp_path / "m", large) as live:
        live.integrate_many(moved(scans, 50.0)[20:40])
    with LiveMap(tmp_path / "m") as live:
        live.integrate_many(moved(scans, 50.0)[40:])
    assert open_map(tmp_path / "m").n_scans == 60


def test_what_robots_saw_too_far_apart_can_be_asked_for_one_by_one(tmp_path):
    scans = room_scans(20)
    small = replace(CONFIG, grid=replace(CONFIG.grid, max_cells=10_000))
    for path, robots in (("both", "ab"), ("a", "a"), ("b", "b")):
        for robot in robots:
            with LiveMap(tmp_path / path, small, robot=robot) as live:
                live.integrate_many(moved(scans, 50.0) if robot == "b" else scans)
    with pytest.raises(MapError, match="too far apart"):
        open_map(tmp_path / "both")
    assert_same(open_map(tmp_path / "both", robots=["a"]), grid_of(scans))
    with pytest.raises(MapError, match="too far apart"):
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_sessions_and_robots_are_chosen_by_any_iterable(tmp_path):
    scans = room_scans(40)
    for k in range(2):
        with LiveMap(tmp_path / "m", CONFIG, session=f"s{k}") as live:
            live.integrate_many(scans[20 * k : 20 * k + 20])
    assert open_map(tmp_path / "m", sessions=(name for name in ["s1"]), robots=iter([""])).n_scans == 20


def test_a_session_that_is_added_as_a_whole_leaves_nothing_if_it_fails(tmp_path):
    scans = room_scans(40)
    with (
        pytest.raises(ScanError, match="earlier than the one before"),
        LiveMap(tmp_path / "m", CONFIG, at_once=False, flush_s=1.0) as live,
    ):
        live.integrate_many([*scans, scans[0]])
    opened = open_map(tmp_path / "m")
    assert (opened.n_scans, opened.repaired) == (0, [])


def test_the_journal_is_gone_once_a_map_is_closed(tmp_path):
    with LiveMap(tmp_path / "m", CONFIG) as live:
        live.integrate_many(room_scans(10))
        assert (tmp_path / "m" / "journal").is_dir()
    assert {file.name for file in (tmp_path / "m").iterdir()} == {"map.json", "segments"}


def test_a_source_that_nothing_is_known_of_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"'path': 'x'.* lacks format, n_scans, n_skipped, notes, sha256"):
        LiveMap(tmp_path / "m", CONFIG, sources=[{"path": "x"}])
    assert not (tmp_path / "m").exists()


def test_the_journal_goes_to_the_disk_while_a_commit_takes_long(tmp_path, monkeypatch):
    may_commit, synced = Event(), []
    write_segment, sync = committer.write_segment, JournalWriter.sync

    def slow(*args, **kwargs):
        may_commit.wait(60)
        return write_segment(*args, **kwargs)

    def noted(writer):
        sync(writer)  # an error is one of a file that was closed too early
        synced.append(writer.first_scan)

    monkeypatch.setattr(committer, "write_segment", slow)
    monkeypatch.setattr(JournalWriter, "sync", noted)
    scans = room_scans(60)
    with LiveMap(tmp_path / "m", CONFIG, flush_s=2.0) as live:
        try:
            live.integrate_many(scans)
            live._writer._syncs.submit(int).result(60)  # those before are done
            assert len(synced) >= 6  # each second, and each journal that another one follows
            assert synced == sorted(synced)
            assert len(set(synced)) == 3
        finally:
            may_commit.set()
    assert_same(open_map(tmp_path / "m"), grid_of(scans))
