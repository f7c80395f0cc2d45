"""What the viewer's server answers: the same as the library, by the schemas that it publishes."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import httpx
import jsonschema
import numpy as np
import pytest

from png_pixels import pixels_of
from tempog import build_grid, find_objects, map_diff, map_dynamics, static_map
from tempog.analysis.objects import MovingObject, ObjectPeriod
from tempog.analysis.static import CellClass
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.simulation import corridor, simulate
from tempog.times import NS_PER_S
from tempog.views.web import app
from tempog.views.web.blocks import SIDE, Where
from tempog.views.web.finding import findings_of
from tempog.views.web.layers import LAYERS, palette
from tempog.views.web.model import Model
from tempog.views.web.objects_json import Hours, objects_entry
from tempog.views.web.prepared import FAINT_DYNAMICS, FULL_DYNAMICS, activity
from tempog.views.web.serve import Viewer, serve_in_thread
from tempog.views.web.sources import HistorySource
from waiting import wait_for

Ask = Callable[..., httpx.Response]


@pytest.fixture(scope="module")
def grid():
    return build_grid(simulate(corridor(), duration_s=120.0).scans)


@pytest.fixture(scope="module")
def found(grid):
    return find_objects(grid)


@pytest.fixture(scope="module")
def viewer(grid, found) -> Iterator[Viewer]:
    with serve_in_thread(HistorySource(grid, "corridor", found), port=0) as viewer:
        finder = viewer.model.finder
        wait_for(lambda: finder.state in ("ready", "failed"))
        assert finder.state == "ready", finder.error
        yield viewer


@pytest.fixture(scope="module")
def model(viewer) -> Model:
    return viewer.model


@pytest.fixture(scope="module")
def client(viewer) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=viewer.url) as client:
        yield client


@pytest.fixture
def ask(client) -> Ask:
    def ask(path: str, status: int = 200, **parameters: Any) -> httpx.Response:
        answer = client.get(path, params=parameters)
        assert answer.status_code == status, answer.text
        return answer

    return ask


def whole(ask: Ask, grid, layer: str, **parameters: Any) -> np.ndarray:
    """All tiles of zoom 0 as one picture over the grid's extent, row 0 in the south."""
    extent = grid.extent
    picture = np.zeros((extent.n_rows, extent.n_cols, 4), dtype=np.uint8)
    for row in range(extent.row0 // SIDE, (extent.row0 + extent.n_rows - 1) // SIDE + 1):
        for col in range(extent.col0 // SIDE, (extent.col0 + extent.n_cols - 1) // SIDE + 1):
            tile = pixels_of(ask(f"/api/tiles/{layer}/0/{col}/{row}.png", **parameters).content)[::-1]
            for y in range(SIDE):
                at = row * SIDE + y - extent.row0
                if 0 <= at < extent.n_rows:
                    begin, end = max(col * SIDE, extent.col0), min((col + 1) * SIDE, extent.col0 + extent.n_cols)
                    picture[at, begin - extent.col0 : end - extent.col0] = tile[
                        y, begin - col * SIDE : end - col * SIDE
                    ]
    return picture


def coloured(codes: np.ndarray, layer: str, theme: str = "light") -> np.ndarray:
    return np.array(palette(layer, theme), dtype=np.uint8)[codes]


def test_the_published_document_names_every_route_and_no_other(model):
    named = set(app.openapi_document()["paths"])
    served = {route.path.replace(":path", "") for route in app.Site(model).routes()}
    assert named == served


def test_answers_follow_the_published_schemas(ask):
    document = ask("/openapi.json").json()
    assert document["openapi"] == "3.1.0"
    asked = {
        "/api/map": {},
        "/api/activity": {"bins": 7},
        "/api/objects": {},
        "/api/cell": {"x": 6.98, "y": 2.53},
        "/api/diff": {"a": 66, "b": 100},
        "/api/now": {},
    }
    for path, parameters in asked.items():
        schema = document["paths"][path]["get"]["responses"]["200"]["content"]["application/json"]["schema"]
        checker = jsonschema.Draft202012Validator({**schema, "components": document["components"]})
        checker.validate(ask(path, **parameters).json())
        known = {parameter["name"] for parameter in document["paths"][path]["get"]["parameters"]}
        assert set(parameters) <= known


def test_every_parameter_that_is_named_is_taken_and_others_are_refused(ask, client):
    for path, entry in ask("/openapi.json").json()["paths"].items():
        if not path.startswith("/api/") or path == "/api/events":
            continue
        address = path.format(layer="occupancy", z=0, col=0, row=0)
        examples = {"t": 10, "hold": "inf", "theme": "dark", "v": "x", "bins": 3, "x": 1, "y": 1, "a": 1, "b": 2}
        examples |= {"format": "npz", "cols": 2, "rows": 2}
        names = [parameter["name"] for parameter in entry["get"]["parameters"] if parameter["in"] == "query"]
        assert client.get(address, params={name: examples[name] for name in names}).status_code == 200
        refused = client.get(address, params={"nonsense": 1})
        assert refused.status_code == 400
        assert "nonsense" in refused.json()["error"]


def test_the_map_is_described(ask, grid):
    entry = ask("/api/map").json()
    assert entry["name"] == "corridor"
    assert entry["start_ns"] == str(grid.start_ns)
    assert entry["start_iso"] == "2025-06-15T15:06:40Z"
    assert (entry["n_scans"], entry["n_cells"], entry["n_intervals"]) == (
        grid.n_scans,
        grid.n_cells,
        grid.n_intervals,
    )
    assert tuple(entry["bounds"]) == grid.extent.bounds
    assert entry["duration_s"] == pytest.approx(grid.duration_s)
    assert entry["zooms"] == [0, 1]
    assert [layer["id"] for layer in entry["layers"]] == list(LAYERS)
    assert "displaced between passes" in entry["poses"]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize(("t", "hold"), [(0.0, "inf"), (33.33, "inf"), (66.0, "2.5"), (100.0, "0"), (500.0, "inf")])
def test_occupancy_tiles_are_the_map_at_the_moment(ask, grid, t, hold, theme):
    snapshot = grid.at(np.datetime64(grid.start_ns + round(t * NS_PER_S), "ns"), float(hold))
    codes = np.zeros(snapshot.value.shape, dtype=np.uint8)
    codes[snapshot.value <= OCCUPIED_ABOVE] = 1
    codes[snapshot.value > OCCUPIED_ABOVE] = 2
    picture = whole(ask, grid, "occupancy", t=t, hold=hold, theme=theme)
    np.testing.assert_array_equal(picture, coloured(codes, "occupancy", theme))


def test_tiles_of_the_static_map(ask, grid):
    codes = {CellClass.UNEXPLORED: 0, CellClass.FREE: 1, CellClass.CHANGING: 2, CellClass.STATIC: 3}
    classes = static_map(grid)
    expected = np.zeros(classes.shape, dtype=np.uint8)
    for cell_class, code in codes.items():
        expected[classes == cell_class] = code
    np.testing.assert_array_equal(whole(ask, grid, "static"), coloured(expected, "static"))


def test_tiles_of_dynamics_get_stronger_with_them(ask, grid):
    opacity = whole(ask, grid, "dynamics")[..., 3]
    dynamics = np.nan_to_num(map_dynamics(grid))
    assert not opacity[dynamics <= FAINT_DYNAMICS].any()
    assert (opacity[dynamics >= FULL_DYNAMICS] == 255).all()
    drawn = np.argsort(dynamics, axis=None)
    assert (np.diff(opacity.ravel()[drawn].astype(int)) >= 0).all()
    assert len(np.unique(opacity)) > 5


def test_tiles_of_what_is_on_the_move_are_fig_11(ask, grid, found):
    everything = found.high_dynamics()
    crowded = sorted(everything, key=lambda moving: -len(moving.cells))[:40:8]
    for moving in [everything[0], *crowded, everything[-1]]:
        expected = np.zeros(grid.extent.shape, dtype=np.uint8)
        expected[moving.cells[:, 0] - grid.extent.row0, moving.cells[:, 1] - grid.extent.col0] = 1
        t = (moving.stamp_ns - grid.start_ns) / NS_PER_S
        np.testing.assert_array_equal(whole(ask, grid, "people-now", t=t), coloured(expected, "people-now"))
    assert all(len(moving.cells) > 3 for moving in crowded)


def test_tiles_of_where_people_walk_show_every_cell_that_anybody_came_to(ask, grid, found):
    ever = np.zeros(grid.extent.shape, dtype=bool)
    for moving in found.high_dynamics():
        ever[moving.cells[:, 0] - grid.extent.row0, moving.cells[:, 1] - grid.extent.col0] = True
    np.testing.assert_array_equal(whole(ask, grid, "people")[..., 3] > 0, ever)


def test_tiles_that_will_not_change_may_be_kept_and_others_may_not(ask):
    version = ask("/api/map").json()["version"]
    for layer in LAYERS:
        path = f"/api/tiles/{layer}/0/0/0.png"
        moment = {"t": 50} if LAYERS[layer].kind == "moment" else {}
        assert "immutable" in ask(path, v=version, **moment).headers["cache-control"]
        assert ask(path, v="another", **moment).headers["cache-control"] == "no-store"
        assert ask(path, **moment).headers["cache-control"] == "no-store"


def test_tiles_beyond_the_map_are_empty(ask):
    for layer in LAYERS:
        assert not pixels_of(ask(f"/api/tiles/{layer}/1/1000000/-77.png").content).any()


def test_activity_counts_every_change_once(ask, grid, model):
    for bins in (1, 7, 400):
        answer = ask("/api/activity", bins=bins).json()
        assert sum(answer["changes"]) == model.prepared().result().changes.sum() > 0
        assert len(answer["edges_t"]) == len(answer["changes"]) + 1 == len(answer["observed"]) + 1 == bins + 1
        assert answer["edges_t"][-1] == pytest.approx(grid.duration_s)


def test_a_long_pause_is_one_bin_of_activity_without_scans():
    stamps = np.array([0, 10, 20, 3600, 3610], dtype=np.int64) * NS_PER_S
    answer = activity(stamps, np.array([0, 5, 2, 7, 0]), 6)
    pause = answer["edges_t"].index(20.0)
    assert answer["edges_t"][pause + 1] == 3600.0
    assert answer["observed"][pause] is False
    assert answer["changes"][pause] == 0
    assert sum(answer["changes"]) == 14


def test_a_single_scan_has_activity():
    answer = activity(np.array([5], dtype=np.int64), np.array([0]), 400)
    assert len(answer["edges_t"]) == 2
    assert answer["observed"] == [True]


def test_objects_are_those_that_were_found(ask, grid, found):
    answer = ask("/api/objects").json()
    (door,) = answer["objects"]
    (one,) = found.objects
    assert {state["place"]: state["cells"] for state in door["states"]} == {
        place.id: place.cells.tolist() for place in one.configurations
    }
    assert door["n_moves"] == one.n_moves == len(door["stays"]) - 1
    assert [place for _, _, place in door["timeline"]] == [place for _, _, place in one.timeline]
    assert door["timeline"][0][0] == pytest.approx((one.timeline[0].start_ns - grid.start_ns) / NS_PER_S)
    assert door["last"]["place"] == one.last_stay.configuration
    assert door["shares"] == {
        "none" if place is None else str(place): pytest.approx(share) for place, share in one.shares.items()
    }
    assert [place["id"] for place in answer["places"]] == [place.id for place in found.unassociated]
    # All of it lies within one hour of one Sunday.
    for place, share in door["shares"].items():
        if place != "none":
            assert door["by_hour"][place][15] == pytest.approx(share, abs=1e-5)
            assert door["by_weekday"][place][6] == pytest.approx(share, abs=1e-5)
            assert sum(value is not None for value in door["by_hour"][place]) == 1


@pytest.mark.parametrize("zone", [UTC, timezone(timedelta(hours=5, minutes=45))])
def test_hours_are_added_up_as_by_looking_at_the_clock_every_second(zone):
    begin = 1_750_000_000  # some Sunday
    periods = [
        ObjectPeriod((begin + since) * NS_PER_S, (begin + until) * NS_PER_S, 1)
        for since, until in [(0, 100), (700, 12_345), (12_345, 12_346), (90_000, 101_000), (200_000, 200_000)]
    ]
    hours = Hours(begin * NS_PER_S, (begin + 200_000) * NS_PER_S, zone)
    moments = [
        datetime.fromtimestamp(second, zone)
        for since, until, _ in periods
        for second in range(since // NS_PER_S, until // NS_PER_S)
    ]
    assert hours.lasted_s(periods, 24).tolist() == [sum(m.hour == hour for m in moments) for hour in range(24)]
    assert hours.lasted_s(periods, 7).tolist() == [sum(m.weekday() == day for m in moments) for day in range(7)]


def test_a_clock_that_counts_from_power_on_has_no_hours():
    scans = simulate(corridor(), duration_s=60.0).scans
    moved = [
        type(scan)(
            scan.t - scans[0].t, (scan.x, scan.y, scan.theta), scan.angles, scan.ranges, max_range=scan.max_range
        )
        for scan in scans
    ]
    grid = build_grid(moved)
    answer = objects_entry(find_objects(grid), "v", 0, int(grid.stamps_ns[-1]))
    assert answer["dated"] is False
    assert answer["tz"] is None
    assert answer["objects"]
    assert all(one["by_hour"] is None and one["by_weekday"] is None for one in answer["objects"])


def test_an_object_that_was_never_seen_in_an_hour_has_no_share_there():
    hours = Hours(1_750_000_000 * NS_PER_S, 1_750_086_400 * NS_PER_S, UTC)
    assert hours.shares(MovingObject(1, (), (), 0.0, 0.0, 0.0, None), 24) == {}


def test_a_cell_has_all_its_states(ask, grid):
    states = grid.history(6.98, 2.53)
    answer = ask("/api/cell", x=6.98, y=2.53).json()
    assert (answer["row"], answer["col"]) == grid.tiles.spec.cell_of(6.98, 2.53)
    assert answer["n_total"] == answer["n_shown"] == len(states) > 3
    expected = np.stack([(states.start_ns - grid.start_ns) / 1e9, (states.stop_ns - grid.start_ns) / 1e9], axis=-1)
    np.testing.assert_allclose(np.array(answer["intervals"])[:, :2], expected)
    np.testing.assert_allclose(np.array(answer["intervals"])[:, 2], states.value, atol=1e-6)
    np.testing.assert_allclose(answer["gaps"], (states.gaps - grid.start_ns) / 1e9)


def test_of_very_many_states_the_latest_are_sent(ask, grid, monkeypatch):
    monkeypatch.setattr(app.answers, "MOST_INTERVALS", 3)
    states = grid.history(6.98, 2.53)
    answer = ask("/api/cell", x=6.98, y=2.53).json()
    assert (answer["n_total"], answer["n_shown"], answer["truncated"]) == (len(states), 3, True)
    assert answer["intervals"][-1][1] == pytest.approx((states[-1].stop_ns - grid.start_ns) / 1e9)


def test_an_unseen_cell_has_no_states(ask):
    for place in (-500.0, 1e12):
        answer = ask("/api/cell", x=place, y=0).json()
        assert (answer["intervals"], answer["gaps"], answer["n_total"]) == ([], [], 0)


def test_differences_are_those_of_the_library_in_either_order(ask, grid, found):
    expected = map_diff(grid, "+20", "+100", found=found)
    answer = ask("/api/diff", a=20, b=100).json()
    assert [(move["object"], move["from"], move["to"]) for move in answer["moved"]] == [
        (move.one.id, move.before.configuration, move.after.configuration) for move in expected.moved
    ]
    for kind, patches in (("appeared", expected.appeared), ("vanished", expected.vanished)):
        assert [patch["cells"] for patch in answer[kind]] == [patch.cells.tolist() for patch in patches]
    assert answer["compared_m2"] == pytest.approx(expected.areas.compared_m2, abs=1e-3)
    assert ask("/api/diff", a=100, b=20).json() == answer


def test_differences_of_moments_without_scans_are_refused(ask):
    assert "scans run from" in ask("/api/diff", 400, a=20, b=1000).json()["error"]


def test_snapshots_are_the_map_at_the_moment(ask, grid):
    snapshot = grid.at("+50", math.inf)
    arrays = np.load(io.BytesIO(ask("/api/snapshot", t=50, format="npz").content))
    np.testing.assert_array_equal(arrays["value"], snapshot.value)
    np.testing.assert_array_equal(arrays["age_s"], snapshot.age_s)
    assert (arrays["row0"], arrays["col0"]) == (grid.extent.row0, grid.extent.col0)
    assert arrays["stamp_ns"] == grid.start_ns + 50 * NS_PER_S
    picture = pixels_of(ask("/api/snapshot", t=50).content)[::-1]
    np.testing.assert_array_equal(picture, whole(ask, grid, "occupancy", t=50))


def test_now_is_the_end_of_the_history(ask, grid, found):
    answer = ask("/api/now").json()
    assert answer["t"] == pytest.approx(grid.duration_s)
    assert answer["objects"] == {"1": found.objects[0].last_stay.configuration}
    assert answer["people"] == app.answers.people(found.high_dynamic().points_map)


def test_files_of_the_page_are_served_by_name_only(grid, monkeypatch):
    files = {"index.html": (b"<p>", "text/html"), "panel/cell.js": (b"export", "text/javascript")}
    monkeypatch.setattr(app, "page_files", lambda: files)
    with serve_in_thread(HistorySource(grid), port=0) as viewer, httpx.Client(base_url=viewer.url) as client:
        assert client.get("/").text == "<p>"
        answer = client.get("/page/panel/cell.js")
        assert answer.headers["content-type"].startswith("text/javascript")
        for name in ("", "panel", "panel/", "../app.py", "__init__.py", "nothing.js"):
            assert client.get(f"/page/{name}").status_code == 404


def test_nobody_waits_for_objects(grid):
    with serve_in_thread(HistorySource(grid), port=0) as viewer, httpx.Client(base_url=viewer.url) as client:
        model = viewer.model
        wait_for(lambda: model.finder.state == "ready")
        model.finder.state, model.finder.findings = "working", None
        for path in ("/api/objects", "/api/diff?a=1&b=2"):
            answer = client.get(path)
            assert (answer.status_code, answer.json()["state"]) == (202, "working")
        for layer in ("people", "people-now"):
            answer = client.get(f"/api/tiles/{layer}/0/0/0.png?v={model.version.name}&t=1")
            assert answer.headers["cache-control"] == "no-store"
            assert not pixels_of(answer.content).any()
        model.finder.state, model.finder.error = "failed", "no memory"
        assert client.get("/api/objects").json() == {"state": "failed", "error": "no memory"}


def test_what_is_held_stays_within_its_bounds(grid, found):
    budget = 600_000  # a block has 262 kB of offsets alone
    model = Model(HistorySource(grid, "corridor", found), block_bytes=budget, picture_bytes=20_000)
    everywhere = {Where(z, w.row >> z, w.col >> z) for w in model.blocks.where for z in (0, 1)}
    for k in range(60):
        for where in everywhere:
            for layer in ("occupancy", "age"):
                model.tile(layer, where, "light", float(k), math.inf)
        largest = max(held.nbytes for held in model.blocks._held.values())
        assert model.blocks.held_bytes <= max(budget, largest)
        assert model.blocks.held_bytes == sum(held.nbytes for held in model.blocks._held.values())
        assert model.pictures.held_bytes <= 20_000


def test_findings_are_json_and_survive_a_map_that_grew(grid, found):
    early = build_grid(simulate(corridor(), duration_s=60.0).scans)
    findings = findings_of(early, find_objects(early), "v")
    json.dumps(objects_entry(findings.found, "v", early.start_ns, int(early.stamps_ns[-1])), allow_nan=False)
    model = Model(HistorySource(grid, "corridor"))
    answer = app.answers.diff_entry(model, findings, 20.0, 100.0)
    assert {move["object"] for move in answer["moved"]} <= {one.id for one in findings.found.objects}
