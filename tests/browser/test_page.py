"""What somebody does with the page: move, scrub, play, click, compare, come back by a link."""

import math
import re

import numpy as np
import pytest

from tempog import find_objects
from tempog.analysis.map_diff import map_diff

PLAIN = "layers=occupancy:1"  # nothing but the tiles of one layer
HINGE_SIDE = (6.98, 2.53)  # a cell that the closed door's leaf stands in
DOOR_CLOSED, DOOR_OPEN = 90.0, 120.0


@pytest.fixture(scope="module")
def found(corridor_grid):
    return find_objects(corridor_grid)


def is_dark(colour):
    return sum(colour) < 200


def last_known(grid, x, y, t):
    history = grid.history(x, y)
    return history.value[np.searchsorted(history.start_ns, grid.start_ns + round(t * 1e9), side="right") - 1]


def test_the_map_is_drawn_as_the_history_has_it(page, corridor_grid):
    page.open(f"{PLAIN}&t=100")
    snapshot = corridor_grid.at("+100", hold=math.inf)
    resolution, extent = snapshot.extent.resolution_m, snapshot.extent
    rng = np.random.default_rng(7)
    for wanted in (0.9, 0.1):
        # Cells whose neighbours have the same state, so that smoothed edges do not count.
        alike = np.isclose(snapshot.value, wanted, atol=0.15)
        inner = alike[1:-1, 1:-1] & alike[:-2, 1:-1] & alike[2:, 1:-1] if wanted > 0.5 else alike[1:-1, 1:-1].copy()
        rows, cols = np.nonzero(inner)
        for k in rng.integers(len(rows), size=8):
            x = (cols[k] + 1.5 + extent.col0) * resolution
            y = (rows[k] + 1.5 + extent.row0) * resolution
            colour = page.colour(x, y)
            assert is_dark(colour) == (wanted > 0.5), (x, y, colour)
    assert page.text("#map-name") == "corridor"
    assert "1 920 scans" in page.text("#map-facts").replace("\u00a0", " ")


def test_the_slider_shows_the_door_open_and_closed(page, corridor_grid):
    page.open(PLAIN)
    for t in (DOOR_CLOSED, DOOR_OPEN, DOOR_CLOSED + 5):
        page.slide(t)
        shown = page.now()["t"]
        assert abs(shown - t) < 1.0
        assert is_dark(page.colour(*HINGE_SIDE)) == (last_known(corridor_grid, *HINGE_SIDE, shown) > 0.5)


def test_playing_runs_to_the_end_and_stops(page):
    page.open(f"{PLAIN}&t=150")
    page.tab.select_option("#speed", "60")
    page.tab.click("#play")
    assert page.tab.get_attribute("#play", "aria-label") == "Pause"
    page.until("tempog.state.now.t > 160 && tempog.map.pictures.frame.t > 150")
    page.until("!tempog.time.playing")
    assert page.now()["t"] == pytest.approx(191.9)
    page.settle()
    assert page.tab.get_attribute("#play", "aria-label") == "Play"


def test_pause_keeps_the_moment(page):
    page.open("t=10")
    page.tab.select_option("#speed", "10")
    page.tab.click("#play")
    page.until("tempog.state.now.t > 11")
    page.tab.click("#play")
    page.settle()
    t = page.now()["t"]
    page.tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert page.now()["t"] == t < 191


def test_a_click_on_the_door_tells_its_whole_story(page, found):
    (door,) = found.objects
    page.click(*door.configurations[0].centre_m)
    assert page.text(".object-detail h2") == f"Object {door.id}"
    assert page.text(".facts dd >> nth=0") == str(door.n_moves)
    buttons = page.tab.locator(".object-detail .changes button")
    assert buttons.count() == len(door.stays)
    start_ns = found.history.start_ns
    for k in (1, 3):
        buttons.nth(k).click()
        assert page.now()["t"] == pytest.approx((door.stays[k].start_ns - start_ns) / 1e9, abs=1e-3)
        assert buttons.nth(k).get_attribute("aria-current") == "true"
    page.settle()
    assert f"{len(door.gaps)} gap" in page.tab.get_attribute(".object-detail canvas", "aria-label")
    shares = page.tab.locator(".places tbody tr").all_inner_texts()
    for place, text in zip(door.configurations, shares, strict=False):
        assert f"{round(100 * door.shares[place.id])} %" in text


