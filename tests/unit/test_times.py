"""Moments as people write them, and stamps as they are shown."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from tempog.errors import TimeError
from tempog.times import format_moment, parse_moment

START_NS = 1_071_078_718_000_000_000  # 2003-12-10 17:51:58 UTC
NS = 1_000_000_000


@pytest.mark.parametrize("moment", [12.5, np.float64(12.5), "12.5", " 12.5 ", "1.25e1"])
def test_a_number_is_seconds_as_in_the_log(moment):
    assert parse_moment(moment, START_NS) == 12_500_000_000


def test_a_whole_number_is_seconds_too():
    assert parse_moment(1071078718, 0) == START_NS


@pytest.mark.parametrize("moment", ["+2.5", "+2.5s", "+2.5 s", " +2.5 "])
def test_a_plus_counts_seconds_from_the_first_scan(moment):
    assert parse_moment(moment, START_NS) == START_NS + 2_500_000_000


@pytest.mark.parametrize(
    ("moment", "seconds"), [("+2d", 172_800), ("+1.5 h", 5400), ("+90min", 5400), ("+1w", 604_800)]
)
def test_a_plus_may_count_longer_units(moment, seconds):
    assert parse_moment(moment, START_NS) == START_NS + seconds * NS


def test_a_negative_number_is_before_the_clocks_zero():
    assert parse_moment("-3", START_NS) == -3 * NS


@pytest.mark.parametrize(
    "moment",
    [
        "2003-12-10T17:51:58Z",
        "2003-12-10T17:51:58+00:00",
        "2003-12-10 17:51:58",
        "2003-12-10T19:51:58+02:00",
        datetime(2003, 12, 10, 17, 51, 58, tzinfo=UTC),
        datetime(2003, 12, 10, 19, 51, 58, tzinfo=timezone(timedelta(hours=2))),
        np.datetime64("2003-12-10T17:51:58"),
    ],
)
def test_a_date_is_that_moment(moment):
    assert parse_moment(moment, 0) == START_NS


def test_a_date_without_a_time_zone_is_utc():
    assert parse_moment(datetime(2003, 12, 10, 17, 51, 58), 0) == START_NS


def test_a_numpy_date_is_exact_to_the_nanosecond():
    assert parse_moment(np.datetime64(START_NS + 1, "ns"), 0) == START_NS + 1


def test_a_date_is_exact_to_the_microsecond():
    moment = datetime(2003, 12, 10, 17, 51, 58, 123_457, tzinfo=UTC)
    assert parse_moment(moment, 0) == START_NS + 123_457_000


def test_a_date_as_text_is_exact_to_the_microsecond():
    assert parse_moment("2003-12-10T17:51:58.123457Z", 0) == START_NS + 123_457_000


@pytest.mark.parametrize("text", ["", "soon", "+", "+-", "12:00", "120s", "2003-13-10", "+2m", "--3"])
def test_other_text_is_refused_and_shown(text):
    with pytest.raises(TimeError, match="is not a moment; wanted"):
        parse_moment(text, START_NS)


@pytest.mark.parametrize("moment", [float("nan"), float("inf"), "nan", "-inf", "+nan"])
def test_a_number_that_is_not_finite_is_refused(moment):
    with pytest.raises(TimeError, match="finite"):
        parse_moment(moment, START_NS)


@pytest.mark.parametrize(
    "moment",
    [
        9.3e9,
        "1e300",
        "+9e9",
        datetime(2300, 1, 1, tzinfo=UTC),
        datetime(1500, 1, 1, tzinfo=UTC),
        "2300-01-01",
        np.datetime64("NaT"),
    ],
)
def test_a_moment_outside_the_range_of_stamps_is_refused(moment):
    with pytest.raises(TimeError, match="outside what can be stored"):
        parse_moment(moment, START_NS)


@pytest.mark.parametrize("moment", [np.datetime64("2500-01-01"), np.datetime64("1500-01-01")])
def test_a_numpy_date_outside_the_range_of_stamps_is_refused(moment):
    with pytest.raises(TimeError, match="outside what can be stored"):
        parse_moment(moment, START_NS)


def test_a_whole_number_beyond_all_floats_is_refused():
    with pytest.raises(TimeError):
        parse_moment(10**400, START_NS)


def test_a_stamp_is_shown_as_seconds_from_the_start():
    assert format_moment(12_500_000_000, 0) == "+12.5 s"


def test_a_unix_stamp_is_shown_with_its_date():
    assert format_moment(START_NS + 10_500_000_000, START_NS) == "2003-12-10 17:52:08 UTC (+10.5 s)"


def test_a_clock_that_counts_from_power_on_has_no_date():
    assert "UTC" not in format_moment(90_000 * NS, 60_000 * NS)


def test_a_stamp_before_the_start_is_shown_with_a_minus():
    assert format_moment(-5 * NS, 0) == "-5.0 s"


def test_what_is_shown_can_be_read_back():
    assert parse_moment(format_moment(12_500_000_000, 0), 0) == 12_500_000_000
