"""Settings: which are refused, how they travel, and the gap as people write it."""

from __future__ import annotations

import json
import math

import pytest

from tempog.config import MAX_SCAN_CELLS_ACROSS, GridConfig, MapConfig, SensingConfig, check_gap, parse_gap
from tempog.errors import ConfigError, TempogError

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("evidence", "magic"),
        ("no_return", "sometimes"),
        ("max_range_m", 0.0),
        ("max_range_m", -1.0),
        ("max_range_m", INF),
        ("max_range_m", NAN),
        ("prob_hit", 0.5),
        ("prob_hit", 1.0),
        ("prob_hit", NAN),
        ("prob_free", 0.0),
        ("prob_free", 0.5),
        ("free_margin_m", -0.01),
        ("protect_m", -0.01),
        ("protect_m", 10.5),
        ("bridge_m", NAN),
        ("collinear_m", INF),
        ("snap_m", -0.01),
        ("surface_min_hits", 1),
    ],
)
def test_a_sensing_setting_that_cannot_work_is_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=rf"^{name} = .*wanted"):
        SensingConfig(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("resolution_m", 0.0),
        ("resolution_m", -0.05),
        ("resolution_m", 101.0),
        ("resolution_m", NAN),
        ("gap_s", 0.0),
        ("gap_s", -1.0),
        ("gap_s", INF),
        ("gap_s", NAN),
        ("tolerance", -0.1),
        ("tolerance", 1.1),
        ("tolerance", NAN),
        ("max_cells", 63),
        ("max_cells", 2**31),
    ],
)
def test_a_grid_setting_that_cannot_work_is_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=rf"^{name} = .*wanted"):
        GridConfig(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [("protect_m", 0), ("free_margin_m", 0.0), ("bridge_m", 10.0), ("collinear_m", 0.0)],
)
def test_lengths_may_be_zero_and_up_to_ten_metres(name, value):
    assert getattr(SensingConfig(**{name: value}), name) == value


@pytest.mark.parametrize("tolerance", [0.0, 1.0])
def test_the_ends_of_the_tolerance_are_allowed(tolerance):
    assert GridConfig(tolerance=tolerance).tolerance == tolerance


def test_a_refused_setting_is_an_error_of_ours_and_a_value_error():
    with pytest.raises(TempogError) as raised:
        GridConfig(gap_s=-1)
    assert isinstance(raised.value, ValueError)


def test_a_choice_is_refused_with_the_choices():
    with pytest.raises(ConfigError, match="neighbours, never, always"):
        SensingConfig(no_return="maybe")


def test_a_scan_of_too_many_cells_across_is_refused_with_what_to_do():
    too_far_m = MAX_SCAN_CELLS_ACROSS * 0.5 / 2 + 0.5
    with pytest.raises(ConfigError, match=rf"cells across.*at most {MAX_SCAN_CELLS_ACROSS}.*coarser resolution"):
        MapConfig(SensingConfig(max_range_m=too_far_m), GridConfig(resolution_m=0.5))


def test_a_scan_of_just_as_many_cells_as_allowed_is_accepted():
    far_m = MAX_SCAN_CELLS_ACROSS * 0.5 / 2
    assert MapConfig(SensingConfig(max_range_m=far_m), GridConfig(resolution_m=0.5)).sensing.max_range_m == far_m


def test_settings_cannot_be_changed_afterwards():
    with pytest.raises(AttributeError):
        GridConfig().gap_s = 3.0


def test_settings_come_back_from_a_dictionary():
    config = MapConfig(
        SensingConfig(evidence="literal", max_range_m=12.5, surface_min_hits=7), GridConfig(0.1, 1.5, 0.3)
    )
    assert MapConfig.from_dict(config.to_dict()) == config


def test_settings_survive_json():
    config = MapConfig(SensingConfig(no_return="never"), GridConfig(gap_s=0.1 + 0.2))
    assert MapConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config


def test_missing_settings_are_the_defaults():
    assert MapConfig.from_dict({}) == MapConfig()
    assert MapConfig.from_dict({"grid": {"gap_s": 3.0}}) == MapConfig(grid=GridConfig(gap_s=3.0))


def test_an_unknown_group_is_refused_with_the_known_ones():
    with pytest.raises(ConfigError, match=r"unknown settings group 'colours'; known: sensing, grid"):
        MapConfig.from_dict({"colours": {}})


def test_an_unknown_setting_is_refused_by_name():
    with pytest.raises(ConfigError, match=r"group 'grid'.*'gap'"):
        MapConfig.from_dict({"grid": {"gap": 2.0}})


@pytest.mark.parametrize("value", ["2", [2.0]])
def test_a_setting_of_another_kind_is_refused(value):
    with pytest.raises(ConfigError):
        MapConfig.from_dict({"grid": {"gap_s": value}})


def test_an_unusable_setting_in_a_dictionary_is_refused_by_name():
    with pytest.raises(ConfigError, match="gap_s = -1"):
        MapConfig.from_dict({"grid": {"gap_s": -1}})


# The gap.


@pytest.mark.parametrize("text", ["2s", "2", "2.0 s", " 2S ", "20scans", "20 scans", "20 Scans"])
def test_a_gap_is_seconds_or_scans(text):
    assert parse_gap(text, scan_period_s=0.1) == pytest.approx(2.0)


def test_one_scan_may_be_written_in_the_singular():
    assert parse_gap("1 scan", scan_period_s=0.5) == 0.5


def test_without_a_known_scan_period_a_scan_counts_for_a_second():
    assert parse_gap("10scans", scan_period_s=NAN) == 10.0


def test_without_a_known_scan_period_no_gap_is_too_short():
    assert parse_gap("0.001s", scan_period_s=NAN) == 0.001


@pytest.mark.parametrize(
    "text", ["", "s", "scans", "many", "-2s", "0", "0scans", "nan", "inf", "2m", "1e999", "2 s s"]
)
def test_a_gap_that_is_no_duration_is_refused(text):
    with pytest.raises(ConfigError, match="is not a duration; wanted for example"):
        parse_gap(text, scan_period_s=0.1)


def test_a_gap_shorter_than_the_scan_period_is_refused_with_ones_that_work():
    with pytest.raises(ConfigError, match=r"0\.05 s is shorter than the scan period, 0\.1 s.*10scans.*0\.2s"):
        parse_gap("0.05s", scan_period_s=0.1)


def test_half_a_scan_is_refused():
    with pytest.raises(ConfigError, match="shorter than the scan period"):
        parse_gap("0.5scans", scan_period_s=0.1)


def test_a_gap_of_exactly_the_scan_period_is_accepted():
    check_gap(0.1, 0.1)


def test_the_suggested_gaps_are_accepted():
    for text in ("10scans", "0.246s"):
        parse_gap(text, scan_period_s=0.123)
