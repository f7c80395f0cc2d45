"""Maps on disk: all of a map or nothing, nothing else touched, and damage told as damage."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from same_history import debris
from tempog.analysis.dynamics import map_dynamics
from tempog.analysis.occupancy import occupancy_grid
from tempog.analysis.static import static_map
from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.errors import MapError, TimeError
from tempog.grid.temporal_grid import TemporalGrid
from tempog.scans.scan import Scan, ScanLog
from tempog.store import manifest, rewrite, segment_files, tables
from tempog.store.manifest import only_writer, read_manifest
from tempog.store.saved_map import open_map, save_map
from tempog.store.tables import hash_file

TABLES = ["scans", "tiles", "intervals", "open", "surfaces"]
FILES = ["map.json", *(f"{name}.parquet" for name in TABLES)]


def small_grid(n_scans: int = 12, distance: float = 2.0) -> TemporalGrid:
    """A door that opens and closes, seen from a robot that drives."""
    grid = TemporalGrid(MapConfig(SensingConfig(max_range_m=6.0), GridConfig(0.1, gap_s=2.0, tolerance=0.3)))
    for k in range(n_scans):
        ranges = np.linspace(1, distance + (k % 3), 15)
        grid.integrate(Scan(100 + 0.3 * k, (0.1 * k + 0.03, 0.02, 0.1), np.linspace(-1, 1, 15), ranges))
    return grid


@pytest.fixture
def tmp_path(quick_path):
    return quick_path


@pytest.fixture
def saved(tmp_path):
    """Path of a saved map."""
    return save_map(small_grid(), tmp_path / "map")


def data_of(path):
    (data,) = path.glob("segments/*")
    return data


def file_of(path, name):
    return path / name if name == "map.json" else data_of(path) / name


def contents(folder) -> dict:
    """Every file below a folder and what it holds."""
    return {
        str(file.relative_to(folder)): file.read_bytes() if file.is_file() else None
        for file in sorted(folder.rglob("*"))
    }


def ask_everything(path) -> list:
    saved = open_map(path)
    answers = [saved.n_scans, saved.n_intervals, saved.n_cells, *saved.at("+1", hold=5.0)]
    answers += [map_dynamics(saved), static_map(saved), occupancy_grid(saved), *saved.changes("+0", "+3")]
    answers += [list(saved.history(1.5, 0.05)), list(open_map(path).history(1.5, 0.05))]
    answers += [saved.surfaces.moments, saved.poses, saved.window("+1", "+2").n_intervals, saved.bytes_on_disk]
    return answers


def edit_manifest(path, **changes) -> None:
    manifest = json.loads((path / "map.json").read_text()) | changes
    (path / "map.json").write_text(json.dumps(manifest))


def edit_table(path, name, edit) -> None:
    file = data_of(path) / f"{name}.parquet"
    pq.write_table(edit(pq.read_table(file)), file)


# Round trips; properties hold many more.


def test_a_saved_map_answers_what_the_grid_answers(saved):
    grid, opened = small_grid(), open_map(saved)
    assert opened.config == grid.config
    assert (opened.n_scans, opened.n_intervals, opened.n_cells) == (
        grid.n_scans,
        grid.n_intervals,
        grid.n_cells,
    )
    np.testing.assert_array_equal(opened.at("+2").value, grid.at("+2").value)
    np.testing.assert_array_equal(opened.poses, grid.poses)
    np.testing.assert_array_equal(map_dynamics(opened), map_dynamics(grid))


def test_a_grid_without_scans_is_saved_and_opened(tmp_path):
    opened = open_map(save_map(TemporalGrid(), tmp_path / "map"))
    assert (opened.n_scans, opened.n_intervals, opened.n_cells) == (0, 0, 0)
    assert len(opened.history(0.0, 0.0)) == 0
    assert map_dynamics(opened).shape == (0, 0)
    with pytest.raises(TimeError, match="no scans yet"):
        opened.at(0.0)


def test_a_map_whose_scans_said_nothing_is_saved_and_opened(tmp_path):
    grid = TemporalGrid()
    grid.integrate(Scan(5.0, (0, 0, 0), [0.0], [math.nan]))
    opened = open_map(save_map(grid, tmp_path / "map"))
    assert (opened.n_scans, opened.n_intervals) == (1, 0)
    assert opened.at(5.0).value.shape == (0, 0)


def test_a_map_can_be_saved_while_mapping_goes_on(tmp_path):
    grid = small_grid(6)
    save_map(grid, tmp_path / "map")
    grid.integrate(Scan(110.0, (0.0, 0.0, 0.0), [0.0], [1.0]))
    assert grid.n_scans == 7
    assert open_map(tmp_path / "map").n_scans == 6


def test_a_map_with_a_stray_hit_in_an_unseen_tile_can_be_opened(tmp_path):
    grid = TemporalGrid()
    for k, x in enumerate([1.18] * 8 + [1.21]):  # the last falls into a tile that nobody saw
        grid.integrate(Scan(0.1 * k, (0.01, 0.02, 0.0), [0.0], [x - 0.01]))
    surfaces = open_map(save_map(grid, tmp_path / "map")).surfaces
    assert sorted(surfaces.hit_count.tolist()) == [1, 8]


def test_the_manifest_tells_what_the_map_holds(saved):
    grid, document = small_grid(), json.loads((saved / "map.json").read_text())
    assert document["n_scans"] == grid.n_scans
    assert document["n_intervals"] == grid.n_intervals
    assert (document["start_ns"], document["stop_ns"]) == (grid.stamps_ns[0], grid.stamps_ns[-1])
    assert MapConfig.from_dict(document["config"]) == grid.config
    ((segment,),) = read_manifest(saved).strands
    assert (segment.first_scan, segment.n_scans, segment.n_cells) == (0, grid.n_scans, grid.n_cells)
    (session,) = open_map(saved).sessions
    assert (session.strand, session.first_scan, session.n_scans) == (0, 0, grid.n_scans)
    assert (session.start_ns, session.stop_ns) == (grid.stamps_ns[0], grid.stamps_ns[-1])


def test_what_was_saved_in_several_segments_answers_the_same(tmp_path, monkeypatch):
    grid = small_grid(40)
    contents_of = rewrite.contents_of
    monkeypatch.setattr(rewrite, "contents_of", lambda history: contents_of(history, 100))
    opened = open_map(save_map(grid, tmp_path / "map"))
    assert len(opened.segments) > 3
    for got, wanted in zip(opened.all_runs(), grid.all_runs(), strict=True):
        np.testing.assert_array_equal(got, wanted)
    for t in ("+0", "+5", "+11.7"):
        np.testing.assert_array_equal(opened.at(t, hold=3.0).value, grid.at(t, hold=3.0).value)
    assert opened.bytes_on_disk == sum(
        file.stat().st_size for file in (tmp_path / "map").rglob("*") if file.is_file()
    )


def test_sources_are_kept_with_their_hashes_and_notes(tmp_path):
    file = tmp_path / "a.log"
    file.write_text("the log")
    log = ScanLog([Scan(0.0, (0, 0, 0), [], [])], str(file), "CARMEN", ("mended",), 3)
    opened = open_map(save_map(small_grid(), tmp_path / "map", sources=[log]))
    assert opened.sessions[0].sources == [
        {
            "path": str(file),
            "sha256": hash_file(file),
            "format": "CARMEN",
            "n_scans": 1,
            "n_skipped": 3,
            "notes": ["mended"],
        }
    ]


def test_bytes_on_disk_are_those_of_all_files(saved):
    assert open_map(saved).bytes_on_disk == sum(len(content or b"") for content in contents(saved).values())


def test_the_tables_are_as_the_format_says(saved):
    columns = {name: pq.read_schema(data_of(saved) / f"{name}.parquet") for name in TABLES}
    assert {name: dict(zip(s.names, map(str, s.types), strict=True)) for name, s in columns.items()} == {
        "scans": {"scan": "int32", "stamp_ns": "int64", "x": "double", "y": "double", "theta": "double"},
        "tiles": {"tile": "int32", "row": "int32", "col": "int32"},
        "intervals": {"cell": "int32", "first_scan": "int32", "span": "int32", "prob": "float"},
        "open": {"cell": "int32", "first_scan": "int32", "span": "int32", "prob": "float"},
        "surfaces": {"cell": "int32", "hits": "int32"}
        | dict.fromkeys(["mean_x", "mean_y", "cov_xx", "cov_xy", "cov_yy"], "float"),
    }


# Reading no more than needed.


@pytest.fixture
def groups_read(monkeypatch):
    """Numbers of the row groups of ended intervals that were read."""
    read, files = [], [None]
    read_groups, read_table = pq.ParquetFile.read_row_groups, segment_files.read_table

    def watched_table(path, *args):
        files.append(path)
        return read_table(path, *args)

    def watched_groups(self, groups, *args, **kwargs):
        if files[-1].name == "intervals.parquet":
            read.extend(groups)
        return read_groups(self, groups, *args, **kwargs)

    monkeypatch.setattr(segment_files, "read_table", watched_table)
    monkeypatch.setattr(pq.ParquetFile, "read_row_groups", watched_groups)
    return read


def test_a_cells_history_is_read_from_the_row_groups_that_hold_it(tmp_path, monkeypatch, groups_read):
    monkeypatch.setattr(tables, "ROWS_PER_GROUP", 10)
    grid = small_grid(24)
    path = save_map(grid, tmp_path / "map")
    n_groups = pq.ParquetFile(data_of(path) / "intervals.parquet").num_row_groups
    assert n_groups > 20
    for row, col in [(0, 5), (3, 10), (-5, 12)]:
        groups_read.clear()
        x, y = (col + 0.5) * 0.1, (row + 0.5) * 0.1
        assert list(open_map(path).history(x, y)) == list(grid.history(x, y))
        assert 0 < len(grid.history(x, y)) <= 10
        assert 1 <= len(groups_read) <= 2


def test_a_place_outside_the_map_is_answered_without_reading_intervals(saved, groups_read):
    opened = open_map(saved)
    (data_of(saved) / "intervals.parquet").unlink()
    assert len(opened.history(900.0, 0.0)) == 0
    assert groups_read == []


def test_opening_reads_no_intervals(saved):
    (data_of(saved) / "intervals.parquet").write_bytes(b"not looked at")
    assert open_map(saved).n_scans == 12


@pytest.mark.parametrize("table", TABLES)
def test_a_missing_table_is_told_when_the_map_is_opened(saved, table):
    (data_of(saved) / f"{table}.parquet").unlink()
    with pytest.raises(MapError, match=rf"{table}\.parquet is missing"):
        open_map(saved)


def test_an_opened_map_can_be_saved_again(saved, tmp_path):
    copy = save_map(open_map(saved), tmp_path / "copy")
    for got, wanted in zip(open_map(copy).all_runs(), open_map(saved).all_runs(), strict=True):
        np.testing.assert_array_equal(got, wanted)


def test_after_all_intervals_were_read_a_history_needs_no_file(saved, groups_read):
    opened = open_map(saved)
    expected = list(open_map(saved).history(1.5, 0.05))
    assert opened.all_runs().n_intervals > 0
    assert groups_read != []
    groups_read.clear()
    assert list(opened.history(1.5, 0.05)) == expected
    assert groups_read == []


# Writing: what is there already.


def test_an_existing_map_is_not_overwritten_without_force(saved, tmp_path):
    before = contents(tmp_path)
    with pytest.raises(MapError, match=r"exists already; use --append to add to it, --force"):
        save_map(small_grid(5), saved)
    assert contents(tmp_path) == before


def test_force_replaces_a_map(saved, tmp_path):
    save_map(small_grid(5), saved, force=True)
    assert open_map(saved).n_scans == 5
    assert sorted(file.name for file in saved.iterdir()) == ["map.json", "segments"]
    assert data_of(saved).is_dir()
    assert [file.name for file in tmp_path.iterdir()] == ["map"]


def test_force_makes_a_map_where_there_is_none(tmp_path):
    assert open_map(save_map(small_grid(5), tmp_path / "map", force=True)).n_scans == 5


def test_parent_folders_are_made(tmp_path):
    assert open_map(save_map(small_grid(5), tmp_path / "a" / "b" / "map")).n_scans == 5


def test_force_replaces_a_map_of_a_newer_version(saved):
    edit_manifest(saved, format_version=99)
    save_map(small_grid(5), saved, force=True)
    assert open_map(saved).n_scans == 5


def folder_of_photos(target):
    target.mkdir()
    (target / "photo.jpg").write_bytes(b"photo")


def empty_folder(target):
    target.mkdir()


def plain_file(target):
    target.write_text("my thesis")


def folder_with_another_map_json(target):
    target.mkdir()
    (target / "map.json").write_text('{"format": "treasure"}')
    (target / "data-of-mine").mkdir()


def folder_with_a_broken_map_json(target):
    target.mkdir()
    (target / "map.json").write_text('{"format": "tem')


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize(
    "make",
    [folder_of_photos, empty_folder, plain_file, folder_with_another_map_json, folder_with_a_broken_map_json],
)
def test_what_is_no_map_is_never_touched(tmp_path, make, force):
    make(tmp_path / "map")
    before = contents(tmp_path)
    with pytest.raises(MapError):
        save_map(small_grid(5), tmp_path / "map", force=force)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("make", [folder_of_photos, empty_folder, plain_file])
def test_what_is_no_map_is_not_said_to_be_one_that_force_would_replace(tmp_path, make):
    make(tmp_path / "map")
    with pytest.raises(MapError, match="is not a tempog map, so it stays as it is"):
        save_map(small_grid(5), tmp_path / "map")


@pytest.mark.parametrize("path", ["", ".", "/"])
def test_a_map_needs_a_name_of_its_own(path):
    with pytest.raises(MapError, match="directory of its own"):
        save_map(small_grid(5), path, force=True)


def test_a_map_that_cannot_be_written_is_an_error_of_ours(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(MapError, match="could not be written"):
        save_map(small_grid(5), tmp_path / "file" / "map")


def test_a_source_that_is_gone_is_an_error_of_ours_and_leaves_nothing(tmp_path):
    log = ScanLog([], str(tmp_path / "gone.log"))
    with pytest.raises(MapError, match=r"gone\.log"):
        save_map(small_grid(5), tmp_path / "map", sources=[log])
    assert list(tmp_path.iterdir()) == []


# Writing: crashes on the way.

CRASHES = [OSError("disk full"), pa.ArrowInvalid("bad"), KeyboardInterrupt(), MemoryError()]


class Crash:
    """Takes the place of a function; the call with this number raises, before or after its work."""

    def __init__(self, function, number: int, error: BaseException, after: bool = False) -> None:
        self.function, self.number, self.error, self.after = function, number, error, after
        self.n_calls = 0

    def __call__(self, *args, **kwargs):
        self.n_calls += 1
        if self.n_calls == self.number and not self.after:
            raise self.error
        result = self.function(*args, **kwargs)
        if self.n_calls == self.number:
            raise self.error
        return result


def wanted_error(error: BaseException) -> type[BaseException]:
    return MapError if isinstance(error, OSError | pa.ArrowException) else type(error)


@pytest.mark.parametrize("error", CRASHES, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("table", [1, 3, 5])
def test_a_crash_while_writing_a_new_map_leaves_nothing(tmp_path, monkeypatch, table, error):
    monkeypatch.setattr(segment_files, "write_table", Crash(segment_files.write_table, table, error))
    with pytest.raises(wanted_error(error)):
        save_map(small_grid(5), tmp_path / "map")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", CRASHES, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("table", [1, 3, 5])
def test_a_crash_while_replacing_a_map_leaves_the_old_one(saved, tmp_path, monkeypatch, table, error):
    before = contents(tmp_path)
    monkeypatch.setattr(segment_files, "write_table", Crash(segment_files.write_table, table, error))
    with pytest.raises(wanted_error(error)):
        save_map(small_grid(5), saved, force=True)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
def test_a_crash_in_the_one_rename_that_counts_leaves_a_whole_map(saved, tmp_path, monkeypatch, after):
    crash = Crash(Path.replace, 2, KeyboardInterrupt(), after)  # the first makes the new map beside the old one
    monkeypatch.setattr(Path, "replace", lambda *paths: crash(*paths))
    with pytest.raises(KeyboardInterrupt):
        save_map(small_grid(5), saved, force=True)
    monkeypatch.undo()
    assert open_map(saved).n_scans == (5 if after else 12)
    assert len(ask_everything(saved)) > 0


N_SYNCS = 10  # five tables and two folders of the segment, the manifest, and two folders
N_SYNCS_OF_REPLACING = N_SYNCS + 3  # the folder the segment is moved to, the manifest, and its folder


def crash_in_sync(monkeypatch, number: int) -> Crash:
    crash = Crash(os.fsync, number, KeyboardInterrupt())
    monkeypatch.setattr(os, "fsync", crash)
    return crash


def test_a_map_is_put_on_the_disk_in_as_many_steps_as_are_tested(tmp_path, monkeypatch):
    crash = crash_in_sync(monkeypatch, 99)
    save_map(small_grid(5), tmp_path / "map")
    assert crash.n_calls == N_SYNCS
    save_map(small_grid(5), tmp_path / "map", force=True)
    assert crash.n_calls == N_SYNCS + N_SYNCS_OF_REPLACING


@pytest.mark.parametrize("number", range(1, N_SYNCS_OF_REPLACING + 1))
def test_an_interrupt_at_any_step_of_replacing_leaves_one_whole_map(saved, tmp_path, monkeypatch, number):
    crash_in_sync(monkeypatch, number)
    with pytest.raises(KeyboardInterrupt):
        save_map(small_grid(5), saved, force=True)
    assert open_map(saved).n_scans == (12 if number < N_SYNCS_OF_REPLACING - 1 else 5)
    assert len(ask_everything(saved)) > 0
    assert debris(saved) == []
    assert [file.name for file in tmp_path.iterdir()] == ["map"]


@pytest.mark.parametrize("number", range(1, N_SYNCS + 1))
def test_an_interrupt_at_any_step_of_a_new_map_leaves_all_of_it_or_nothing(tmp_path, monkeypatch, number):
    crash_in_sync(monkeypatch, number)
    with pytest.raises(KeyboardInterrupt):
        save_map(small_grid(5), tmp_path / "map")
    left = [file.name for file in tmp_path.iterdir()]
    assert left in ([], ["map"])
    assert not left or open_map(tmp_path / "map").n_scans == 5


def test_debris_of_an_earlier_crash_is_cleared_by_the_next_save(saved):
    for name in ("data-12345678", "segments/0000000012-12345678"):
        (saved / name).mkdir()
        (saved / name / "scans.parquet").write_bytes(b"half")
    (saved / "map.json.unfinished").write_text("{")
    save_map(small_grid(5), saved, force=True)
    assert debris(saved) == []
    assert data_of(saved).is_dir()


# Reading: damage is told as damage.


def test_a_map_that_is_not_there_is_told_with_how_to_make_one(tmp_path):
    with pytest.raises(MapError, match=r"no such directory.*tempog map"):
        open_map(tmp_path / "map")


def test_a_folder_that_is_no_map_is_told_so(tmp_path):
    with pytest.raises(MapError, match=r"holds no map\.json"):
        open_map(tmp_path)


def test_a_file_that_is_no_map_is_told_so(tmp_path):
    (tmp_path / "log").write_text("FLASER")
    with pytest.raises(MapError, match="is a file, not a tempog map"):
        open_map(tmp_path / "log")


def test_a_map_of_a_newer_format_says_upgrade(saved):
    edit_manifest(saved, format_version=3, tempog_version="9.9")
    with pytest.raises(MapError, match=r"map format 3, written by tempog 9\.9.*Upgrade tempog"):
        open_map(saved)


@pytest.mark.parametrize("version", [None, "1", 0, -1, 1.5, [1]])
def test_a_format_version_we_do_not_know_is_refused(saved, version):
    edit_manifest(saved, format_version=version)
    with pytest.raises(MapError):
        open_map(saved)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '"text"', "{}", '{"format": "tempog-map"}', "\x00"])
def test_a_map_json_of_something_else_is_refused(saved, text):
    (saved / "map.json").write_text(text)
    with pytest.raises(MapError):
        open_map(saved)


def test_a_map_json_that_is_no_text_is_refused(saved):
    (saved / "map.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MapError, match=r"map\.json cannot be read"):
        open_map(saved)


def edit_entry(path, where, key, value) -> None:
    """Change an entry of map.json, of its first session or of its first segment; GONE removes it."""
    document = json.loads((path / "map.json").read_text())
    entries = {"map": document, "session": document["sessions"][0], "segment": document["strands"][0][0]}[where]
    entries[key] = value
    if value is GONE:
        del entries[key]
    (path / "map.json").write_text(json.dumps(document))


GONE = object()
ENTRIES = [("map", key) for key in ("config", "strands", "sessions", "pruned", "retired", "id")]
ENTRIES += [("session", one.name) for one in dataclasses.fields(manifest.Session)]
ENTRIES += [("segment", one.name) for one in dataclasses.fields(manifest.Segment)]


@pytest.mark.parametrize(("where", "key"), ENTRIES)
@pytest.mark.parametrize("value", [None, 1.5, GONE], ids=["none", "number", "gone"])
def test_an_unusable_entry_of_map_json_is_named(saved, where, key, value):
    edit_entry(saved, where, key, value)
    with pytest.raises(MapError, match=rf"damaged: map\.json: no usable '{key}'"):
        open_map(saved)


@pytest.mark.parametrize(
    ("where", "key", "value"),
    [
        ("map", "strands", [5]),
        ("map", "strands", [[5]]),
        ("map", "sessions", [None]),
        ("map", "retired", {"segments/0000000000-12345678": "yesterday"}),
        ("map", "retired", {"../elsewhere": 0.0}),
        ("map", "retired", {"segments/..": 0.0}),
        ("map", "retired", {"journal": 0.0}),
        ("session", "strand", 1),
        ("session", "strand", -1),
        ("session", "config", {"paint": 1}),
        ("session", "config", {"grid": {"gap_s": "long"}}),
        ("segment", "n_scans", 11),
        ("segment", "n_scans", -12),
    ],
)
def test_an_entry_that_cannot_be_is_told(saved, where, key, value):
    edit_entry(saved, where, key, value)
    with pytest.raises(MapError, match="is damaged"):
        ask_everything(saved)


def test_settings_that_a_session_does_not_tell_are_the_default_ones(saved):
    edit_entry(saved, "session", "config", {})
    assert open_map(saved).sessions[0].config == MapConfig().to_dict()


@pytest.mark.parametrize(
    "config",
    [
        {"grid": {"resolution_m": 0}},
        {"grid": {"resolution_m": "0.1"}},
        {"grid": {"colour": 1}},
        {"grid": 5},
        {"grid": None},
        {"paint": {}},
        {"sensing": {"max_range_m": 1e9}},
        {"grid": {"max_cells": 64}},
    ],
)
def test_settings_that_cannot_be_are_told_as_damage(saved, config):
    edit_manifest(saved, config=config)
    with pytest.raises(MapError, match="is damaged"):
        open_map(saved)


@pytest.mark.parametrize("data", ["../elsewhere", "/etc", "data-x/..", "..", ".", "", "segments/..", "segments"])
def test_a_segment_outside_the_map_is_refused(saved, tmp_path, data):
    # whole tables lie one folder up and in the map itself, where a map must not look for them
    for folder in (tmp_path, saved, tmp_path / "elsewhere"):
        shutil.copytree(data_of(saved), folder, dirs_exist_ok=True)
    edit_entry(saved, "segment", "name", data)
    with pytest.raises(MapError):
        open_map(saved)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_told(saved, name):
    file_of(saved, name).unlink()
    with pytest.raises(MapError, match=name.replace(".", r"\.")):
        ask_everything(saved)


@pytest.mark.parametrize("kept", [0, 0.3, 0.99])
@pytest.mark.parametrize("name", FILES)
def test_a_truncated_file_is_told(saved, name, kept):
    file = file_of(saved, name)
    content = file.read_bytes()
    file.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(MapError, match=name.replace(".", r"\.")):
        ask_everything(saved)


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_something_else_is_told(saved, name):
    file_of(saved, name).write_bytes(b"\x93NUMPY" * 500)
    with pytest.raises(MapError, match=name.replace(".", r"\.")):
        ask_everything(saved)


COLUMNS = {
    "scans": ["stamp_ns", "x", "y", "theta"],
    "tiles": ["row", "col"],
    "intervals": ["cell", "first_scan", "span", "prob"],
    "open": ["cell", "first_scan", "span", "prob"],
    "surfaces": ["cell", "hits", *tables.MOMENTS],
}


@pytest.mark.parametrize(("table", "column"), [(t, column) for t, names in COLUMNS.items() for column in names])
def test_a_missing_column_is_told(saved, table, column):
    edit_table(saved, table, lambda whole: whole.drop_columns([column]))
    with pytest.raises(MapError, match=rf"{table}\.parquet"):
        ask_everything(saved)


@pytest.mark.parametrize("column", COLUMNS["intervals"])
def test_a_column_missing_from_the_intervals_is_told_by_a_single_cells_history(saved, column):
    edit_table(saved, "intervals", lambda whole: whole.drop_columns([column]))
    with pytest.raises(MapError, match=r"intervals\.parquet"):
        open_map(saved).history(1.5, 0.05)


@pytest.mark.parametrize(("table", "column"), [(t, column) for t, names in COLUMNS.items() for column in names])
def test_a_column_of_another_kind_is_told(saved, table, column):
    def as_text(whole):
        place = whole.schema.get_field_index(column)
        return whole.set_column(place, column, pa.array(["text"] * len(whole)))

    edit_table(saved, table, as_text)
    with pytest.raises(MapError, match=rf"{table}\.parquet"):
        ask_everything(saved)


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("intervals", "cell", -1),
        ("intervals", "cell", 2**30),
        ("intervals", "first_scan", 12),
        ("intervals", "first_scan", -1),
        ("intervals", "span", 2**31 - 1),
        ("intervals", "span", -1),
        ("open", "cell", -1),
        ("open", "cell", 2**30),
        ("open", "first_scan", 12),
        ("open", "first_scan", -1),
        ("open", "span", 2**31 - 1),
        ("open", "span", -1),
        ("surfaces", "cell", 2**30),
        ("surfaces", "cell", -1),
        ("tiles", "row", 2**31 - 1),
        ("scans", "stamp_ns", -(2**62)),
    ],
)
def test_a_number_that_cannot_be_is_told(saved, table, column, value):
    def spoil(whole):
        place = whole.schema.get_field_index(column)
        numbers = whole.column(column).to_pylist()
        numbers[-1] = value
        return whole.set_column(place, column, pa.array(numbers, whole.schema.field(column).type))

    edit_table(saved, table, spoil)
    with pytest.raises(MapError, match="is damaged"):
        ask_everything(saved)


@pytest.mark.parametrize("table", ["intervals", "open"])
def test_intervals_out_of_order_are_told(saved, table):
    edit_table(saved, table, lambda whole: whole.take(list(range(len(whole)))[::-1]))
    with pytest.raises(MapError, match="not sorted by cell"):
        ask_everything(saved)


def test_tables_written_by_another_program_are_read(saved):
    # without the encodings, statistics and compression of ours
    wanted = list(open_map(saved).history(1.5, 0.05))
    for name in TABLES:
        file = data_of(saved) / f"{name}.parquet"
        pq.write_table(pq.read_table(file), file, write_statistics=False, compression="none")
    assert list(open_map(saved).history(1.5, 0.05)) == wanted
    assert len(ask_everything(saved)) > 0


@pytest.fixture(scope="module")
def sound_map():
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(dir=memory if memory.is_dir() else None))
    yield save_map(small_grid(), folder / "map")
    shutil.rmtree(folder)


@given(st.sampled_from(FILES), st.lists(st.tuples(st.floats(0, 0.999), st.integers(1, 255)), min_size=1, max_size=3))
@settings(
    max_examples=300,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_a_map_with_flipped_bits_is_read_or_told_as_damaged(sound_map, name, flips):
    file = file_of(sound_map, name)
    sound = file.read_bytes()
    spoiled = bytearray(sound)
    for place, mask in flips:
        spoiled[int(place * len(spoiled))] ^= mask
    file.write_bytes(spoiled)
    try:
        with suppress(MapError, TimeError):  # other stamps are no damage that shows, but the questions miss them
            ask_everything(sound_map)
            (session,) = open_map(sound_map).sessions
            open_map(sound_map, sessions=[session.id]).at("+1")
    finally:
        file.write_bytes(sound)


def test_two_processes_do_not_replace_one_map_at_once(saved):
    with only_writer(saved), pytest.raises(MapError, match="by another process"):
        save_map(small_grid(5), saved, force=True)
    assert open_map(saved).n_scans == 12
    save_map(small_grid(5), saved, force=True)
    assert open_map(saved).n_scans == 5


def test_a_map_that_was_replaced_since_it_was_opened_says_so(saved):
    opened = open_map(saved)
    save_map(small_grid(5), saved, force=True)
    with pytest.raises(MapError, match="open it again"):
        opened.history(1.5, 0.05)
