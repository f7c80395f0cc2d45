"""The paper's time index as a structure of its own; its agreement with the grid is tested in properties."""

from __future__ import annotations

import pytest

from tempog.errors import ConfigError, TimeError
from tempog.grid.time_index import Entry, TimeIndex

BORDERS = [0, 5, 10, 12, 20, 30, 35, 36, 44]


@pytest.fixture
def fig_1():
    """The tree of Fig. 1; its sixth interval is null."""
    index = TimeIndex(order=3)
    for k in range(8):
        index.append(BORDERS[k], BORDERS[k + 1], None if k == 5 else f"d{k + 1}")
    return index


def test_the_tree_of_fig_1_is_found_as_it_was_put_in(fig_1):
    assert [entry.value for entry in fig_1] == ["d1", "d2", "d3", "d4", "d5", None, "d7", "d8"]
    assert len(fig_1) == 8


@pytest.mark.parametrize(
    ("t", "value"),
    [(-1, None), (0, "d1"), (4, "d1"), (15, "d4"), (32, None), (35, "d7"), (40, "d8"), (44, "d8"), (45, None)],
)
def test_a_moment_is_answered_by_the_interval_that_holds_it(fig_1, t, value):
    assert fig_1.at(t) == value


def test_at_a_shared_border_the_later_interval_counts(fig_1):
    assert fig_1.at(12) == "d4"


def test_a_window_gives_every_interval_that_shares_a_moment_with_it(fig_1):
    assert [entry.value for entry in fig_1.window(11, 21)] == ["d3", "d4", "d5"]


def test_a_window_includes_both_its_ends(fig_1):
    assert [entry.value for entry in fig_1.window(12, 20)] == ["d3", "d4", "d5"]


def test_a_window_before_or_after_everything_is_empty(fig_1):
    assert list(fig_1.window(-9, -1)) == []
    assert list(fig_1.window(45, 99)) == []


def test_a_null_interval_is_given_by_a_window(fig_1):
    assert Entry(30, 35, None) in list(fig_1.window(31, 32))


def test_time_between_intervals_has_no_value():
    index = TimeIndex()
    index.append(0, 5, "a")
    index.append(9, 12, "b")
    assert index.at(7) is None
    assert list(index.window(6, 8)) == []


def test_an_empty_index_has_no_value_and_no_last_interval():
    index = TimeIndex()
    assert (index.at(0), index.last, len(index), list(index), index.depth) == (None, None, 0, [], 1)
    assert list(index.window(0, 10)) == []


def test_extending_moves_the_end_of_the_last_interval():
    index = TimeIndex()
    index.append(0, 0, "a")
    index.extend(8)
    assert index.last == Entry(0, 8, "a")
    assert index.at(8) == "a"


def test_extending_an_empty_index_is_refused():
    with pytest.raises(TimeError, match="extended"):
        TimeIndex().extend(1)


def test_extending_backwards_is_refused_and_changes_nothing():
    index = TimeIndex()
    index.append(0, 5, "a")
    with pytest.raises(TimeError, match="extended"):
        index.extend(4)
    assert index.last == Entry(0, 5, "a")


def test_an_interval_that_ends_before_it_starts_is_refused():
    with pytest.raises(TimeError, match="ends before it starts"):
        TimeIndex().append(5, 4, "a")


def test_an_interval_that_starts_before_the_last_one_ends_is_refused_and_changes_nothing():
    index = TimeIndex()
    index.append(0, 5, "a")
    with pytest.raises(TimeError):
        index.append(4, 9, "b")
    assert list(index) == [Entry(0, 5, "a")]


def test_intervals_of_one_moment_may_share_it():
    index = TimeIndex(order=3)
    for k in range(10):
        index.append(5, 5, k)
    assert index.at(5) == 9
    assert [entry.value for entry in index.window(5, 5)] == list(range(10))


@pytest.mark.parametrize("order", [2, 1, 0, -3])
def test_an_order_below_three_is_refused(order):
    with pytest.raises(ConfigError, match="order"):
        TimeIndex(order)


@pytest.mark.parametrize(("n_intervals", "depth"), [(1, 1), (3, 1), (4, 2), (9, 2), (10, 3), (27, 3), (28, 4)])
def test_the_tree_grows_a_level_when_full(n_intervals, depth):
    index = TimeIndex(order=3)
    for k in range(n_intervals):
        index.append(k, k, k)
    assert index.depth == depth