def test_unobserved_time_is_hatched_in_the_timeline(page, found):
    (door,) = found.objects
    page.open(f"object={door.id}")
    start_ns = found.history.start_ns
    gap = max(door.gaps, key=lambda gap: gap[1] - gap[0])
    seen = max(door.timeline, key=lambda period: period.stop_ns - period.start_ns)
    columns = [((one[0] + one[1]) / 2 - start_ns) / 1e9 for one in (gap, seen)]
    n_colours = [
        page.tab.evaluate(
            f"""() => {{
                const c = document.querySelector(".object-detail canvas");
                const pen = new OffscreenCanvas(c.width, c.height).getContext("2d", {{ willReadFrequently: true }});
                pen.drawImage(c, 0, 0);
                const x = Math.round(tempog.time.axis.place({t}) * c.width);
                const colours = new Set();
                for (const row of [0.1, 0.2, 0.3, 0.4]) {{
                    for (let k = -3; k <= 3; k++) {{
                        colours.add(String(pen.getImageData(x + k, Math.round(row * c.height), 1, 1).data));
                    }}
                }}
                return colours.size;
            }}"""
        )
        for t in columns
    ]
    assert n_colours[0] > 4  # the slanted lines
    assert n_colours[1] == 1


def test_a_moment_that_cannot_be_read_is_marked_until_another_is_shown(page):
    page.tab.fill("#moment", "yesterday")
    page.tab.keyboard.press("Enter")
    assert page.tab.get_attribute("#moment", "aria-invalid") == "true"
    assert page.now()["t"] == pytest.approx(191.9)
    page.slide(50.0)
    shown = page.tab.input_value("#moment")
    assert shown.startswith("+")
    assert page.tab.get_attribute("#slider", "aria-valuetext").startswith(shown)
    assert page.tab.get_attribute("#moment", "aria-invalid") == "false"


def test_a_moment_after_days_is_not_cut(page):
    page.tab.evaluate("tempog.time.setActivity({edges_t: [0, 86400 * 123], changes: [1], observed: [true]})")
    page.tab.evaluate("tempog.time.go(86400 * 123 - 0.1)")
    assert page.tab.input_value("#moment") == "+122 d 23:59:59.9"
    assert page.tab.evaluate("tempog.time.moment.scrollWidth <= tempog.time.moment.clientWidth")


def test_steps_go_from_change_to_change_of_the_object(page, found):
    (door,) = found.objects
    page.open(f"object={door.id}&t=0")
    times = [(stay.start_ns - found.history.start_ns) / 1e9 for stay in door.stays[1:]]
    for wanted in times[:3]:
        page.tab.click("#next")
        assert page.now()["t"] == pytest.approx(wanted, abs=1e-3)
    page.tab.click("#previous")
    assert page.now()["t"] == pytest.approx(times[1], abs=1e-3)


def test_a_click_on_a_cell_tells_every_interval(page, corridor_grid):
    page.open("t=100")
    page.click(*HINGE_SIDE, modifiers=["Alt"])
    page.tab.wait_for_selector(".intervals tbody tr")
    x, y = page.now()["cell"]
    history = corridor_grid.history(x, y)
    rows = page.tab.locator(".intervals tbody tr").all_inner_texts()
    assert len(rows) == len(history) < 120
    for row, state in zip(rows, history, strict=True):
        assert ("occupied" if state.value > 0.5 else "free") in row
        assert f"{state.value:.2f}" in row
    page.tab.locator(".intervals tbody tr:last-child button").click()
    assert page.now()["t"] == pytest.approx((history.start_ns[-1] - corridor_grid.start_ns) / 1e9, abs=1e-3)


def test_a_click_on_bare_floor_shows_its_cell(page):
    page.click(3.0, 1.5)
    page.tab.wait_for_selector("#panel-cell .intervals")
    assert page.tab.get_attribute("#tab-cell", "aria-selected") == "true"


def test_two_moments_are_compared(page, corridor_grid, found):
    page.open("tab=compare")
    for t, button in ((DOOR_CLOSED, "#set-a"), (DOOR_OPEN, "#set-b")):
        page.tab.fill("#moment", str(t))
        page.tab.press("#moment", "Enter")
        page.tab.click(button)
    page.tab.wait_for_selector(".counts")
    changed = map_diff(corridor_grid, f"+{DOOR_CLOSED}", f"+{DOOR_OPEN}", found=found)
    counts = [int(number) for number in re.findall(r"\d+", page.text(".counts"))]
    assert counts == [len(changed.moved), len(changed.appeared), len(changed.vanished)]
    assert counts[0] == 1
    page.tab.locator(".result .changes button").first.click()
    page.settle()
    before = page.tab.evaluate("document.getElementById('map').toDataURL()")
    page.tab.click("#compare-clear")
    page.settle()
    page.until(f"document.getElementById('map').toDataURL() !== {before!r}")  # the arrow is gone


