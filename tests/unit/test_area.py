"""A rectangle of a history answers as the whole history does there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tempog import build_grid, find_objects, map_dynamics, open_map, save_map
from tempog.errors import ConfigError, EmptyWindowError
from tempog.simulation import corridor, simulate


@pytest.fixture(scope="module")
def grid():
    return build_grid(simulate(corridor(), duration_s=120.0).scans)


def part_of(dense, whole, area):
    row, col = area.extent.row0 - whole.extent.row0, area.extent.col0 - whole.extent.col0
    return dense[row : row + area.extent.n_rows, col : col + area.extent.n_cols]


def test_states_dynamics_and_histories_are_those_of_the_whole(grid) -> None:
    area = grid.area(5.0, 9.0, 1.9, 4.0)
    assert 0 < area.n_intervals < grid.n_intervals / 2
    for t in ("+1", "+40", "+110"):
        np.testing.assert_array_equal(
            area.at(t, hold=math.inf).value, part_of(grid.at(t, math.inf).value, grid, area)
        )
    np.testing.assert_array_equal(map_dynamics(area), part_of(map_dynamics(grid), grid, area))
    for x, y in ((6.98, 2.53), (7.4, 3.2), (5.02, 2.0)):
        mine, whole = area.history(x, y), grid.history(x, y)
        assert list(mine) == list(whole)
    assert len(area.history(1.0, 2.0)) == 0


def test_a_period_of_an_area_is_an_area_of_the_period(grid) -> None:
    one, other = grid.window("+20", "+60").area(5, 9, 2, 4), grid.area(5, 9, 2, 4).window("+20", "+60")
    assert one.n_intervals == other.n_intervals < grid.area(5, 9, 2, 4).n_intervals
    np.testing.assert_array_equal(map_dynamics(one), map_dynamics(other))


def test_the_area_of_everything_holds_the_same_objects(grid, tmp_path) -> None:
    full = find_objects(grid)
    assert len(full.objects) == 1
    for history in (grid, open_map(save_map(grid, tmp_path / "c.tempog"))):
        for bounds in (grid.extent.bounds, (2.0, 12.0, -2.0, 8.0)):
            found = find_objects(history.area(*bounds))
            assert [one.cells.tolist() for one in found.configurations] == [
                one.cells.tolist() for one in full.configurations
            ]
            assert [one.timeline for one in found.objects] == [one.timeline for one in full.objects]


def test_what_is_no_area_is_refused(grid) -> None:
    for wrong in ((1, 0, 0, 1), (0, 1, 1, 0), (0, math.nan, 0, 1), (0, math.inf, 0, 1)):
        with pytest.raises(ConfigError, match="no rectangle"):
            grid.area(*wrong)
    with pytest.raises(EmptyWindowError, match="the map covers"):
        grid.area(500, 501, 0, 1)
