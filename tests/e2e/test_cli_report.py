"""``tempog report``, and its page in a browser."""

from __future__ import annotations

import pytest

from chromium import chromium
from tempog import build_grid, save_map
from tempog.simulation import corridor, simulate

NAME = "<img src=x onerror=alert(1)> & more"


@pytest.fixture(scope="module")
def map_path(tmp_path_factory):
    grid = build_grid(simulate(corridor()).scans)
    return save_map(grid, tmp_path_factory.mktemp("maps") / "corridor.tempog")


def test_a_report_is_written_whole_and_nothing_is_replaced_unasked(tempog, map_path, tmp_path):
    page = tmp_path / "report.html"
    done = tempog("report", map_path, "-o", page)
    assert done.code == 0
    assert done.out.startswith(f"{page}: report on {map_path}, ")
    first = page.read_text(encoding="utf-8")
    assert first.startswith("<!doctype html>")
    assert "<h1>corridor</h1>" in first
    again = tempog("report", map_path, "-o", page, "--from", "+0", "--to", "+60")
    assert again.code == 1
    assert "exists already; use --force" in again.err
    assert page.read_text(encoding="utf-8") == first
    assert tempog("report", map_path, "-o", page, "--to", "+60", "--name", "first minute", "--force").code == 0
    assert "<h1>first minute</h1>" in page.read_text(encoding="utf-8")
    assert list(tmp_path.iterdir()) == [page]


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (("-o", "report.pdf"), 2, "report.pdf names no page; wanted a name that ends in .html or .htm"),
        (("-o", "report.html", "--from", "+500"), 1, "no scan between"),
        (("-o", "report.html", "--robot", "r9"), 1, "has no robot 'r9'"),
        (("-o", "none/report.html"), 1, "none is not a directory"),
    ],
)
def test_a_report_that_cannot_be_says_why_and_leaves_nothing(
    tempog, map_path, tmp_path, monkeypatch, words, code, error
):
    monkeypatch.chdir(tmp_path)
    result = tempog("report", map_path, *words)
    assert result.code == code
    assert error in result.err
    assert list(tmp_path.iterdir()) == []


def test_a_page_fits_every_screen_and_printer_and_loads_nothing(tempog, map_path, tmp_path):
    page_path = tmp_path / "report.html"
    assert tempog("report", map_path, "-o", page_path, "--name", NAME).code == 0
    with chromium() as browser:
        for width, height in ((360, 740), (1280, 800), (3840, 2160)):
            for scheme in ("light", "dark"):
                page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
                said, asked = [], []
                page.on("console", lambda message, said=said: said.append(message.text))
                page.on("dialog", lambda dialog, said=said: said.append(dialog.message))
                page.on("request", lambda request, asked=asked: asked.append(request.url))
                page.goto(page_path.as_uri())
                assert page.evaluate("document.documentElement.scrollWidth") <= width
                assert page.inner_text("h1") == NAME
                assert page.evaluate("[...document.images].every(image => image.naturalWidth > 0)")
                assert page.evaluate("document.images.length") == 7
                back = page.evaluate("getComputedStyle(document.body).backgroundColor")
                brightness = sum(int(part) for part in back[4:-1].split(","))
                assert (brightness > 380) == (scheme == "light")
                assert said == []
                assert [url for url in asked if not url.startswith("data:")] == [page_path.as_uri()]
                page.close()
        page = browser.new_page(color_scheme="dark")
        page.goto(page_path.as_uri())
        page.emulate_media(media="print")
        assert page.evaluate("getComputedStyle(document.querySelector('.map')).filter") == "none"
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        assert page.pdf(format="A4").count(b"/Type /Page\n") in range(2, 7)
