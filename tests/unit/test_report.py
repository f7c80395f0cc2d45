"""The report on a map: what it says is so, and names cannot break it."""

from __future__ import annotations

import base64
import io
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from tempog import (
    CellClass,
    LiveMap,
    Scan,
    TemporalGrid,
    TimeError,
    build_grid,
    find_objects,
    open_map,
    save_map,
    static_map,
)
from tempog.simulation import corridor, simulate
from tempog.store.upkeep import prune
from tempog.views.markup import VOID, Html, joined, tag
from tempog.views.report import report_page
from tempog.views.report.pictures import png_address
from tempog.views.report.strips import N_COLUMNS, Strips

NASTY = "<script>alert(1)</script> & \"'</style>"


class Page(HTMLParser):
    """A page as elements, each with its text, and whether all are closed in turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag_, attributes):
        self.elements.append((tag_, dict(attributes)))
        if tag_ not in VOID:
            self._open.append(tag_)
            self.texts.setdefault(tag_, []).append("")

    def handle_endtag(self, tag_):
        assert self._open.pop() == tag_

    def handle_data(self, data):
        for open_ in self._open:
            self.texts[open_][-1] += data

    def rows(self):
        return self.texts["tr"]


@pytest.fixture(scope="module")
def grid():
    return build_grid(simulate(corridor()).scans)


@pytest.fixture(scope="module")
def page(grid):
    return Page(report_page(grid, name="corridor"))


def test_text_never_becomes_markup():
    shown = str(tag("p", NASTY, tag("b", NASTY), title=NASTY))
    assert "<script" not in shown
    assert Page(shown).texts == {"p": [NASTY * 2], "b": [NASTY]}
    assert Page(shown).elements[0] == ("p", {"title": NASTY})
    assert isinstance(joined("<", Html("<br>")), Html)


def test_a_page_loads_nothing_and_runs_nothing(page):
    names = {name for name, _ in page.elements}
    assert not names & {"script", "link", "iframe", "object", "embed", "a", "form"}
    for _, attributes in page.elements:
        for key, value in attributes.items():
            assert not key.startswith("on")
            if key in ("src", "href", "action"):
                assert value.startswith("data:image/png;base64,")
    assert not re.search(r"url\(|@import|https?:", "".join(page.texts["style"]))
    policies = [attributes for _, attributes in page.elements if attributes.get("http-equiv")]
    assert policies[0]["content"].startswith("default-src 'none'")


def test_names_with_markup_are_shown_as_they_are(tmp_path):
    path = tmp_path / "x & <y>.tempog"
    source = {"path": NASTY, "sha256": None, "format": NASTY, "n_scans": 3, "n_skipped": 7, "notes": [NASTY]}
    with LiveMap(path, robot=NASTY, session=NASTY, sources=[source]) as live:
        live.integrate_many(simulate(corridor(), duration_s=5.0).scans)
    page = Page(report_page(open_map(path)))
    assert page.texts["h1"] == ["x & <y>"]
    session = next(row for row in page.rows() if row.startswith(NASTY))
    assert session.count(NASTY) >= 3
    assert f"{NASTY}: {NASTY}" in page.texts["li"]
    assert any("7 scans skipped" in text for text in page.texts["dd"])
    assert "script" not in {name for name, _ in page.elements}


def test_pictures_show_the_layers_with_north_up(grid, page):
    pictures = {attributes["alt"]: attributes for name, attributes in page.elements if name == "img"}
    assert len(pictures) == 7
    (static,) = (attributes for title, attributes in pictures.items() if title.startswith("static map"))
    image = Image.open(io.BytesIO(base64.b64decode(static["src"].partition(",")[2]))).convert("RGBA")
    assert image.size == (int(static["width"]), int(static["height"]))
    pixels = np.asarray(image)[::-1]
    classes = static_map(grid)
    rows, cols = np.nonzero(classes != CellClass.UNEXPLORED)
    drawn_rows, drawn_cols = np.nonzero(pixels[..., 3])
    up, right = drawn_rows.min() - rows.min(), drawn_cols.min() - cols.min()
    assert (pixels[..., 3] > 0).sum() == len(rows)
    colours = {CellClass.STATIC: (18, 18, 23), CellClass.FREE: (255, 255, 255), CellClass.CHANGING: (242, 140, 26)}
    for which, colour in colours.items():
        for row, col in np.argwhere(classes == which)[::50]:
            np.testing.assert_allclose(pixels[row + up, col + right, :3], colour, atol=1)


def test_images_of_many_and_of_few_colours_are_what_was_drawn():
    chosen = np.random.default_rng(5)
    for rgb in (chosen.random((40, 30, 3), dtype=np.float32), np.full((40, 30, 3), 0.2, dtype=np.float32)):
        image = Image.open(io.BytesIO(base64.b64decode(png_address(rgb).partition(",")[2])))
        np.testing.assert_array_equal(
            np.asarray(image.convert("RGBA"))[::-1, :, :3], np.round(rgb * 255).astype(np.uint8)
        )


def test_the_table_tells_what_was_found(grid, page):
    (one,) = find_objects(grid).objects
    (row,) = (row for row in page.rows() if "at (" in row)
    for place in one.configurations:
        assert (
            f"{place.id} at ({place.centre_m[0]:.1f}, {place.centre_m[1]:.1f}) m: {one.shares[place.id]:.0%}" in row
        )
    cells = [attributes["data-label"] for _, attributes in page.elements if "data-label" in attributes]
    assert cells[:3] == ["object", "places", "moves"]
    assert f"place {one.last_stay.configuration}" in row


def columns_of(path):
    """The columns that a path of rectangles covers."""
    covered = np.zeros(N_COLUMNS, dtype=bool)
    for begin, width in re.findall(r"M(\d+) \d+h(\d+)v", path):
        covered[int(begin) : int(begin) + int(width)] = True
    return covered


def test_a_strip_is_full_where_the_object_was_and_bare_where_nobody_looked(grid):
    (one,) = find_objects(grid).objects
    strip = str(Strips.of(grid).of_object(one, (0.0, 0.0, 1.0)))
    seen, *lanes = (columns_of(path) for path in re.findall(r'<path d="([^"]*)"', strip))
    assert len(lanes) == len(one.configurations)
    middles = grid.start_ns + (np.arange(N_COLUMNS) + 0.5) / N_COLUMNS * grid.duration_s * 1e9
    column_ns = grid.duration_s / N_COLUMNS * 1e9
    for moment, is_seen, *is_in in zip(middles, seen, *lanes, strict=True):
        edges = [edge for start, stop, _ in one.timeline for edge in (start, stop)]
        if min(abs(moment - edge) for edge in edges) < 2 * column_ns:
            continue
        now = next((place for start, stop, place in one.timeline if start <= moment < stop), "unseen")
        assert is_seen == (now != "unseen")
        assert is_in == [now == place.id for place in one.configurations]


def test_a_period_and_a_method_are_reported_on(grid):
    page = Page(report_page(grid, "+20", "+60", method="paper-tuned"))
    assert page.texts["h1"] == ["map"]
    assert "40.0 s" in page.texts["header"][0]
    assert any(text.startswith("401") for text in page.texts["dd"])
    assert "objects: method paper-tuned" in page.texts["caption"]


def test_pauses_poses_and_what_was_pruned_are_told(tmp_path, grid):
    scans = simulate(corridor(), duration_s=30.0).scans
    later = [Scan(s.t + 86_400, (s.x, s.y, s.theta), s.angles, s.ranges, s.max_range) for s in scans]
    path = save_map(build_grid([*scans, *later]), tmp_path / "days.tempog")
    text = Page(report_page(open_map(path))).texts["dl"][1]
    assert "1 long pause" in text
    assert "23 h 59 min" in text
    assert "All history is there" in text
    prune(path, int(later[0].stamp_ns))
    text = Page(report_page(open_map(path))).texts["dl"][1]
    assert "from before" in text
    assert "consistent" in Page(report_page(grid)).texts["dl"][1]


def test_sessions_that_were_not_asked_for_are_not_told_of(tmp_path):
    path = tmp_path / "two.tempog"
    for day, robot in enumerate(("r1", "r2")):
        with LiveMap(path, robot=robot, session=f"day {day}") as live:
            for s in simulate(corridor(), duration_s=10.0).scans:
                live.integrate(Scan(s.t + day * 86_400, (s.x, s.y, s.theta), s.angles, s.ranges, s.max_range))
    both, one = (Page(report_page(open_map(path, robots=robots))) for robots in (None, ["r2"]))
    assert sum(row.startswith("day ") for row in both.rows()) == 2
    assert [row[:5] for row in one.rows() if row.startswith("day ")] == ["day 1"]


def test_a_map_of_nothing_has_no_report_and_one_of_one_scan_has():
    with pytest.raises(TimeError, match="no scans"):
        report_page(TemporalGrid())
    grid = TemporalGrid()
    grid.integrate(Scan(0.0, (0.0, 0.0, 0.0), [0.0, 0.1], [2.0, 2.0]))
    page = Page(report_page(grid))
    assert "No object was found that stands now here, now there." in page.texts["p"]
    assert "A single scan." in page.texts["dl"][1]
