"""The page while the map grows, and while the server is away."""

from __future__ import annotations

import time

import pytest

from tempog import LiveMap
from tempog.simulation import corridor, simulate

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

AWAY = "!document.getElementById('banner').hidden"


@pytest.fixture(scope="module")
def scans():
    return simulate(corridor(), duration_s=80.0).scans


@pytest.fixture
def serve():
    """Serves maps; goes before `open_page`, whose pages are closed before the servers are."""
    from tempog.views.web.serve import serve_in_thread

    serving = []

    def start(source, port=0):
        serving.append(serve_in_thread(source, port=port))
        return serving[-1]

    yield start
    for viewer in serving:
        viewer.stop()


def test_the_page_follows_a_map_that_grows_on_disk(serve, open_page, scans, tmp_path):
    from tempog.views.web.sources import SavedSource

    path = tmp_path / "growing.tempog"
    with LiveMap(path) as live:
        live.integrate_many(scans[:400])
    viewer = serve(SavedSource(path))
    page = open_page(viewer.url).open("layers=occupancy:1")
    assert page.now()["t"] == pytest.approx(39.9)
    before = page.text("#map-facts")
    with LiveMap(path) as live:
        live.integrate_many(scans[400:800])
    page.until("tempog.time.axis.stop > 79 && tempog.state.now.t > 79")  # whoever looks at the end stays there
    page.settle()
    assert page.text("#map-facts") != before


def test_one_may_look_back_while_it_grows(serve, open_page, scans, tmp_path):
    from tempog.views.web.sources import SavedSource

    path = tmp_path / "growing.tempog"
    with LiveMap(path) as live:
        live.integrate_many(scans[:400])
    viewer = serve(SavedSource(path))
    page = open_page(viewer.url).open("layers=occupancy:1")
    page.slide(20.0)
    t = page.now()["t"]
    with LiveMap(path) as live:
        live.integrate_many(scans[400:800])
    page.until("tempog.time.axis.stop > 79")
    page.settle()
    assert page.now()["t"] == t
    assert page.tab.evaluate("Number(document.getElementById('slider').value)") == pytest.approx(t / 79.9, abs=0.01)
    page.tab.press("#slider", "End")
    assert page.now()["t"] == pytest.approx(79.9)


def test_a_running_map_is_followed_scan_by_scan(serve, open_page, scans, tmp_path):
    from tempog.views.web.sources import LiveSource

    with LiveMap(tmp_path / "running.tempog") as live:
        source = LiveSource(live)
        for scan in scans[:200]:
            source.integrate(scan)
        viewer = serve(source)
        page = open_page(viewer.url).open("layers=occupancy:1,people-now:1", ready=False)
        page.until("document.body.dataset.ready !== undefined && !document.getElementById('live').hidden")
        assert page.tab.get_attribute("#live", "aria-pressed") == "true"
        assert "somebody, now" in page.text("#legend-entries")
        for scan in scans[200:300]:
            source.integrate(scan)
        page.until("Math.abs(tempog.state.now.t - 29.9) < 0.01")
        page.slide(10.0)
        assert page.tab.get_attribute("#live", "aria-pressed") == "false"
        assert "somebody, now" not in page.text("#legend-entries")
        t = page.now()["t"]
        for scan in scans[300:400]:
            source.integrate(scan)
        page.until("tempog.time.axis.stop > 39.8")
        assert page.now()["t"] == t
        page.tab.click("#live")
        page.until("Math.abs(tempog.state.now.t - 39.9) < 0.01")


def test_the_server_goes_and_comes_back(serve, open_page, corridor_map):
    from tempog.views.web.sources import SavedSource

    viewer = serve(SavedSource(corridor_map))
    page = open_page(viewer.url).open("layers=occupancy:1&t=50")
    page.expects_failures = True
    viewer.stop()
    page.until(AWAY)
    assert "does not answer" in page.text("#banner")
    box = page.tab.locator("#slider").bounding_box()
    page.tab.mouse.click(box["x"] + box["width"] / 4, box["y"] + 10)  # asked in vain
    t = page.now()["t"]
    assert t != 50
    again(serve, corridor_map, viewer.port)
    page.until(f"!({AWAY})")
    page.settle()  # what was asked for while it was away is drawn
    assert page.tab.evaluate("tempog.map.pictures.frame.t") == t
    page.slide(120.0)


def again(serve, path, port):
    """A server on a port that may be in use for a moment yet."""
    from tempog.errors import ConfigError
    from tempog.views.web.sources import SavedSource

    end = time.monotonic() + 20
    while True:
        try:
            return serve(SavedSource(path), port)
        except ConfigError:
            if time.monotonic() > end:
                raise
