"""The viewer follows a map that grows: on disk, written by others, or in its own process."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace

import httpx
import numpy as np
import pytest

from png_pixels import pixels_of
from tempog import LiveMap, ObjectTracker, build_grid, find_objects, open_map, save_map
from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.errors import MapError
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.simulation import corridor, simulate
from tempog.store.saved_map import SavedMap
from tempog.times import NS_PER_S
from tempog.views.web import app, finding
from tempog.views.web import model as models
from tempog.views.web.blocks import SIDE, Where
from tempog.views.web.layers import palette
from tempog.views.web.model import Model
from tempog.views.web.serve import serve_in_thread
from tempog.views.web.sources import Choice, HistorySource, LiveSource, SavedSource
from waiting import wait_for


@pytest.fixture(scope="module")
def scans():
    return simulate(corridor(), duration_s=90.0).scans


@pytest.fixture(autouse=True)
def _look_often(monkeypatch):
    monkeypatch.setattr(app, "LOOK_EVERY_S", 0.05)


def assert_shows(model: Model, history, t: float) -> None:
    """Every tile of zoom 0 and 1 shows what the history says."""
    snapshot = history.at(np.datetime64(history.start_ns + round(t * NS_PER_S), "ns"), math.inf)
    extent, colours = snapshot.extent, np.array(palette("occupancy", "light"), dtype=np.uint8)
    codes = np.where(snapshot.value > OCCUPIED_ABOVE, 2, np.where(np.isnan(snapshot.value), 0, 1))
    rows, cols = (np.arange(n) + begin for n, begin in ((extent.n_rows, extent.row0), (extent.n_cols, extent.col0)))
    for z in (0, 1):
        for row in np.unique((rows >> z) // SIDE).tolist():
            for col in np.unique((cols >> z) // SIDE).tolist():
                expected = np.zeros((SIDE, SIDE), dtype=np.uint8)
                for r in np.flatnonzero((rows >> z) // SIDE == row):
                    inside = np.flatnonzero((cols >> z) // SIDE == col)
                    y, x = (int(rows[r]) >> z) % SIDE, (cols[inside] >> z) % SIDE
                    np.maximum.at(expected[SIDE - 1 - y], x, codes[r, inside].astype(np.uint8))
                picture = model.tile("occupancy", Where(z, row, col), "light", t, math.inf)
                np.testing.assert_array_equal(pixels_of(picture), colours[expected])


def events(lines: Iterator[str]) -> Iterator[dict]:
    """The data of events called map."""
    name = ""
    for line in lines:
        if line.startswith("event: "):
            name = line.removeprefix("event: ")
        if line.startswith("data: ") and name == "map":
            yield json.loads(line.removeprefix("data: "))


def test_a_map_that_others_write_is_followed(tmp_path, scans):
    path = tmp_path / "site.tempog"
    with LiveMap(path, flush_s=10.0) as live:
        live.integrate_many(scans[:300])
        live.flush()
        with serve_in_thread(SavedSource(path), port=0) as viewer:
            model = viewer.model
            assert_shows(model, open_map(path), 29.0)
            with httpx.Client(base_url=viewer.url, timeout=60).stream("GET", "/api/events") as answer:
                told = events(answer.iter_lines())
                first = next(told)
                assert first["version"] == model.version.name
                live.integrate_many(scans[300:])
                live.flush()
                latest = first
                while latest["t"] < 89.0:
                    latest = next(told)
                assert latest["version"] == model.version.name != first["version"]
            assert_shows(model, open_map(path), 29.0)
            assert_shows(model, open_map(path), 89.0)


def test_what_did_not_change_is_not_read_again(tmp_path, scans):
    path = tmp_path / "site.tempog"
    far = [
        type(scan)(
            0.0, (scan.x + 100, scan.y, scan.theta), scan.angles, scan.ranges, scan.max_range, stamp_ns=scan.stamp_ns
        )
        for scan in scans[300:400]
    ]
    with LiveMap(path, flush_s=10.0) as live:
        live.integrate_many(scans[:300])
        live.flush()
        model = Model(SavedSource(path))
        for where in model.blocks.where:
            model.blocks.cells(where)
        before = dict(model.blocks._held)
        live.integrate_many(far)
        live.flush()
        assert model.look()
        assert all(model.blocks._held[key] is held for key, held in before.items())
        assert len(model.blocks.where) > len(before)
        assert_shows(model, open_map(path), 35.0)


def test_a_map_whose_scans_are_numbered_anew_is_read_anew(tmp_path, scans):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans[200:400]), path)
    model = Model(SavedSource(path))
    assert_shows(model, open_map(path), 10.0)
    save_map(build_grid(scans[:500]), path, force=True)
    assert model.look()
    assert_shows(model, open_map(path), 10.0)
    assert not model.look()


def test_a_map_made_anew_of_the_same_scans_with_other_settings_is_read_anew(tmp_path, scans):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans[:300]), path)
    model = Model(SavedSource(path))
    assert_shows(model, open_map(path), 20.0)
    for config, n in ((MapConfig(SensingConfig(max_range_m=3.0)), 300), (MapConfig(grid=GridConfig(0.1)), 400)):
        save_map(build_grid(scans[:n], config), path, force=True)
        assert model.look()
        assert_shows(model, open_map(path), 20.0)


def test_a_map_that_changes_while_it_is_opened_is_opened_again(tmp_path, scans, monkeypatch):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans[:100]), path)
    source = SavedSource(path)
    save_map(build_grid(scans[:200]), path, force=True)

    def slowly(choice: Choice) -> SavedMap:
        monkeypatch.undo()
        opened = choice.open()
        save_map(build_grid(scans[:300]), path, force=True)
        return opened

    monkeypatch.setattr(Choice, "open", slowly)
    source.look()
    assert source.look()
    assert source.history().n_scans == 300


def test_no_request_waits_while_the_map_is_opened(tmp_path, scans, monkeypatch):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans[:100]), path)
    model = Model(SavedSource(path))
    ready = model.prepared().result(60)
    model.version = replace(model.version, name="another")
    opening, go_on = threading.Event(), threading.Event()

    def slowly() -> SavedMap:
        opening.set()
        go_on.wait(60)
        return open_map(path)

    monkeypatch.setattr(model.source, "apart", slowly)
    reader = threading.Thread(target=model.whole)
    reader.start()
    try:
        assert opening.wait(60)
        asker = threading.Thread(target=lambda: answers.append(model.prepared().result()), daemon=True)
        answers: list[object] = []
        asker.start()
        asker.join(10)
        assert answers == [ready]
    finally:
        go_on.set()
        reader.join()


def test_errors_that_nobody_foresaw_do_not_end_the_watching(tmp_path, scans, monkeypatch):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans[:100]), path)
    with serve_in_thread(SavedSource(path), port=0) as viewer:
        model, look = viewer.model, viewer.model.look
        failed = []

        def once() -> bool:
            if not failed:
                failed.append(True)
                raise ValueError("unforeseen")
            return look()

        monkeypatch.setattr(model, "look", once)
        wait_for(lambda: failed)
        save_map(build_grid(scans[:200]), path, force=True)
        wait_for(lambda: len(model.version.stamps_ns) == 200)


def test_a_map_that_goes_away_is_shown_on_and_comes_back(tmp_path, scans):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans[:200]), path)
    with serve_in_thread(SavedSource(path), port=0) as viewer, httpx.Client(base_url=viewer.url) as client:
        model = viewer.model
        wait_for(lambda: model.finder.state == "ready")
        version = client.get("/api/map").json()["version"]
        picture = client.get("/api/tiles/occupancy/0/0/0.png?t=10").content
        shutil.rmtree(path)
        wait_for(lambda: isinstance(viewer.model.source.trouble, MapError))
        assert client.get("/api/map").json()["version"] == version
        assert client.get("/api/tiles/occupancy/0/0/0.png?t=10&theme=dark").status_code == 200
        assert client.get("/api/tiles/occupancy/0/0/0.png?t=10").content == picture
        assert client.get("/api/diff?a=1&b=2").status_code in (200, 503)
        save_map(build_grid(scans[:400]), path)
        wait_for(lambda: client.get("/api/map").json()["version"] != version)
        assert_shows(model, open_map(path), 35.0)


def test_chosen_robots_are_shown_alone(tmp_path, scans):
    path = tmp_path / "site.tempog"
    for robot, part in (("r1", scans[:200]), ("r2", scans[200:400])):
        with LiveMap(path, robot=robot) as live:
            live.integrate_many(part)
    one, both = (Model(SavedSource(path, None, robots)) for robots in (["r2"], None))
    assert one.version.name != both.version.name
    assert (len(one.version.stamps_ns), len(both.version.stamps_ns)) == (200, 400)
    assert_shows(one, open_map(path, robots=["r2"]), 10.0)
    assert_shows(both, open_map(path), 30.0)


def test_robots_that_drove_at_one_time_are_shown_as_one(tmp_path, scans):
    path = tmp_path / "site.tempog"
    for robot, part in (("r1", scans[:400:2]), ("r2", scans[1:400:2])):
        with LiveMap(path, robot=robot) as live:
            live.integrate_many(part)
    assert open_map(path).n_strands == 2
    assert_shows(Model(SavedSource(path)), open_map(path), 20.0)


def test_objects_are_found_by_a_process_of_its_own(tmp_path, scans):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans), path)
    model = Model(SavedSource(path))
    assert model.findings() is None
    wait_for(lambda: model.finder.state in ("ready", "failed"))
    assert model.finder.state == "ready", model.finder.error
    expected = find_objects(open_map(path))
    found = model.findings().found
    assert [[place.id for place in one.configurations] for one in found.objects] == [
        [place.id for place in one.configurations] for one in expected.objects
    ]
    assert [one.timeline for one in found.objects] == [one.timeline for one in expected.objects]
    np.testing.assert_array_equal(found.walls, expected.walls)
    assert found.history.n_scans == len(scans)


def test_what_goes_wrong_while_objects_are_found_is_said(tmp_path, scans):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans[:100]), path)
    model = Model(SavedSource(path))
    shutil.rmtree(path)
    model.findings()
    wait_for(lambda: model.finder.state == "failed")
    assert str(path) in model.finder.error


def test_objects_are_looked_for_again_once_a_map_without_scans_has_some(tmp_path, scans, monkeypatch):
    monkeypatch.setattr(models, "LEAST_AGAIN_S", 0.0)
    monkeypatch.setattr(models, "SHARE_OF_TIME", math.inf)
    with LiveMap(tmp_path / "site.tempog", flush_s=10.0) as live:
        source = LiveSource(live)
        model = Model(source)
        assert model.findings() is None
        wait_for(lambda: model.finder.state == "failed")
        assert model.findings() is None
        assert model.finder.state == "failed"  # nothing is new
        for scan in scans:
            source.integrate(scan)
        live.flush()
        assert model.look()
        model.findings()
        wait_for(lambda: model.finder.state in ("ready", "failed"))
        assert model.finder.state == "ready", model.finder.error
        assert model.findings().found.objects


def test_an_error_that_nobody_foresaw_ends_the_search_and_not_the_waiting(tmp_path, scans, monkeypatch):
    grid = build_grid(scans[:50])
    model = Model(HistorySource(grid))
    monkeypatch.setattr(finding, "find_objects", lambda *given: [][0])
    model.findings()
    wait_for(lambda: model.finder.state == "failed")
    assert model.finder.error


def test_finding_objects_stops_with_the_viewer(tmp_path, scans, monkeypatch):
    path = tmp_path / "site.tempog"
    save_map(build_grid(scans[:100]), path)
    monkeypatch.setattr(sys, "executable", shutil.which("sleep"))
    started = []
    real = subprocess.Popen

    def endless(command, **more):
        started.append(real(["sleep", "1000"], **more))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", endless)
    model = Model(SavedSource(path))
    model.findings()
    wait_for(lambda: started)
    model.close()
    assert started[0].wait(20) != 0
    wait_for(lambda: model.finder.state == "failed")
    model.finder.start()
    assert len(started) == 1


def test_a_robot_s_own_process_shows_its_map_while_it_maps(tmp_path, scans):
    begin = build_grid(scans[:400])
    tracker = ObjectTracker(find_objects(begin))
    go_on, half_way = threading.Event(), threading.Event()
    with LiveMap(tmp_path / "site.tempog", flush_s=5.0) as live:
        source = LiveSource(live, tracker)

        def drive() -> None:
            for k, scan in enumerate(scans):
                source.integrate(scan)
                if k == 450:
                    half_way.set()
                    go_on.wait(60)

        robot = threading.Thread(target=drive)
        robot.start()
        try:
            with serve_in_thread(source, port=0) as viewer, httpx.Client(base_url=viewer.url, timeout=60) as client:
                entry = client.get("/api/map").json()
                assert entry["live"] is True
                half_way.wait(60)
                wait_for(lambda: client.get("/api/map").json()["n_scans"] == 451)
                now = client.get("/api/now").json()
                assert now["t"] == pytest.approx(45.0)
                assert set(now["objects"]) == {str(one.id) for one in tracker.found.objects}
                with source.lock:
                    so_far = build_grid(scans[:451])
                assert_shows(viewer.model, so_far, 45.0)
                assert_shows(viewer.model, so_far, 20.0)
                go_on.set()
                robot.join()
                wait_for(lambda: client.get("/api/map").json()["n_scans"] == len(scans))
                assert_shows(viewer.model, build_grid(scans), 89.9)
                assert_shows(viewer.model, build_grid(scans), 20.0)
                assert client.get("/api/objects").status_code in (200, 202)
                assert client.get("/api/tiles/static/0/0/0.png").status_code == 200
                assert client.get("/api/activity?bins=5").json()["edges_t"][-1] == pytest.approx(89.9)
        finally:
            go_on.set()
            robot.join()


def test_a_robot_does_not_wait_until_its_whole_map_is_read(tmp_path, scans, monkeypatch):
    with LiveMap(tmp_path / "site.tempog") as live:
        live.integrate_many(scans[:100])
        model = Model(LiveSource(live))
        monkeypatch.setattr(live, "runs", lambda: pytest.fail("all of it was read at once"))
        model._warm_up()
        model.close()
        assert_shows(model, build_grid(scans[:100]), 9.0)


def test_a_map_without_scans_is_shown_until_there_are_some(tmp_path, scans):
    with LiveMap(tmp_path / "site.tempog") as live:
        source = LiveSource(live)
        with serve_in_thread(source, port=0) as viewer, httpx.Client(base_url=viewer.url, timeout=60) as client:
            entry = client.get("/api/map").json()
            assert (entry["n_scans"], entry["duration_s"], entry["start_iso"]) == (0, 0.0, None)
            for path in ("/api/activity", "/api/cell?x=1&y=1", "/api/now", "/api/tiles/occupancy/0/0/0.png?t=1"):
                assert client.get(path).status_code == 200
            for path in ("/api/tiles/static/0/0/0.png", "/api/tiles/people/0/0/0.png", "/api/objects", "/api/map"):
                assert client.get(path).status_code in (200, 202)
            assert client.get("/api/snapshot?t=0").status_code in (200, 400, 503)
            for scan in scans[:50]:
                source.integrate(scan)
            wait_for(lambda: client.get("/api/map").json()["n_scans"] == 50)
            assert_shows(viewer.model, build_grid(scans[:50]), 4.9)