def test_a_link_reproduces_the_view(page, open_page, viewer):
    page.open("t=95.5&layers=occupancy:1,dynamics:0.5,objects:0.7&hold=60")
    for _ in range(3):
        page.tab.click("#zoom-in")
    page.tab.mouse.move(400, 300)
    page.tab.mouse.down()
    page.tab.mouse.move(330, 340, steps=4)
    page.tab.mouse.up()
    page.click(*HINGE_SIDE)
    page.tab.mouse.move(5, 5)
    page.settle()
    page.until("location.hash.includes('object=')")
    hash_ = page.tab.evaluate("location.hash")
    other = open_page(viewer.url).open(hash_[1:])
    assert other.tab.evaluate("location.hash") == hash_
    for one, key in ((page.now(), "x"), (page.now(), "z"), (page.now(), "t"), (page.now(), "layers")):
        assert one[key] == pytest.approx(other.now()[key], abs=1e-3)
    assert other.now()["hold"] == 60
    assert other.text(".object-detail h2") == page.text(".object-detail h2")


@pytest.mark.parametrize(
    "address",
    [
        "x=abc&y=&z=-3&t=1e999&layers=;,<b>:9&object=x&cell=1&a=&b=NaN&tab=nothing",
        "object=99999&cell=1e9,1e9",
        "t=-50",
    ],
)
def test_addresses_that_make_no_sense_show_the_map_all_the_same(page, address):
    page.open(address)
    assert page.text("#map-name") == "corridor"
    assert 0 <= page.now()["t"] <= 191.9


def test_an_address_that_is_edited_leads_nowhere_but_to_the_map(page):
    page.tab.evaluate("location.hash = 't=99999&x=1e9&y=-1e9&z=1e9&hold=-3'")
    page.until("tempog.state.now.t < 200")
    page.settle()
    now = page.now()
    assert now["t"] == pytest.approx(191.9)
    assert now["hold"] is None
    assert max(abs(now["x"]), abs(now["y"])) < 50
    assert now["z"] < 5000


def test_back_returns_to_what_was_chosen_before(page):
    page.click(3.0, 1.5)
    page.click(*HINGE_SIDE)
    assert page.now()["object"] is not None
    page.tab.go_back()
    page.until("tempog.state.now.object === null && tempog.state.now.tab === 'cell'")
    page.tab.go_back()
    page.until("tempog.state.now.cell === null")


def test_layers_are_switched_and_blended(page):
    page.open("t=100&layers=occupancy:1")
    wall = next((x, y) for x in np.arange(1.0, 13.0, 0.05) for y in (0.0, 3.0) if is_dark(page.colour(x, y - 0.02)))
    dark = page.colour(wall[0], wall[1] - 0.02)
    page.tab.fill("#opacity-occupancy", "0.5")
    page.settle()
    pale = page.colour(wall[0], wall[1] - 0.02)
    assert sum(pale) > sum(dark) + 150
    page.tab.uncheck("#layer-occupancy")
    page.tab.check("#layer-static")
    page.until("tempog.map.pictures.shown.has('static') && !tempog.map.pictures.shown.has('occupancy')")
    page.tab.select_option("#hold", "10")
    assert page.now()["hold"] == 10
    assert "static" in page.text("#legend-entries")
    page.tab.check("#layer-people")
    page.settle()
    assert page.now()["layers"] == {"static": 1, "people": 1}


def test_light_and_dark(open_page, viewer):
    page = open_page(viewer.url, color_scheme="dark").open(PLAIN)
    assert page.tab.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(23, 26, 31)"
    floor = page.colour(3.0, 1.5)
    assert is_dark(floor)
    page.tab.click("#theme")
    page.settle()
    assert not is_dark(page.colour(3.0, 1.5))
    page.open(PLAIN)  # the choice is remembered
    assert not is_dark(page.colour(3.0, 1.5))


