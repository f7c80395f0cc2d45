"""The grid as its docstrings promise it; its agreement with the paper is tested in properties."""

from __future__ import annotations

import doctest
import importlib
import math

import numpy as np
import pytest

from tempog.analysis.dynamics import map_dynamics
from tempog.analysis.occupancy import occupancy_grid
from tempog.analysis.static import CellClass, static_map
from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.errors import (
    ClockError,
    ConfigError,
    EmptyWindowError,
    ExtentError,
    MomentError,
    ScanError,
    TimeError,
)
from tempog.grid.temporal_grid import TemporalGrid
from tempog.pipeline import build_grid
from tempog.scans.scan import Scan, ScanLog

NS = 1_000_000_000
START_S = 1_071_078_718


def beam(t: float, distance: float = 2.0, x: float = 0.02, label: str = "") -> Scan:
    """One beam along x from ``(x, 0.02)``."""
    return Scan(t, (x, 0.02, 0.0), [0.0], [distance], label=label)


def grid_of(*scans: Scan, gap_s: float = 2.0, **sensing) -> TemporalGrid:
    grid = TemporalGrid(MapConfig(SensingConfig(**sensing), GridConfig(gap_s=gap_s)))
    for scan in scans:
        grid.integrate(scan)
    return grid


def wall_value(grid, t, hold=None) -> float:
    """P(occupied) at ``(2.02, 0.02)``."""
    snapshot = grid.at(t, hold=hold)
    return float(snapshot.value[snapshot.extent.index_of(2.02, 0.02)])


# Scans in.


def test_an_earlier_scan_is_refused_by_name():
    grid = grid_of(beam(5.0))
    with pytest.raises(ScanError, match=r"line 9 at 4\.500 s is 0\.500 s earlier.*sort the scans"):
        grid.integrate(beam(4.5, label="line 9"))


def test_a_refused_earlier_scan_leaves_the_grid_as_it_was():
    grid = grid_of(beam(5.0))
    with pytest.raises(ScanError):
        grid.integrate(beam(4.5, distance=7.0))
    assert (grid.n_scans, grid.n_intervals) == (1, grid_of(beam(5.0)).n_intervals)
    grid.integrate(beam(5.5))
    assert next(iter(grid.history(2.02, 0.02)))[:2] == (5 * NS, 5.5 * NS)


def test_scans_of_one_stamp_are_taken_in_the_order_given():
    grid = grid_of(beam(5.0), beam(5.0, distance=3.0), beam(5.0))
    intervals = list(grid.history(2.02, 0.02))
    assert [interval[:2] for interval in intervals] == [(5 * NS, 5 * NS)] * 3
    assert [interval.value > 0.5 for interval in intervals] == [True, False, True]
    assert grid.n_scans == 3


def test_of_states_at_one_moment_the_last_counts():
    assert wall_value(grid_of(beam(5.0), beam(5.0, distance=3.0)), 5.0) == pytest.approx(0.1)


def test_scans_slower_than_the_gap_are_refused_once_that_is_sure():
    grid = grid_of(*(beam(3.0 * k) for k in range(10)), gap_s=2.0)
    with pytest.raises(ConfigError, match=r"gap of 2 s is shorter than the scan period, 3 s.*10scans"):
        grid.integrate(beam(30.0))
    assert grid.n_scans == 10


def test_a_batch_of_scans_slower_than_the_gap_is_refused_before_the_first():
    grid = TemporalGrid(MapConfig(grid=GridConfig(gap_s=2.0)))
    with pytest.raises(ConfigError, match="shorter than the scan period"):
        grid.integrate_many([beam(3.0 * k) for k in range(4)])
    assert grid.n_scans == 0


def test_a_single_long_pause_is_no_reason_to_refuse():
    grid = grid_of(*(beam(0.1 * k + 100 * (k > 5)) for k in range(20)))
    assert len(grid.history(2.02, 0.02)) == 2


