"""Maps of format 1 are read, answered from, and added to."""

from __future__ import annotations

import json
import shutil
import sys

import numpy as np
import pytest

from format_1 import save_format_1
from same_history import CONFIG, assert_same, debris, grid_of, room_scans
from tempog import LiveMap, TemporalGrid, open_map
from tempog.analysis.dynamics import map_dynamics
from tempog.cli.app import run
from tempog.errors import MapError
from tempog.scans.npz import write_npz
from tempog.store import committer
from tempog.store.manifest import read_manifest
from tempog.store.saved_map import save_map

SCANS = room_scans(60)
LATER = room_scans(60, start_s=500.0, seed=2)


@pytest.fixture
def old(quick_path):
    source = {"path": "a.log", "sha256": "ab", "format": "CARMEN", "n_scans": 60, "n_skipped": 0, "notes": []}
    return save_format_1(grid_of(SCANS), quick_path / "old", [source])


def test_a_map_of_format_1_answers_as_its_grid_did(old):
    opened = open_map(old)
    assert_same(opened, grid_of(SCANS))
    np.testing.assert_array_equal(map_dynamics(opened), map_dynamics(grid_of(SCANS)))
    (session,) = opened.sessions
    assert (session.id, session.n_scans, session.sources[0]["path"]) == ("1", 60, "a.log")
    assert_same(open_map(old, sessions=["1"]), grid_of(SCANS))


def test_one_cells_history_is_read_from_a_part_of_a_table_of_format_1(quick_path):
    grid = grid_of(SCANS)
    path = save_format_1(grid, quick_path / "old", rows_per_group=50)
    for k in range(0, 40, 7):
        x, y = 0.1 * k - 2.03, 1.98
        assert list(open_map(path).history(x, y)) == list(grid.history(x, y))


def test_a_map_of_format_1_without_scans_is_read_and_added_to(quick_path):
    path = save_format_1(TemporalGrid(CONFIG), quick_path / "old")
    assert open_map(path).n_scans == 0
    with LiveMap(path) as live:
        for scan in SCANS:
            live.integrate(scan)
    assert_same(open_map(path), grid_of(SCANS))


@pytest.mark.parametrize("flush_s", [0.3, 60.0])
@pytest.mark.parametrize("fanout", [2, 8])
def test_a_map_of_format_1_is_mapped_on(old, monkeypatch, flush_s, fanout):
    monkeypatch.setattr(committer, "FANOUT", fanout)
    monkeypatch.setattr(committer, "GRACE_S", 0.0)
    wanted = grid_of([*SCANS, *LATER])
    with LiveMap(old, flush_s=flush_s) as live:
        for scan in LATER:
            live.integrate(scan)
        assert_same(live, wanted)
    assert_same(open_map(old), wanted)
    assert debris(old) == []
    assert json.loads((old / "map.json").read_text())["format_version"] == 2


def test_a_crash_while_a_map_of_format_1_is_mapped_on_loses_nothing(old):
    live = LiveMap(old, flush_s=60)
    for scan in LATER:
        live.integrate(scan)
    live.abandon()
    assert json.loads((old / "map.json").read_text())["format_version"] == 1
    opened = open_map(old)
    assert len(opened.repaired) == 1
    assert_same(opened, grid_of([*SCANS, *LATER]))


def test_map_append_adds_to_a_map_of_format_1(old, quick_path, monkeypatch, capsys):
    log = quick_path / "later.npz"
    write_npz(log, LATER)
    monkeypatch.setattr(sys, "argv", ["tempog", "map", str(log), "--append", "-o", str(old), "--json"])
    with pytest.raises(SystemExit, match="0"):
        run()
    assert json.loads(capsys.readouterr().out)["n_scans_in_map"] == 120
    assert_same(open_map(old), grid_of([*SCANS, *LATER]))


def test_a_map_of_format_1_can_be_replaced_and_copied(old, quick_path):
    copy = save_map(open_map(old), quick_path / "copy")
    assert_same(open_map(copy), grid_of(SCANS))
    save_map(grid_of(LATER), old, force=True)
    assert_same(open_map(old), grid_of(LATER))
    assert debris(old) == []
    assert list(old.glob("data-*")) == []


@pytest.mark.parametrize("key", ["data", "config", "n_scans", "n_intervals", "n_cells", "sources", "stop_ns"])
@pytest.mark.parametrize("value", [None, 1.5])
def test_an_unusable_entry_of_its_map_json_is_named(old, key, value):
    document = json.loads((old / "map.json").read_text()) | {key: value}
    (old / "map.json").write_text(json.dumps(document))
    with pytest.raises(MapError, match=rf"damaged: map\.json: no usable '{key}'"):
        open_map(old)


@pytest.mark.parametrize("data", ["../elsewhere", "/etc", "data-x/..", "..", ".", "", "data-gone"])
def test_a_data_folder_elsewhere_is_refused(old, quick_path, data):
    for folder in (quick_path / "elsewhere", quick_path):
        shutil.copytree(old / "data-0123abcd", folder, dirs_exist_ok=True)
    document = json.loads((old / "map.json").read_text()) | {"data": data}
    (old / "map.json").write_text(json.dumps(document))
    with pytest.raises(MapError, match="is damaged"):
        open_map(old)


@pytest.mark.parametrize("table", ["scans", "tiles", "intervals", "surfaces"])
def test_a_missing_table_is_told(old, table):
    (old / "data-0123abcd" / f"{table}.parquet").unlink()
    with pytest.raises(MapError, match=rf"{table}\.parquet is missing"):
        open_map(old)


def test_reading_changes_nothing(old):
    before = {path: path.read_bytes() for path in old.rglob("*") if path.is_file()}
    assert_same(open_map(old), grid_of(SCANS))
    assert {path: path.read_bytes() for path in old.rglob("*") if path.is_file()} == before
    assert read_manifest(old).id == read_manifest(old).id