def test_the_list_is_searched_and_sorted(page):
    page.tab.click("#tab-objects")
    assert page.tab.locator(".list tbody tr").count() == 1
    page.tab.fill("#object-search", "nothing like it")
    assert page.tab.locator(".list tbody tr").count() == 0
    page.tab.fill("#object-search", "1")
    assert page.tab.locator(".list tbody tr").count() == 1
    page.tab.click("#sort-id")
    assert page.tab.get_attribute(".col-id", "aria-sort") == "ascending"
    page.tab.click("#sort-id")
    assert page.tab.get_attribute(".col-id", "aria-sort") == "descending"
    page.tab.press("#sort-id", "Tab")
    page.tab.click(".list .name")
    assert page.text(".object-detail h2") == "Object 1"


def test_wheel_and_drag_keep_the_point_under_the_pointer(page):
    at = page.point(7.0, 2.5)
    box = page.tab.locator("#map").bounding_box()
    page.tab.mouse.move(box["x"] + at["x"], box["y"] + at["y"])
    scale = page.now()["z"]
    page.tab.mouse.wheel(0, -300)
    page.until(f"tempog.state.now.z > {scale * 1.3}")
    page.settle()
    assert page.point(7.0, 2.5) == pytest.approx(at, abs=0.5)
    page.tab.mouse.down()
    page.tab.mouse.move(box["x"] + at["x"] + 60, box["y"] + at["y"] - 25, steps=5)
    page.tab.mouse.up()
    moved = page.point(7.0, 2.5)
    assert moved["x"] - at["x"] == pytest.approx(60, abs=1)
    assert moved["y"] - at["y"] == pytest.approx(-25, abs=1)
    page.tab.click("#fit")
    assert page.now()["z"] == pytest.approx(scale)