def test_a_gap_as_long_as_the_threshold_is_no_gap():
    assert len(grid_of(beam(0.0), beam(2.0)).history(2.02, 0.02)) == 1


def test_a_pause_longer_than_the_threshold_starts_a_new_interval_and_is_a_gap():
    history = grid_of(beam(0.0), beam(2.001)).history(2.02, 0.02)
    assert len(history) == 2
    assert history.gaps.tolist() == [[0, 2_001_000_000]]


def test_a_change_without_a_pause_is_no_gap():
    history = grid_of(beam(0.0), beam(0.5, distance=3.0)).history(2.02, 0.02)
    assert len(history) == 2
    assert history.gaps.shape == (0, 2)


@pytest.mark.parametrize("gap_s", [1e12, 1e300])
def test_a_gap_threshold_may_be_longer_than_all_time(gap_s):
    grid = grid_of(beam(0.0), beam(1e6), gap_s=gap_s)
    assert len(grid.history(2.02, 0.02)) == 1
    assert len(grid.history(2.02, 0.02).gaps) == 0


def test_an_interval_keeps_its_first_value():
    grid = grid_of(beam(0.0), beam(0.5, distance=3.0), gap_s=2.0, prob_hit=0.6, prob_free=0.45)
    (interval,) = grid.history(2.02, 0.02)  # 0.45 is within the tolerance of 0.2
    assert interval == (0, NS // 2, float(np.float32(0.6)))


def test_a_scan_without_beams_counts_as_a_scan():
    grid = grid_of(Scan(0.0, (0, 0, 0), [], []), beam(1.0))
    assert (grid.n_scans, grid.start_ns) == (2, 0)


def test_scans_that_say_nothing_leave_no_cells():
    grid = grid_of(Scan(0.0, (0, 0, 0), [0.0], [math.nan]))
    assert (grid.n_scans, grid.n_cells, grid.n_intervals) == (1, 0, 0)
    assert grid.at(0.0).value.shape == (0, 0)
    assert map_dynamics(grid).shape == static_map(grid).shape == occupancy_grid(grid).shape == (0, 0)


def test_poses_are_kept_as_given():
    grid = grid_of(*(beam(0.1 * k, x=0.02 + 0.1 * k) for k in range(100)))
    assert grid.poses.shape == (100, 3)
    np.testing.assert_array_equal(grid.poses[:, 0], [0.02 + 0.1 * k for k in range(100)])


# The front door.


def test_build_grid_merges_logs_by_time():
    a, b = [beam(0.0), beam(1.0), beam(2.0)], [beam(0.5, distance=3.0), beam(1.5, distance=3.0)]
    merged = build_grid([ScanLog(a), ScanLog(b)], gap="2s")
    assert merged.stamps_ns.tolist() == [k * NS // 2 for k in range(5)]
    assert len(merged.history(2.02, 0.02)) == 5


def test_build_grid_measures_the_gap_in_scans_of_the_slowest_log():
    fast, slow = [beam(0.1 * k) for k in range(20)], [beam(0.5 * k) for k in range(4)]
    assert build_grid([fast, slow], gap="4scans").config.grid.gap_s == pytest.approx(2.0)


@pytest.mark.parametrize("nothing", [[], [[]], [ScanLog([]), []]])
def test_build_grid_wants_scans(nothing):
    with pytest.raises(ScanError, match="no scans were given"):
        build_grid(nothing)


def test_build_grid_refuses_a_gap_shorter_than_the_scan_period():
    with pytest.raises(ConfigError, match="shorter than the scan period"):
        build_grid([beam(float(k)) for k in range(5)], gap="0.5s")


def test_build_grid_hands_the_sorted_scans_to_track():
    seen = []

    def track(scans):
        for scan in scans:
            seen.append(scan.t)
            yield scan

    build_grid(ScanLog([beam(2.0), beam(0.0), beam(1.0)]), track=track)
    assert seen == [0.0, 1.0, 2.0]


# Questions.


def test_a_cell_is_unknown_between_its_intervals_without_a_hold():
    grid = grid_of(beam(0.0), beam(10.0))
    assert math.isnan(wall_value(grid, 5.0))


def test_a_cell_keeps_its_state_for_the_hold():
    grid = grid_of(beam(0.0), beam(10.0, distance=3.0))
    assert wall_value(grid, 4.0, hold=4.5) == pytest.approx(0.9)
    assert math.isnan(wall_value(grid, 5.0, hold=4.5))
    assert wall_value(grid, 9.9, hold=math.inf) == pytest.approx(0.9)


@pytest.mark.parametrize("milliseconds", [1, 100, 300, 1000, 1079, 1300, 2300, 8131, 9900, 77_777])
def test_a_hold_includes_its_last_moment(milliseconds):
    grid = grid_of(beam(0.0), beam(0.5, x=9.0))
    assert wall_value(grid, milliseconds / 1000, hold=milliseconds / 1000) == pytest.approx(0.9)


def test_nothing_is_known_before_it_was_seen():
    grid = grid_of(beam(10.0))
    assert np.isnan(grid.at(9.9, hold=math.inf).value).all()


def test_the_age_is_the_time_since_the_last_look():
    grid = grid_of(beam(0.0), beam(1.0), beam(20.0, x=9.0))
    snapshot = grid.at(5.5, hold=math.inf)
    where = snapshot.extent.index_of(2.02, 0.02)
    assert snapshot.age_s[where] == pytest.approx(4.5)
    assert grid.at(0.5).age_s[where] == 0.0
    assert math.isnan(grid.at(5.5).age_s[where])


@pytest.mark.parametrize("hold", [-1.0, math.nan])
def test_a_hold_that_is_no_duration_is_refused(hold):
    with pytest.raises(ConfigError, match=r"hold = .* is not a duration"):
        grid_of(beam(0.0)).at(0.0, hold=hold)
    with pytest.raises(ConfigError, match=r"hold = .* is not a duration"):
        grid_of(beam(0.0)).changes(0.0, 1.0, hold=hold)


@pytest.mark.parametrize(
    "moment", ["+1", START_S + 1, f"{START_S + 1}", "2003-12-10T17:51:59Z", np.datetime64(START_S + 1, "s")]
)
def test_a_moment_may_be_given_in_every_form(moment):
    grid = grid_of(beam(START_S), beam(START_S + 1, distance=3.0))
    assert wall_value(grid, moment) == pytest.approx(0.1)
    assert grid.window(moment).n_scans == 1


def test_changes_are_the_cells_that_differ_with_their_places():
    grid = grid_of(beam(0.0), beam(1.0, distance=3.0))
    changes = grid.changes(0.0, 1.0)
    np.testing.assert_allclose(changes.points_map, [[2.025, 0.025]])
    np.testing.assert_allclose(changes.before, [0.9])
    np.testing.assert_allclose(changes.after, [0.1])


def test_changes_backwards_are_before_and_after_swapped():
    grid = grid_of(beam(0.0), beam(1.0, distance=3.0))
    forth, back = grid.changes(0.0, 1.0), grid.changes(1.0, 0.0)
    np.testing.assert_array_equal(forth.before, back.after)
    np.testing.assert_array_equal(forth.after, back.before)


def test_changes_leave_out_cells_whose_last_look_is_older_than_the_hold():
    grid = grid_of(beam(0.0), beam(50.0, distance=3.0))
    assert len(grid.changes(40.0, 50.0).before) == 1
    assert len(grid.changes(40.0, 50.0, hold=30.0).before) == 0


@pytest.mark.parametrize(("x", "y"), [(math.nan, 0.0), (0.0, math.inf), (1.0, math.nan)])
def test_a_place_that_is_none_is_refused(x, y):
    with pytest.raises(ConfigError, match="is not a place"):
        grid_of(beam(0.0)).history(x, y)


def test_loose_scans_with_a_clock_that_stepped_back_far_are_refused():
    with pytest.raises(ClockError, match="step back"):
        build_grid([beam(0.0), beam(1.0), beam(2.0), beam(0.5)])


def test_a_few_loose_scans_out_of_order_are_sorted_with_a_warning():
    scans = [beam(0.1 * k) for k in range(200)]
    scans[50], scans[51] = scans[51], scans[50]
    with pytest.warns(UserWarning, match="steps? back"):
        grid = build_grid(iter(scans))
    assert grid.n_scans == 200


def test_the_gap_is_ten_scan_periods_unless_told():
    scans = [beam(0.1 * k) for k in range(20)]
    assert build_grid(scans).gap_s == pytest.approx(1.0)
    assert build_grid(scans, MapConfig(grid=GridConfig(gap_s=5.0))).gap_s == 5.0
    assert build_grid(scans, MapConfig(grid=GridConfig(gap_s=5.0)), gap="3scans").gap_s == pytest.approx(0.3)
    assert TemporalGrid().gap_s == 2.0


def test_a_slow_start_is_not_mistaken_for_the_scan_period():
    scans = [beam(3.0 * k) for k in range(12)] + [beam(36 + 0.1 * k) for k in range(300)]
    assert build_grid(scans, track=iter).n_scans == 312


def test_a_window_knows_nothing_of_what_came_after_it():
    grid = grid_of(*[beam(0.1 * k) for k in range(100)])
    window = grid.window(0, 5)
    assert np.isnan(window.at(8).value).all()
    assert np.nanmax(window.at(8, hold=math.inf).age_s) == pytest.approx(3.0)
    assert np.nanmax(window.at(5).value) == pytest.approx(0.9)


def test_a_scan_keeps_its_readings_when_the_callers_array_changes():
    ranges = np.array([2.0], dtype=np.float32)
    scan = Scan(0.0, (0.0, 0.0, 0.0), [0.0], ranges)
    ranges[0] = 9.0
    assert scan.ranges[0] == 2.0


@pytest.mark.parametrize(("theta", "angle"), [(1.7e308, 1.7e308), (1e9, 0.0), (0.0, -1e9)])
def test_angles_that_no_sensor_has_are_refused(theta, angle):
    with pytest.raises(ScanError, match="not usable"):
        Scan(0.0, (0.0, 0.0, theta), [angle], [2.0])


def test_a_stamp_beyond_int64_is_refused():
    with pytest.raises(ScanError, match="not a usable time"):
        Scan(0.0, (0.0, 0.0, 0.0), [], [], stamp_ns=2**64)


def test_numpy_numbers_are_settings_too():
    config = GridConfig(resolution_m=np.float32(0.05), max_cells=np.int64(4096))
    assert type(config.resolution_m) is float
    assert type(config.max_cells) is int


@pytest.mark.parametrize(("x", "y"), [(99.0, 0.0), (2.0, -50.0), (1e12, 0.0), (1e308, 0.0)])
def test_a_place_that_was_never_seen_has_an_empty_history(x, y):
    history = grid_of(beam(0.0)).history(x, y)
    assert len(history) == 0
    assert history.at(0) is None
    assert history.gaps.shape == (0, 2)


def test_a_window_includes_both_its_ends():
    grid = grid_of(*(beam(float(k)) for k in range(5)))
    window = grid.window(1.0, 3.0)
    assert (window.first_scan, window.last_scan, window.n_scans, window.duration_s) == (1, 3, 3, 2.0)


def test_a_window_without_ends_is_the_whole_history():
    grid = grid_of(*(beam(float(k)) for k in range(5)))
    assert grid.window().n_scans == 5
    assert grid.window(t1=2.0).n_scans == 3
    assert grid.window(2.0).n_scans == 3


def test_seconds_from_the_start_count_from_the_whole_historys_start_in_a_window_too():
    grid = grid_of(*(beam(START_S + k) for k in range(5)))
    assert grid.window("+2").window("+3").n_scans == 2


@pytest.mark.parametrize(("t0", "t1"), [(1.2, 1.8), (9.0, 10.0), (-2.0, -1.0)])
def test_a_window_without_scans_is_refused_with_what_there_is(t0, t1):
    grid = grid_of(*(beam(float(k)) for k in range(5)))
    with pytest.raises(EmptyWindowError, match=r"no scan between .* the scans run from \+0\.0 s to \+4\.0 s"):
        grid.window(t0, t1)


def test_a_window_stays_the_same_while_mapping_goes_on():
    grid = grid_of(beam(0.0), beam(1.0))
    window = grid.window()
    before = window.n_intervals, window.n_cells, map_dynamics(window).tobytes()
    grid.integrate(beam(1.5, distance=1.9))
    assert (window.n_intervals, window.n_cells, map_dynamics(window).tobytes()) == before
    assert window.n_scans == 2


@pytest.mark.parametrize(
    "question",
    [
        lambda grid: grid.at(0.0),
        lambda grid: grid.window(),
        lambda grid: grid.changes(0.0, 1.0),
        lambda grid: grid.start_ns,
    ],
)
def test_a_grid_without_scans_has_no_times(question):
    with pytest.raises(TimeError, match="no scans yet"):
        question(TemporalGrid())


def test_a_grid_without_scans_has_nothing_in_it():
    grid = TemporalGrid()
    assert (grid.n_scans, grid.n_cells, grid.n_intervals, grid.duration_s) == (0, 0, 0, 0.0)
    assert len(grid.history(0.0, 0.0)) == 0
    assert map_dynamics(grid).shape == static_map(grid).shape == occupancy_grid(grid).shape == (0, 0)


@pytest.mark.parametrize("parameter", ["measure", "weight"])
def test_an_unknown_measure_or_weight_is_refused_with_the_choices(parameter):
    with pytest.raises(ConfigError, match=rf"{parameter} = 'best' cannot work; wanted one of"):
        map_dynamics(grid_of(beam(0.0)), **{parameter: "best"})


@pytest.mark.parametrize("limits", [{"dynamics_below": 0.6}, {"mean_above": -0.1}, {"mean_above": math.nan}])
def test_limits_of_the_static_map_outside_their_range_are_refused(limits):
    with pytest.raises(ConfigError, match=f"{next(iter(limits))} = "):
        static_map(grid_of(beam(0.0)), **limits)


@pytest.mark.parametrize("limits", [(0.5, 0.9), (0.0, 0.9), (0.1, 0.5), (0.1, 1.0), (math.nan, 0.9)])
def test_occupancy_limits_that_do_not_lie_around_a_half_are_refused(limits):
    with pytest.raises(ConfigError, match="prob_low = "):
        occupancy_grid(grid_of(beam(0.0)), prob_low=limits[0], prob_high=limits[1])


def test_the_static_map_tells_wall_floor_and_what_changes():
    # a wall at 4 m; before it, at 2 m, a door that is closed for half of the time
    grid = grid_of(*(beam(0.5 * k, distance=2.0 if k < 20 else 4.0) for k in range(40)))
    classes = static_map(grid)
    got = [classes[grid.extent.index_of(x, 0.02)] for x in (1.02, 2.02, 4.02, 4.07)]
    assert got == [CellClass.FREE, CellClass.CHANGING, CellClass.STATIC, CellClass.UNEXPLORED]


# Memory.


def patch_of_floor(grid: TemporalGrid, x: float, y: float) -> None:
    t = grid.n_scans * 0.1
    grid.integrate(Scan(t, (x, y, 0.0), np.linspace(-3, 3, 60), np.full(60, 2.0)))


def test_memory_follows_the_area_seen_and_not_the_extent():
    near, far = TemporalGrid(), TemporalGrid()
    for k in range(2):
        patch_of_floor(near, 3.01 * k, 0.017)
        patch_of_floor(far, 300.01 * k, 0.017)
    cells_between = far.extent.n_rows * far.extent.n_cols
    assert cells_between > 50 * near.extent.n_cols
    assert far.n_cells == pytest.approx(near.n_cells, rel=0.1)
    # the directory costs 4 bytes per 64 cells; a dense grid's open intervals would cost 12 per cell
    assert far.memory_bytes < 2 * near.memory_bytes
    assert far.memory_bytes - near.memory_bytes < cells_between


def test_memory_grows_with_the_area():
    grid = TemporalGrid()
    patch_of_floor(grid, 0.01, 0.017)
    one = grid.memory_bytes
    for k in range(1, 10):
        patch_of_floor(grid, 5.01 * k, 0.017)
    assert grid.memory_bytes > 3 * one


def test_a_quiet_place_costs_no_more_however_long_it_is_watched():
    grid = TemporalGrid()
    for _ in range(300):
        patch_of_floor(grid, 0.01, 0.017)
    before, n_scans = grid.memory_bytes, grid.n_scans
    for _ in range(300):
        patch_of_floor(grid, 0.01, 0.017)
    assert grid.memory_bytes - before <= 2 * 32 * n_scans  # stamps and poses, with room to grow


@pytest.mark.parametrize(
    "module",
    [
        "analysis.dynamics",
        "config",
        "grid.temporal_grid",
        "grid.time_index",
        "pipeline",
        "sensing.grid_spec",
        "times",
    ],
)
def test_the_examples_in_the_docstrings_give_what_they_show(module):
    result = doctest.testmod(importlib.import_module(f"tempog.{module}"))
    assert result.attempted > 0
    assert result.failed == 0


def test_a_window_that_ends_before_it_begins_is_refused():
    with pytest.raises(MomentError, match="exchange the two"):
        grid_of(beam(0.0), beam(1.0)).window(1.0, 0.0)


def test_scans_far_off_are_left_out_when_asked():
    config = MapConfig(grid=GridConfig(max_cells=2**20))
    scans = [beam(0.1 * k) for k in range(9)] + [Scan(1.0, (9e4, 0.0, 0.0), [0.0], [2.0])]
    with pytest.raises(ExtentError):
        build_grid(scans, config)
    with pytest.warns(UserWarning, match="1 of 10 scans left out"):
        assert build_grid(scans, config, skip_far=True).n_scans == 9


def test_half_of_the_scans_far_off_are_too_many_to_leave_out():
    config = MapConfig(grid=GridConfig(max_cells=2**20))
    scans = [beam(0.0), *(Scan(0.1 * k, (9e4, 0.0, 0.0), [0.0], [2.0]) for k in range(1, 4))]
    with pytest.raises(ExtentError):
        build_grid(scans, config, skip_far=True)


def test_a_history_is_a_sequence_of_intervals():
    history = grid_of(beam(0.0), beam(0.5, distance=3.0)).history(2.02, 0.02)
    assert history[0] == next(iter(history))
    assert history[-1].value < 0.5 < history[0].value
    assert history[:1] == [history[0]]


@pytest.mark.parametrize("wrong", ["log.npz", GridConfig()])
def test_what_is_no_scans_or_no_settings_is_told(wrong):
    with pytest.raises((ScanError, ConfigError), match="wanted"):
        build_grid(wrong) if isinstance(wrong, str) else TemporalGrid(wrong)


def test_a_period_that_begins_after_the_last_scan_says_where_the_scans_are() -> None:
    grid = TemporalGrid()
    for k in range(20):
        grid.integrate(Scan(0.1 * k, (0.0, 0.0, 0.0), [0.0], [2.0]))
    for period in (("+100", None), (None, "-5"), ("+50", "+60")):
        with pytest.raises(EmptyWindowError, match=r"the scans run from \+0\.0 s to \+1\.9 s"):
            grid.window(*period)
