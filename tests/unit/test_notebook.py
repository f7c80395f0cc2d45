"""How maps and objects show themselves, and what they give to xarray."""

from __future__ import annotations

import sys
import time
from html.parser import HTMLParser

import numpy as np
import pytest

from tempog import (
    CellClass,
    ConfigError,
    GridConfig,
    LiveMap,
    MapConfig,
    MovingObject,
    Scan,
    TemporalGrid,
    TimeError,
    build_grid,
    find_objects,
    map_dynamics,
    open_map,
    save_map,
    static_map,
)
from tempog.errors import ExtraError
from tempog.grid.history import History
from tempog.simulation import corridor, simulate
from tempog.texts import count_text


@pytest.fixture(scope="module")
def grid():
    return build_grid(simulate(corridor()).scans)


def text_of(html):
    parts = []
    parser = HTMLParser()
    parser.handle_data = parts.append
    parser.feed(html)
    return " ".join(parts)


def test_histories_of_all_kinds_say_what_they_are_and_how_far_they_go(grid, tmp_path):
    path = save_map(grid, tmp_path / "a & <b>.tempog")
    for history in (grid, grid.window("+5", "+20"), grid.area(5, 8, 1, 4), open_map(path)):
        name = type(history).__name__
        assert repr(history).startswith(f"<{name}: {count_text(history.n_scans)} scans, 2025-06-15 ")
        html = history._repr_html_()
        assert "data:image/png;base64," in html
        assert f"{name}" in text_of(html)
        assert history.format_moment(int(history.stamps_ns[history.first_scan])) in text_of(html)
        assert len(html) < 20_000
    assert "a & <b>.tempog" in text_of(html)
    assert "<b>.tempog" not in html


def test_a_live_map_shows_itself_while_it_grows_and_afterwards(tmp_path):
    scans = simulate(corridor(), duration_s=10.0).scans
    with LiveMap(tmp_path / "live.tempog", robot="r<1>") as live:
        assert repr(live) == "<LiveMap: no scans yet>"
        assert "none yet" in live._repr_html_()
        live.integrate_many(scans)
        assert repr(live).startswith("<LiveMap: 100 scans, ")
        assert "data:image/png" in live._repr_html_()
    assert repr(live).startswith("<LiveMap: 100 scans, ")
    assert "r<1>" in text_of(open_map(live.path)._repr_html_())


def test_to_be_shown_never_fails(grid, monkeypatch):
    assert repr(TemporalGrid()) == "<TemporalGrid: no scans yet>"
    monkeypatch.setattr(History, "at", lambda *_, **__: 1 / 0)
    assert text_of(grid._repr_html_()) == repr(grid)
    monkeypatch.setattr(History, "n_scans", property(lambda _: 1 / 0))
    assert repr(grid).startswith("<tempog.grid.temporal_grid.TemporalGrid object at")
    assert "TemporalGrid object at" in text_of(grid._repr_html_())


def test_a_map_too_large_to_draw_unasked_tells_its_facts_at_once():
    grid = TemporalGrid(MapConfig(grid=GridConfig(resolution_m=0.02)))
    for k in range(40):
        grid.integrate(Scan(float(k), (2.0 * k, 2.0 * k, 0.8), [0.0, 0.1], [5.0, 5.0]))
    assert grid.extent.n_rows * grid.extent.n_cols > 4_000_000
    since = time.perf_counter()
    html = grid._repr_html_()
    assert time.perf_counter() - since < 1.0
    assert "<img" not in html
    assert "40 in 39.0 s" in text_of(html)


def test_found_objects_show_their_places_moves_and_states(grid):
    found = find_objects(grid)
    (one,) = found.objects
    assert repr(found) == "<FoundObjects: 1 object, 0 places in no object, method evidence>"
    assert repr(one) == "<MovingObject 1: 2 places, 6 moves>"
    shown = text_of(found._repr_html_())
    assert "FoundObjects: 1 object, method evidence" in shown
    assert f"place {one.last_stay.configuration}" in shown
    shown = text_of(one._repr_html_())
    assert f"1 at (7.0, 2.5) m, {one.shares[1]:.0%} of the time" in shown
    assert "<path" in one._repr_html_()
    nothing = MovingObject(3, one.configurations, (), 0.0, 0.0, 0.0, None)
    assert "MovingObject 3" in text_of(nothing._repr_html_())


def test_labelled_arrays_are_the_history_s_own(grid):
    pytest.importorskip("xarray", reason="xarray is not installed")
    window = grid.window("+20", "+90")
    cube = window.to_xarray(times=["+30", "+80"], hold=5.0)
    for k, moment in enumerate(("+30", "+80")):
        snapshot = window.at(moment, 5.0)
        np.testing.assert_array_equal(cube.occupied[k], snapshot.value)
        np.testing.assert_array_equal(cube.age[k], snapshot.age_s)
        assert cube.time.values[k] == np.datetime64(snapshot.stamp_ns, "ns")
    np.testing.assert_array_equal(cube.static, static_map(window))
    np.testing.assert_array_equal(cube.dynamics, map_dynamics(window))
    assert dict(zip(cube.static.flag_values, cube.static.flag_meanings.split(), strict=True)) == {
        int(one): one.name.lower() for one in CellClass
    }
    leaf = cube.sel(x=6.98, y=2.53, method="nearest")
    row, col = grid.extent.index_of(6.98, 2.53)
    assert float(leaf.x) == pytest.approx((col + grid.extent.col0 + 0.5) * 0.05)
    np.testing.assert_array_equal(leaf.occupied, cube.occupied[:, row, col])
    assert cube.attrs["hold_s"] == 5.0
    assert grid.to_xarray().sizes["time"] == 1


def test_labelled_arrays_of_a_log_without_dates_count_from_its_start():
    pytest.importorskip("xarray", reason="xarray is not installed")
    grid = TemporalGrid()
    for t in range(5):
        grid.integrate(Scan(100.0 + t, (0.0, 0.0, 0.0), [0.0], [2.0]))
    cube = grid.to_xarray(times=[101, "+3"])
    assert cube.time.values.tolist() == [1.0, 3.0]
    assert cube.time.units == "s"


def test_what_has_no_arrays_says_why(grid, monkeypatch):
    pytest.importorskip("xarray", reason="xarray is not installed")
    with pytest.raises(TimeError, match="no scans"):
        TemporalGrid().to_xarray()
    with pytest.raises(ConfigError, match="names no moment"):
        grid.to_xarray(times=[])
    with pytest.raises(ConfigError, match="hold"):
        grid.to_xarray(hold=-1.0)
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ExtraError, match=r"pip install 'tempog\[xarray\]'"):
        grid.to_xarray()