def test_two_fingers_zoom_and_one_finger_taps(open_page, viewer):
    page = open_page(viewer.url, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True).open()
    touch = page.tab.context.new_cdp_session(page.tab)
    box = page.tab.locator("#map").bounding_box()
    middle_x, middle_y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def fingers(kind, *spread):
        points = [{"x": middle_x + dx, "y": middle_y, "id": k} for k, dx in enumerate(spread)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    scale = page.now()["z"]
    fingers("touchStart", -30, 30)
    for reach in (45, 60, 75, 90):
        fingers("touchMove", -reach, reach)
    fingers("touchEnd")
    assert page.now()["z"] == pytest.approx(3 * scale, rel=0.1)
    page.tab.touchscreen.tap(middle_x, middle_y)
    page.tab.wait_for_selector("#panel-cell .heading, .object-detail .heading")
    page.tab.tap("#fold")
    page.settle()
    for button in page.tab.locator("button:visible, select:visible, a.tool:visible").all():
        hit = button.bounding_box()
        assert hit["height"] >= 40, button.get_attribute("id")


def test_all_of_it_with_keys_only(page, found):
    (door,) = found.objects
    press = page.tab.keyboard.press
    page.open("t=100")
    press("Tab")
    assert page.tab.evaluate("document.activeElement.textContent") == "Skip to the time slider"
    press("Enter")
    assert page.tab.evaluate("document.activeElement.id") == "slider"
    for key, change in (("ArrowRight", 1), ("Shift+ArrowLeft", -10), ("ArrowLeft", -1)):
        before = page.now()["t"]
        press(key)
        assert page.now()["t"] == pytest.approx(before + change)
    assert page.tab.get_attribute("#slider", "aria-valuetext").startswith("+1:30.0")
    press("Home")
    assert page.now()["t"] == 0
    press("Space")
    page.until("tempog.state.now.t > 0.5")
    press("Space")
    assert not page.tab.evaluate("tempog.time.playing")
    press("n")
    assert page.now()["t"] > 1
    press("/")
    page.tab.keyboard.type("1")
    press("Tab")  # from the search past the columns to the first object
    while not page.tab.evaluate("document.activeElement.classList.contains('name')"):
        press("Tab")
    press("Enter")
    assert page.text(".object-detail h2") == f"Object {door.id}"
    assert page.tab.evaluate("document.activeElement.id") == "back-to-list"
    press("Escape")
    assert page.now()["object"] is None
    assert page.tab.evaluate("document.activeElement.id") == f"object-{door.id}"
    for key, tab in (("l", "layers"), ("x", "cell"), ("c", "compare"), ("o", "objects")):
        press(key)
        assert page.tab.evaluate("document.activeElement.id") == f"tab-{tab}"
    press("ArrowRight")
    assert page.tab.get_attribute("#tab-cell", "aria-selected") == "true"
    page.tab.evaluate("document.getElementById('map').focus()")
    x, z = page.now()["x"], page.now()["z"]
    press("+")
    press("ArrowRight")
    assert page.now()["z"] > z
    assert page.now()["x"] > x
    press("0")
    assert page.now()["z"] == pytest.approx(z)
    press("Alt+Enter")
    page.tab.wait_for_selector("#panel-cell .intervals")
    press("[")
    press("n")
    press("]")
    assert page.now()["a"] is not None is not page.now()["b"]
    press("?")
    assert page.tab.evaluate("document.getElementById('help').open")
    press("Escape")
    assert not page.tab.evaluate("document.getElementById('help').open")


def test_the_picture_is_saved_by_keys_as_well(page):
    page.open("t=66.5")
    page.tab.focus("#fit")
    page.tab.keyboard.press("Tab")
    assert page.tab.evaluate("document.activeElement.id") == "save"
    with page.tab.expect_download() as download:
        page.tab.keyboard.press("Enter")
    assert "t=66.5" in download.value.url


def test_whatever_has_the_focus_shows_it_and_has_a_name(page):
    seen = set()
    for _ in range(60):
        page.tab.keyboard.press("Tab")
        one = page.tab.evaluate(
            """() => { const e = document.activeElement, style = getComputedStyle(e);
                const label = e.labels?.[0]?.textContent || "";
                const name = e.getAttribute("aria-label") || label || e.textContent.trim();
                return { id: e.id || e.className || e.tagName, name: name || e.getAttribute("aria-labelledby") || "",
                         ring: style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2 }; }"""
        )
        if one["id"] in ("BODY", "HTML") or (one["id"] in seen and len(seen) > 25):
            break
        seen.add(one["id"])
        assert one["ring"], one
        assert one["name"], one
    assert {"map", "slider", "play", "tab-layers", "fit", "theme", "layer-occupancy"} <= seen


def test_text_can_be_read_on_its_ground(open_page, viewer):
    for scheme in ("light", "dark"):
        page = open_page(viewer.url, color_scheme=scheme).open("object=1")
        ratios = page.tab.evaluate(
            """() => {
                const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
                const linear = (v) => ((v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
                const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
                const ground = (e) => {
                    for (; e; e = e.parentElement) {
                        const colour = rgb(getComputedStyle(e).backgroundColor);
                        if (colour.length < 4 || colour[3] === 1) return colour;
                    }
                    return [255, 255, 255];
                };
                const found = [];
                const texts = "h1, h2, h3, p, button, td, th, small, label, dt, dd, figcaption, select, .tick";
                for (const e of document.querySelectorAll(texts)) {
                    if (!e.offsetParent || !e.textContent.trim() || e.disabled) continue;
                    const [a, b] = [light(rgb(getComputedStyle(e).color)), light(ground(e))];
                    found.push([e.className || e.id || e.tagName, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05)]);
                }
                return found;
            }"""
        )
        assert len(ratios) > 30
        assert min(ratios, key=lambda one: one[1])[1] >= 4.5, min(ratios, key=lambda one: one[1])


@pytest.mark.parametrize("size", [(320, 568), (390, 844), (844, 390), (683, 384), (1366, 768), (3840, 2160)])
def test_nothing_sticks_out_at_any_size(open_page, viewer, size):
    page = open_page(viewer.url, viewport={"width": size[0], "height": size[1]}).open()
    for tab in ("layers", "objects", "cell", "compare"):
        page.tab.click(f"#tab-{tab}")
        wide, high = page.tab.evaluate(
            "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
        )
        assert (wide, high) == size
        sticking = page.tab.evaluate(
            """() => [...document.querySelectorAll("button, input, select, canvas, h1, h2, th, td, .legend"),
                ...document.querySelectorAll(".moment *")]
                .filter((e) => e.offsetParent && !e.closest(".skip"))
                .filter((e) => {
                    const box = e.getBoundingClientRect();
                    return box.width > 1 && (box.left < -1 || box.right > innerWidth + 1);
                })
                .map((e) => e.id || e.className || e.tagName)"""
        )
        assert sticking == []
        assert page.tab.locator("#map").bounding_box()["height"] > size[1] / 5
