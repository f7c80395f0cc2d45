"""What is logged for the Rerun viewer, read back."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tempog import ConfigError, MapError, Scan, TemporalGrid, TimeError, build_grid, find_objects
from tempog.errors import ExtraError, ViewerError
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.sensing.grid_spec import Extent
from tempog.simulation import corridor, simulate
from tempog.views import rerun_log
from tempog.views.rerun_log import FREE, OCCUPIED, UNKNOWN, log_to_rerun, thinned_states


@pytest.fixture(scope="module")
def grid():
    return build_grid(simulate(corridor()).scans)


def read(path):
    """Rows of each entity that has times: (ns, {component: value}), and the names of all entities."""
    chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed")
    reader = chunk.RrdReader(path)
    assert [len(reader.recordings()), len(reader.blueprints())] == [1, 1]
    rows, names = {}, set()
    for part in reader.stream():
        name = str(part.entity_path)
        names.add(name)
        if part.is_static:
            continue
        table = part.to_record_batch()
        times = table.column("time").cast("int64").to_pylist()
        components = [column for column in table.schema.names if ":" in column]
        for k, stamp_ns in enumerate(times):
            row = {column: table.column(column)[k].as_py() for column in components}
            rows.setdefault(name, []).append((stamp_ns, row))
    return {name: sorted(listed, key=lambda row: row[0]) for name, listed in rows.items()}, names


@pytest.fixture(scope="module")
def logged(grid, tmp_path_factory):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    path = tmp_path_factory.mktemp("rerun") / "corridor.rrd"
    log_to_rerun(grid, rrd=path, every_s=10.0)
    return read(path)


def test_the_map_over_time_is_what_the_history_says_with_north_up(grid, logged):
    snapshots = logged[0]["/world/map"]
    assert len(snapshots) == 21  # 192 s, and each differs from the one before
    for stamp_ns, row in snapshots:
        snapshot = grid.at(np.datetime64(stamp_ns, "ns"), np.inf)
        form = row["GridMap:format"][0]
        cells = np.frombuffer(bytes(row["GridMap:data"][0]), np.uint8).reshape(form["height"], form["width"])[::-1]
        known = ~np.isnan(snapshot.value)
        assert cells.shape == snapshot.extent.shape
        np.testing.assert_array_equal(cells == UNKNOWN, ~known)
        np.testing.assert_array_equal(cells == OCCUPIED, known & (snapshot.value > OCCUPIED_ABOVE))
        assert row["GridMap:translation"][0][:2] == pytest.approx(
            [snapshot.extent.bounds[0], snapshot.extent.bounds[2]]
        )
        assert row["GridMap:cell_size"] == pytest.approx([0.05])


def test_states_of_objects_are_those_of_their_timelines(grid, logged):
    (one,) = find_objects(grid).objects
    changes = [(stamp_ns, row["StateChange:state"][0]) for stamp_ns, row in logged[0]["/objects/object_1"]]
    stamps = np.array([stamp_ns for stamp_ns, _ in changes])
    for start, stop, place in one.timeline:
        now = changes[int(np.searchsorted(stamps, (start + stop) // 2, side="right")) - 1][1]
        assert now == ("unclear" if place is None else f"place {place}")
    for start, stop in one.gaps:
        assert changes[int(np.searchsorted(stamps, (start + stop) // 2, side="right")) - 1][1] == ""


def test_people_and_the_robot_are_where_they_were(grid, logged):
    measured = find_objects(grid).high_dynamics(every_s=0.0)
    people = dict(logged[0]["/world/people"])
    assert len(people) > 1000
    for one in measured[::200]:
        points = np.array(people[one.stamp_ns]["Points3D:positions"]).reshape(-1, 3)
        np.testing.assert_allclose(points[:, :2], one.points_map, atol=1e-5)
    robot = logged[0]["/world/robot"]
    assert [stamp_ns for stamp_ns, _ in robot] == grid.stamps_ns.tolist()
    np.testing.assert_allclose(
        [row["Transform3D:translation"][0][:2] for _, row in robot], grid.poses[:, :2], atol=1e-5
    )
    assert {"/static", "/world/way", "/world/places/1", "/world/objects/1"} <= logged[1]


def test_a_log_without_dates_is_told_in_seconds_from_its_start(tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    grid = TemporalGrid()
    for t in range(5):
        grid.integrate(Scan(100.0 + t, (0.0, 0.0, 0.0), [0.0, 0.1], [2.0 + t, 2.0]))
    log_to_rerun(grid.window("+1", "+3"), rrd=tmp_path / "log.rrd", name="five")
    robot = read(tmp_path / "log.rrd")[0]["/world/robot"]
    assert [stamp_ns for stamp_ns, _ in robot] == [10**9, 2 * 10**9, 3 * 10**9]


def test_nobody_is_shown_in_a_pause_without_scans(tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    scans = simulate(corridor(), duration_s=15.0).scans
    later = [Scan(s.t + 86_400, (s.x, s.y, s.theta), s.angles, s.ranges, s.max_range) for s in scans]
    log_to_rerun(build_grid([*scans, *later]), rrd=tmp_path / "days.rrd", every_s=3600.0)
    people = read(tmp_path / "days.rrd")[0]["/world/people"]
    (gap,) = (k for k in range(len(people)) if people[k][0] == scans[-1].stamp_ns + 1)
    assert np.array(people[gap][1]["Points3D:positions"]).size == 0
    assert people[gap + 1][0] == later[0].stamp_ns


def test_a_file_is_written_whole_and_replaced_only_when_told(grid, tmp_path, monkeypatch):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    path = tmp_path / "log.rrd"
    path.write_bytes(b"mine")
    with pytest.raises(MapError, match="exists already"):
        log_to_rerun(grid, rrd=path)
    found = find_objects(grid)
    monkeypatch.setattr(type(found), "high_dynamics", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        log_to_rerun(grid, found, rrd=path, force=True)
    assert path.read_bytes() == b"mine"
    assert list(tmp_path.iterdir()) == [path]
    monkeypatch.undo()
    log_to_rerun(grid, found, rrd=path, force=True, every_s=60.0)
    assert path.stat().st_size > 10_000


def test_a_viewer_of_this_machine_s_own_gets_the_whole_recording(grid, tmp_path, monkeypatch):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    assert rerun_log.VIEWER[rerun_log.VIEWER.index("--bind") + 1] == "127.0.0.1"
    copy = f"import shutil, sys; shutil.copy(sys.argv[-1], {str(tmp_path / 'got.rrd')!r})"
    monkeypatch.setattr(rerun_log, "VIEWER", (sys.executable, "-c", copy))
    log_to_rerun(grid, every_s=60.0)
    assert "/world/map" in read(tmp_path / "got.rrd")[1]
    fail = "import sys; sys.stderr.write('no screen\\n'); sys.exit(3)"
    monkeypatch.setattr(rerun_log, "VIEWER", (sys.executable, "-c", fail))
    with pytest.raises(ViewerError, match=r"ended with code 3: no screen; .* write a file"):
        log_to_rerun(grid, every_s=60.0)


def test_what_cannot_be_logged_says_why(grid, tmp_path, monkeypatch):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    with pytest.raises(ConfigError, match=r"every_s = 0\.0 cannot work"):
        log_to_rerun(grid, rrd=tmp_path / "log.rrd", every_s=0.0)
    with pytest.raises(TimeError, match="no scans"):
        log_to_rerun(TemporalGrid(), rrd=tmp_path / "log.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ExtraError, match=r"pip install 'tempog\[rerun\]'"):
        log_to_rerun(grid, rrd=tmp_path / "log.rrd")


def test_a_large_map_is_thinned_on_a_lattice_that_does_not_move():
    chosen = np.random.default_rng(2)
    value = chosen.choice(np.array([0.1, 0.9, np.nan], dtype=np.float32), p=[0.3, 0.05, 0.65], size=(50, 70))
    extent = Extent(-7, 11, 50, 70, 0.05)
    cells, where = thinned_states(value, extent, most_cells=24)
    assert where.resolution_m == pytest.approx(0.15)
    for (row, col), cell in np.ndenumerate(cells):
        rows = range((where.row0 + row) * 3 + 7, (where.row0 + row) * 3 + 10)
        cols = range((where.col0 + col) * 3 - 11, (where.col0 + col) * 3 - 8)
        block = [value[r, c] for r in rows for c in cols if 0 <= r < 50 and 0 <= c < 70]
        known = [float(one) for one in block if not np.isnan(one)]
        assert cell == (UNKNOWN if not known else OCCUPIED if max(known) > 0.5 else FREE)
