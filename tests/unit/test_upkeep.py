"""Maps compacted, pruned and merged: what stays answers as before, and what was to go is gone."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from same_history import ANGLES, CONFIG, assert_same, grid_of, room_scans
from tempog import ConfigError, GridConfig, LiveMap, MapConfig, MapError, Scan, open_map, save_map
from tempog.grid.segments import join
from tempog.store import committer, upkeep
from tempog.store.upkeep import compact, merge, prune

SOME = settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def live_map(path: Path, *sessions: list[Scan], robots: tuple[str, ...] = ("",) * 9, flush_s: float = 1.0) -> Path:
    for k, scans in enumerate(sessions):
        with LiveMap(path, CONFIG, robot=robots[k], session=f"s{k}", flush_s=flush_s) as live:
            live.integrate_many(scans)
    return path


def moment(stamp_ns: int) -> np.datetime64:
    return np.datetime64(int(stamp_ns), "ns")


def states(history, stamp_ns: int, hold: float | None):
    """Value and age of the cells that are known, by where they are."""
    snapshot = history.at(moment(stamp_ns), hold)
    rows, cols = np.nonzero(~np.isnan(snapshot.value))
    places = zip((rows + snapshot.extent.row0).tolist(), (cols + snapshot.extent.col0).tolist(), strict=True)
    return dict(zip(places, zip(snapshot.value[rows, cols], snapshot.age_s[rows, cols], strict=True), strict=True))


def names_of_files(path: Path) -> set[str]:
    return {file.relative_to(path).parts[1] for file in path.glob("segments/*/*")}


# Compacting.


def test_a_compacted_map_answers_as_before_from_few_files(tmp_path):
    scans = room_scans(200)
    path = live_map(tmp_path / "m", scans)
    before = open_map(path)
    done = compact(path)
    after = open_map(path)
    assert (done.n_segments_before, done.n_segments) == (len(before.segments), 1)
    assert done.n_bytes < done.n_bytes_before
    assert names_of_files(path) == {Path(after.segments[0].name).name}
    assert_same(after, grid_of(scans))


def test_segments_are_joined_up_to_a_size(tmp_path, monkeypatch):
    monkeypatch.setattr(committer, "SEGMENT_INTERVALS", 1)
    scans = room_scans(200)
    path = live_map(tmp_path / "m", scans)
    n_intervals = open_map(path).n_intervals
    monkeypatch.setattr(upkeep, "SEGMENT_INTERVALS", n_intervals // 6)
    compact(path)
    assert 3 <= len(open_map(path).segments) <= 6
    assert_same(open_map(path), grid_of(scans))


def test_strands_stay_strands(tmp_path):
    scans, others = room_scans(60), room_scans(60, start_s=103.05, seed=1)
    path = live_map(tmp_path / "m", scans, others, robots=("a", "b"))
    wanted = open_map(path).all_runs()
    compact(path)
    for mine, yours in zip(open_map(path).all_runs(), wanted, strict=True):
        np.testing.assert_array_equal(mine, yours)
    assert_same(open_map(path, robots=["b"]), grid_of(others))


def test_files_of_several_strands_are_not_mixed(tmp_path):
    path = live_map(tmp_path / "m", room_scans(60), room_scans(60, start_s=103.05, seed=1), robots=("a", "b"))
    saved = open_map(path)
    with pytest.raises(MapError, match="2 strands"):
        saved.files("scans")
    with pytest.raises(MapError, match="no strand 2"):
        saved.files("scans", strand=2)
    rows = [pq.read_table(file).num_rows for k in range(saved.n_strands) for file in saved.files("scans", strand=k)]
    assert sum(rows) == saved.n_scans
    assert len(open_map(live_map(tmp_path / "one", room_scans(60))).files("scans")) > 0


def test_what_cells_of_an_object_share_is_kept_once_and_comes_back(tmp_path):
    from tempog import build_grid
    from tempog.simulation import corridor, simulate

    grid = build_grid(simulate(corridor(), duration_s=150.0).scans)
    path = save_map(grid, tmp_path / "m")
    compact(path, by_reference=True)
    (segment,) = open_map(path).segments
    shared = pq.read_table(path / segment.name / "timelines.parquet").num_rows
    assert shared > 0
    assert pq.read_metadata(path / segment.name / "intervals.parquet").num_rows < segment.n_intervals - shared
    opened = open_map(path)
    for mine, yours in zip(opened.all_runs(), grid.all_runs(), strict=True):
        np.testing.assert_array_equal(mine, yours)
    assert list(open_map(path).history(6.98, 2.53)) == list(grid.history(6.98, 2.53))
    (path / segment.name / "timelines.parquet").write_bytes(b"PAR1")
    with pytest.raises(MapError, match=r"timelines\.parquet"):
        open_map(path).all_runs()


# Pruning.


@given(st.integers(0, 139), st.integers(0, 139), st.booleans())
@SOME
def test_snapshots_of_the_cut_and_later_stay_the_same(quick_path, first_cut, second_cut, many_segments):
    scans = room_scans(140)
    path = quick_path / f"{first_cut}-{second_cut}-{many_segments}"
    if not path.exists():
        live_map(path, scans, flush_s=1.0 if many_segments else math.inf)
    grid = grid_of(scans)
    for cut in (first_cut, second_cut):
        prune(path, scans[cut].stamp_ns)
    pruned = open_map(path)
    cut = max(first_cut, second_cut)
    for k in {cut, (cut + 140) // 2, 139}:
        for hold in (None, 2.0, math.inf):
            assert states(pruned, scans[k].stamp_ns, hold) == states(grid, scans[k].stamp_ns, hold)
    runs = pruned.all_runs()
    n_old = int(np.count_nonzero(pruned.stamps_ns[runs.last] < scans[cut].stamp_ns))
    assert n_old == np.count_nonzero(states_before(grid, cut))


def states_before(grid, cut: int) -> np.ndarray:
    """Of each cell that was seen before a scan: whether its state ended before."""
    runs = grid.all_runs()
    latest = [
        np.flatnonzero(runs.first[a:b] < cut)[-1:] + a for a, b in zip(runs.offsets, runs.offsets[1:], strict=False)
    ]
    which = np.concatenate(latest).astype(int)
    return runs.last[which] < cut


def test_forgetting_leaves_what_was_seen_since(tmp_path):
    scans = room_scans(140)
    path = live_map(tmp_path / "m", scans)
    cut = scans[80].stamp_ns
    prune(path, cut, forget=True)
    pruned, window = open_map(path), grid_of(scans).window(moment(cut), None)
    assert pruned.n_scans == 60
    assert pruned.stamps_ns[0] == cut
    for k in (80, 100, 139):
        assert states(pruned, scans[k].stamp_ns, math.inf) == states(window, scans[k].stamp_ns, math.inf)
    assert pruned.n_intervals == window.n_intervals


def test_what_is_forgotten_goes_from_segments_that_nothing_else_reaches_back_from(tmp_path):
    config = MapConfig(grid=GridConfig(gap_s=1.0))
    with LiveMap(tmp_path / "m", config, flush_s=1.0) as live:
        for t, theta in ((0.0, 0.0), (5.0, 1.0), (10.0, 0.0), (15.0, 2.0)):
            live.integrate(Scan(t, (0.0, 0.0, theta), [0.0], [2.0]))
            live.flush()
    prune(tmp_path / "m", 3 * 10**9, forget=True)
    pruned = open_map(tmp_path / "m")
    assert pruned.history(2.0, 0.01).start_ns.tolist() == [10 * 10**9]


def test_nothing_of_what_was_deleted_is_left_on_disk(tmp_path):
    scans = room_scans(140)
    path = live_map(tmp_path / "m", scans)
    cut = scans[100].stamp_ns
    prune(path, cut, forget=True)
    for file in path.glob("segments/*/scans.parquet"):
        assert pq.read_table(file)["stamp_ns"].to_numpy().min() >= cut
    assert names_of_files(path) == {Path(segment.name).name for segment in open_map(path).segments}


def test_saying_what_goes_deletes_nothing_and_tells_the_same(tmp_path):
    scans = room_scans(140)
    path = live_map(tmp_path / "m", scans)
    n_intervals = open_map(path).n_intervals
    said = prune(path, scans[70].stamp_ns, dry_run=True)
    assert said.n_bytes is None
    assert_same(open_map(path), grid_of(scans))
    done = prune(path, scans[70].stamp_ns)
    assert (done.n_scans, done.n_intervals, done.n_last_seen) == (said.n_scans, said.n_intervals, said.n_last_seen)
    assert open_map(path).n_intervals == n_intervals - done.n_intervals
    assert done.n_last_seen == states_of_old(open_map(path), scans[70].stamp_ns)
    (entry,) = open_map(path).manifest.pruned
    assert (entry["before_ns"], entry["n_intervals"]) == (scans[70].stamp_ns, done.n_intervals)


@pytest.mark.parametrize("forget", [False, True])
def test_cells_that_nobody_saw_since_are_counted_in_all_segments(tmp_path, forget):
    scans = [*room_scans(70), *(Scan(120.0 + k, (1.0, 0.0, 0.0), ANGLES[:9], [1.0] * 9) for k in range(20))]
    path = live_map(tmp_path / "m", scans[:70], scans[70:])
    wanted = states_of_old(open_map(path), scans[30].stamp_ns)
    assert 0 < wanted < open_map(path).n_cells
    assert prune(path, scans[30].stamp_ns, forget=forget, dry_run=True).n_last_seen == wanted


def states_of_old(history, stamp_ns: int) -> int:
    """How many cells nobody saw from a moment on."""
    runs = history.all_runs()
    return int(np.count_nonzero(history.stamps_ns[runs.last[runs.offsets[1:] - 1]] < stamp_ns))


def test_pruning_before_the_first_scan_does_nothing(tmp_path):
    path = live_map(tmp_path / "m", room_scans(40))
    files = names_of_files(path)
    assert prune(path, 0).n_intervals == 0
    assert names_of_files(path) == files
    assert open_map(path).manifest.pruned == []


def test_a_strand_that_ended_long_ago_keeps_its_last_states_or_goes(tmp_path):
    old, new = room_scans(40), room_scans(60, start_s=102.05, seed=2)
    path = live_map(tmp_path / "m", old, new, robots=("old", "new"))
    before = open_map(path)
    cut = new[30].stamp_ns
    wanted = states(before, new[-1].stamp_ns, math.inf)
    prune(path, cut)
    assert [session.robot for session in open_map(path).sessions] == ["new"]
    assert states(open_map(path), new[-1].stamp_ns, math.inf) == wanted
    prune(path, cut, forget=True)
    recent = grid_of(new).window(moment(cut), None)
    assert states(open_map(path), new[-1].stamp_ns, math.inf) == states(recent, new[-1].stamp_ns, math.inf)
    live_map(path, room_scans(10, start_s=200.0))
    assert open_map(path).n_scans == 40


def test_a_pruned_map_is_mapped_on(tmp_path):
    scans, later = room_scans(100), room_scans(50, start_s=150.0, seed=4)
    path = live_map(tmp_path / "m", scans)
    prune(path, scans[60].stamp_ns)
    with LiveMap(path, session="later", flush_s=1.0) as live:
        live.integrate_many(later)
    grid = grid_of([*scans, *later])
    for stamp_ns in (later[0].stamp_ns, later[30].stamp_ns, later[-1].stamp_ns):
        assert states(open_map(path), stamp_ns, math.inf) == states(grid, stamp_ns, math.inf)
        assert states(live, stamp_ns, math.inf) == states(grid, stamp_ns, math.inf)
    assert_same(open_map(path, sessions=["later"]), open_map(path, sessions=["later"]))
    assert open_map(path, sessions=["later"]).n_scans == 50


def test_a_map_that_is_being_written_is_neither_pruned_nor_compacted(tmp_path):
    with LiveMap(tmp_path / "m", CONFIG) as live:
        live.integrate(room_scans(1)[0])
        for change in (compact, lambda path: prune(path, 0), lambda path: merge([path, path], tmp_path / "o")):
            with pytest.raises(MapError, match="by another process"):
                change(tmp_path / "m")


def test_what_fails_half_way_leaves_the_map_as_it_was(tmp_path, monkeypatch):
    monkeypatch.setattr(committer, "SEGMENT_INTERVALS", 1)
    scans = room_scans(140)
    path = live_map(tmp_path / "m", scans)
    files, write, n = names_of_files(path), upkeep.write_segment, 0

    def full(*args, **kwargs):
        nonlocal n
        n += 1
        if n == 3:
            raise OSError(28, "No space left on device")
        return write(*args, **kwargs)

    monkeypatch.setattr(upkeep, "write_segment", full)
    monkeypatch.setattr(committer, "write_segment", full)
    monkeypatch.setattr(upkeep, "SEGMENT_INTERVALS", 2000)
    for change in (compact, lambda path: prune(path, scans[5].stamp_ns)):
        n = 0
        with pytest.raises(MapError, match="No space left"):
            change(path)
        assert names_of_files(path) == files
        assert_same(open_map(path), grid_of(scans))


# Merging.


def test_merged_maps_hold_all_sessions_and_leave_the_maps_alone(tmp_path):
    scans, others = room_scans(60), room_scans(60, start_s=103.05, seed=1)
    a = live_map(tmp_path / "a", scans, robots=("a",))
    b = live_map(tmp_path / "b", others, robots=("b",))
    merge([a, b], tmp_path / "c")
    merged = open_map(tmp_path / "c")
    assert [(session.id, session.robot) for session in merged.sessions] == [("s0", "a"), ("s0-2", "b")]
    assert merged.n_scans == 120
    assert_same(open_map(tmp_path / "c", robots=["a"]), grid_of(scans))
    assert_same(open_map(tmp_path / "c", sessions=["s0-2"]), grid_of(others))
    assert_same(open_map(a), grid_of(scans))


def test_maps_that_follow_each_other_come_to_what_one_after_the_other_was(tmp_path):
    scans, later = room_scans(60), room_scans(60, start_s=150.0, seed=1)
    merge([live_map(tmp_path / "a", scans), live_map(tmp_path / "b", later)], tmp_path / "c")
    both = join([grid_of(scans).all_runs(), grid_of(later).all_runs()])
    assert open_map(tmp_path / "c").n_intervals == both.n_intervals
    for k, (one, grid) in enumerate(((scans, grid_of(scans)), (later, grid_of(later)))):
        stamp_ns = one[30].stamp_ns
        assert states(open_map(tmp_path / "c"), stamp_ns, 1.0) == states(grid, stamp_ns, 1.0), k


def test_what_cannot_be_merged_is_said(tmp_path):
    a = live_map(tmp_path / "a", room_scans(10))
    with pytest.raises(ConfigError, match="two or more"):
        merge([a], tmp_path / "c")
    with pytest.raises(ConfigError, match="one of the maps"):
        merge([a, a], a)
    coarse = save_map(grid_of(room_scans(5), MapConfig(grid=GridConfig(0.2, gap_s=1.0))), tmp_path / "coarse")
    with pytest.raises(ConfigError, match=r"0\.1 m.*0\.2 m"):
        merge([a, coarse], tmp_path / "c")
    with pytest.raises(MapError, match="not a tempog map"):
        merge([a, tmp_path / "nothing"], tmp_path / "c")
    assert not (tmp_path / "c").exists()
    assert not list(tmp_path.glob(".c.*"))


def test_maps_of_the_same_log_are_not_merged(tmp_path):
    from tempog.pipeline import add_to_map
    from tempog.scans.scan import ScanLog

    for name in "ab":
        add_to_map([ScanLog(room_scans(10))], tmp_path / name, CONFIG)
    with pytest.raises(ConfigError, match="in another of the maps"):
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c")


def test_a_map_and_its_copies_are_not_merged(tmp_path):
    a, b = (live_map(tmp_path / name, room_scans(20, seed=seed)) for seed, name in enumerate("ab"))
    merge([a, b], tmp_path / "c")
    shutil.copytree(a, tmp_path / "copy")
    for other in (a, tmp_path / "copy"):
        with pytest.raises(ConfigError, match="given twice, or is a copy"):
            merge([a, other], tmp_path / "d")
    assert not (tmp_path / "d").exists()
    merge([a, b], tmp_path / "c", force=True)
    assert open_map(tmp_path / "c").n_scans == 40


# Saved again.


def test_what_is_left_of_a_map_is_saved_with_its_sessions(tmp_path):
    scans = room_scans(120)
    path = live_map(tmp_path / "m", scans[:60], scans[60:])
    wanted = open_map(path, sessions=["s1"])
    assert_same(open_map(save_map(wanted, tmp_path / "one"), sessions=["s1"]), wanted)
    prune(path, scans[30].stamp_ns)
    again = open_map(save_map(open_map(path), tmp_path / "again"))
    assert [session.n_scans for session in again.sessions] == [30, 60]
    assert_same(open_map(tmp_path / "again", sessions=["s1"]), open_map(path, sessions=["s1"]))
