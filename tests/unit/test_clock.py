"""The clock check: what it mends, what it refuses, and what it says then."""

import numpy as np
import pytest

from tempog.errors import ClockError, ConfigError
from tempog.scans.clock import UNUSABLE_STAMP_NS, mend_clock, parse_clock, seconds_to_ns


def mend(stamps_s, clock="auto"):
    labels = [f"line {i + 1}" for i in range(len(stamps_s))]
    return mend_clock(seconds_to_ns(stamps_s), labels, parse_clock(clock), source="some.log")


def steady(n_scans=200, period_s=0.2, start_s=1000.0):
    return start_s + period_s * np.arange(n_scans)


def test_a_steady_clock_passes_without_a_note():
    mended = mend(steady())
    assert mended.notes == ()
    np.testing.assert_array_equal(mended.order, np.arange(200))
    assert mended.stamp_ns[1] - mended.stamp_ns[0] == 200_000_000


def test_one_scan_needs_no_clock():
    assert mend([7.0]).stamp_ns.tolist() == [7_000_000_000]


def test_a_few_small_steps_back_are_sorted_and_noted():
    stamps = steady()
    stamps[[50, 120]] -= 0.5
    mended = mend(stamps)
    assert (np.diff(mended.stamp_ns) >= 0).all()
    assert mended.order[48:52].tolist() == [50, 48, 49, 51]
    assert mended.notes[0].startswith("2 of 200 scans step back in time, by up to 0.3 s (first: line 51)")


def test_steps_back_in_more_than_one_percent_are_refused_at_the_first():
    stamps = steady()
    stamps[[50, 120, 150]] -= 0.5
    with pytest.raises(
        ClockError, match=r"some.log, line 51: stamp 1009.500000 s comes after 1009.800000 s; 3 of 200"
    ):
        mend(stamps)


def test_a_step_back_of_many_periods_is_refused_however_rare():
    stamps = steady()
    stamps[100:] -= 5
    with pytest.raises(ClockError, match="line 101"):
        mend(stamps)


def test_the_refusal_names_both_ways_out():
    with pytest.raises(ClockError, match=r"--clock sort .*--clock rate=5"):
        mend(steady()[::-1])


def test_sort_sorts_any_order():
    mended = mend(steady()[::-1], "sort")
    np.testing.assert_array_equal(mended.order, np.arange(200)[::-1])
    assert (np.diff(mended.stamp_ns) > 0).all()


def test_repeats_do_not_shorten_the_period():
    stamps = np.round(steady(1000), 1)
    stamps[500:505] = stamps[500]
    stamps[700] = stamps[699] - 0.9  # 4.5 periods of 0.2 s
    assert len(mend(stamps).notes) == 2


def test_two_scans_with_one_stamp_keep_their_order_and_are_noted():
    stamps = steady()
    stamps[31] = stamps[30]
    mended = mend(stamps)
    assert mended.order[30:32].tolist() == [30, 31]
    assert mended.notes == ("1 of 200 scans repeats an earlier stamp (first: line 32): kept in file order",)


@pytest.mark.parametrize("clock", ["auto", "sort"])
@pytest.mark.parametrize(
    ("stamps", "what"),
    [
        (np.full(50, 12.0), "stands still"),
        (np.round(steady(), 0), "rounded"),
        (np.r_[0.0, steady(50, start_s=1.6e9)], "jump of 18,51. days"),
        (np.r_[steady(50, start_s=2**32 - 10), steady(50, start_s=0.0)], "wrapped after 4294967296 s"),
        (np.r_[steady(50, start_s=4294957.0), steady(50, start_s=0.1)], "wrapped after 4294967.296 s"),
        (np.r_[steady(50, start_s=2**31 - 10), steady(50, start_s=-(2**31))], "wrapped"),
    ],
    ids=["constant", "rounded", "jump", "wrap-s", "wrap-ms", "wrap-signed"],
)
def test_stamps_that_say_too_little_are_refused_even_by_sort(clock, stamps, what):
    with pytest.raises(ClockError, match=rf"{what}(.|\n)*rate=5(.|\n)*sort cannot mend"):
        mend(stamps, clock)


@pytest.mark.parametrize("stamp", [float("nan"), float("inf"), 1e300, -9.3e9])
def test_a_stamp_beyond_int64_is_refused_with_its_line(stamp):
    stamps = steady()
    stamps[3] = stamp
    with pytest.raises(ClockError, match=r"line 4: the stamp is no usable time(.|\n)*rate=5"):
        mend(stamps)


def test_stamps_at_both_ends_of_int64_are_refused_not_overflowed():
    with pytest.raises(ClockError, match="jump"):
        mend([-9.1e9, 9.1e9])


def test_a_rate_replaces_any_stamps_in_file_order():
    mended = mend([np.nan, 50.0, 3.0, 1e300], "rate=5")
    assert mended.stamp_ns.tolist() == [50_000_000_000 + i * 200_000_000 for i in range(4)]
    assert mended.order.tolist() == [0, 1, 2, 3]
    assert "replaced" in mended.notes[0]


def test_a_rate_starts_at_zero_without_any_usable_stamp():
    assert mend([np.nan, np.inf], "rate=10").stamp_ns.tolist() == [0, 100_000_000]


def test_a_rate_does_not_drift():
    assert mend(np.zeros(100_001), "rate=30").stamp_ns[-1] == round(100_000 / 30 * 1e9)


def test_a_rate_of_centuries_is_refused():
    with pytest.raises(ConfigError, match="centuries"):
        mend(np.zeros(100), "rate=1e-9")


@pytest.mark.parametrize("clock", ["rate=0", "rate=-5", "rate=nan", "rate=inf", "rate=", "rate=x", "5", "", "rate"])
def test_an_unknown_policy_or_rate_is_refused(clock):
    with pytest.raises(ConfigError, match="rate=5"):
        parse_clock(clock)


def test_seconds_become_nearest_nanoseconds():
    assert seconds_to_ns([0.227623, -1.5]).tolist() == [227_623_000, -1_500_000_000]
    assert seconds_to_ns([np.nan])[0] == UNUSABLE_STAMP_NS
