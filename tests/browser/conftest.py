"""The viewer's page in a real browser: Debian's chromium, driven by Playwright."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from chromium import chromium as chromium_browser
from tempog import TemporalGrid, build_grid, save_map
from tempog.simulation import corridor, simulate

WAIT_S = 60.0


class Page:
    """A page of the viewer, with what went wrong in it.

    Attributes
    ----------
    tab : playwright.sync_api.Page
    errors : list of str
        What the page complained about, and addresses on other machines that it asked for.
    """

    def __init__(self, tab: Any, home: str) -> None:
        self.tab, self.home = tab, home
        self.errors: list[str] = []
        self.expects_failures = False
        tab.on("console", self._said)
        tab.on("pageerror", lambda error: self.errors.append(str(error)))
        tab.on("request", self._asked)
        tab.on("response", self._answered)

    def open(self, address: str = "", ready: bool = True) -> Page:
        """Show the page, at an address behind ``#``; returns once it is drawn, and the objects are there."""
        self.tab.goto("about:blank")  # so that an address that differs behind # only is loaded, too
        self.tab.goto(f"{self.home}{'#' + address if address else ''}")
        if ready:
            self.until("document.body.dataset.ready !== undefined && tempog.objects.status === 'ready'")
            self.settle()
        return self

    def until(self, condition: str, wait_s: float = WAIT_S) -> None:
        """Wait until something is true in the page."""
        self.tab.evaluate(
            f"""() => new Promise((done, fail) => {{
                const look = () => {{
                    let holds = false;
                    try {{ holds = {condition}; }} catch {{ holds = false; }}
                    if (holds) done();
                    else if (performance.now() > {wait_s * 1000} + began) fail(new Error("waited in vain"));
                    else setTimeout(look, 10);
                }};
                const began = performance.now();
                look();
            }})"""
        )

    def settle(self) -> None:
        """Wait until what is asked for is drawn."""
        self.until("tempog.map.settled")

    def now(self) -> dict[str, Any]:
        """What the page shows, as its address has it."""
        return dict(self.tab.evaluate("tempog.state.now"))

    def point(self, x: float, y: float) -> dict[str, float]:
        """The pixel of the map's canvas at a point in metres."""
        px, py = self.tab.evaluate(
            f"""() => {{ const v = tempog.map.view;
                return [v.width / 2 + ({x} - v.x) * v.scale, v.height / 2 - ({y} - v.y) * v.scale]; }}"""
        )
        return {"x": px, "y": py}

    def colour(self, x: float, y: float) -> tuple[int, int, int]:
        """What is drawn at a point in metres."""
        at = self.point(x, y)
        red, green, blue, _ = self.tab.evaluate(
            f"""() => {{ const c = document.getElementById("map"), r = c.width / c.clientWidth;
                const pen = new OffscreenCanvas(1, 1).getContext("2d", {{ willReadFrequently: true }});
                pen.drawImage(c, -Math.floor({at["x"]} * r), -Math.floor({at["y"]} * r));
                return [...pen.getImageData(0, 0, 1, 1).data]; }}"""
        )
        return red, green, blue

    def click(self, x: float, y: float, **how: Any) -> None:
        """Click a point of the map in metres."""
        self.tab.locator("#map").click(position=self.point(x, y), **how)

    def slide(self, t: float) -> None:
        """Click the slider where a moment is; wait for the picture."""
        box = self.tab.locator("#slider").bounding_box()
        place = self.tab.evaluate(f"tempog.time.axis.place({t})")
        self.tab.mouse.click(box["x"] + 11 + place * (box["width"] - 22), box["y"] + box["height"] / 2)
        self.settle()

    def text(self, selector: str) -> str:
        """What an element says."""
        return str(self.tab.locator(selector).inner_text())

    def _said(self, message: Any) -> None:
        if message.type in ("error", "warning") and not (self.expects_failures and "Failed to load" in message.text):
            self.errors.append(message.text)

    def _asked(self, request: Any) -> None:
        if not request.url.startswith((self.home, "about:", "blob:")):
            self.errors.append(f"asked for {request.url}")

    def _answered(self, response: Any) -> None:
        if response.status >= 400 and not self.expects_failures:
            self.errors.append(f"{response.status} for {response.url}")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """The browser. One for each module: Playwright's event loop runs as long, and others may want their own."""
    with chromium_browser("--js-flags=--expose-gc") as browser:
        yield browser


@pytest.fixture(scope="session")
def corridor_grid() -> TemporalGrid:
    """The demo's corridor: one door, one person."""
    return build_grid(simulate(corridor()).scans)


@pytest.fixture(scope="session")
def corridor_map(corridor_grid: TemporalGrid, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_map(corridor_grid, tmp_path_factory.mktemp("maps") / "corridor.tempog")


@pytest.fixture(scope="module")
def viewer(corridor_map: Path) -> Iterator[Any]:
    """A server of the corridor's map."""
    pytest.importorskip("starlette")
    from tempog.views.web.serve import serve_in_thread
    from tempog.views.web.sources import SavedSource

    with serve_in_thread(SavedSource(corridor_map), port=0) as serving:
        yield serving


@pytest.fixture
def open_page(chromium: Any) -> Iterator[Any]:
    """Makes pages; at the end, none may have complained, or asked another machine for anything."""
    pages: list[Page] = []

    def make(home: str, **context: Any) -> Page:
        context = {"viewport": {"width": 1366, "height": 768}, **context}
        pages.append(Page(chromium.new_context(**context).new_page(), home))
        return pages[-1]

    yield make
    for page in pages:
        page.tab.context.close()
    for page in pages:
        assert page.errors == []


@pytest.fixture
def page(open_page: Any, viewer: Any) -> Page:
    """The corridor's page, drawn."""
    return open_page(viewer.url).open()
