"""Sparse storage of cells: numbering, growth, and maps that would become too large."""

from __future__ import annotations

import numpy as np
import pytest

from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.errors import ExtentError
from tempog.grid.temporal_grid import TemporalGrid
from tempog.scans.scan import Scan
from tempog.sensing.grid_spec import Extent, GridSpec
from tempog.sensing.tiles import NO_CELL, TILE, CellBox, TileIndex

SPEC = GridSpec(0.5)
FAR_TILES = [(0, 0), (-1, -1), (-1, 0), (3, -5), (100_000, 100_002), (100_001, 100_003)]


def index_of(tiles, max_cells=2**31 - 1) -> TileIndex:
    rows, cols = np.array(tiles, dtype=np.int32).reshape(-1, 2).T
    return TileIndex.from_tiles(SPEC, max_cells, rows, cols)


@pytest.mark.parametrize("tiles", [FAR_TILES[:4], FAR_TILES[4:], [(-90_000, -90_000)]])
def test_every_cell_of_a_tile_has_a_number_of_its_own_that_leads_back(tiles):
    index = index_of(tiles)
    numbers = [
        index.cell_number(row, col)
        for tile_row, tile_col in tiles
        for row in range(tile_row * TILE, tile_row * TILE + TILE)
        for col in range(tile_col * TILE, tile_col * TILE + TILE)
    ]
    assert sorted(numbers) == list(range(index.n_cells))
    rows, cols = index.rows_cols(np.array(numbers, dtype=np.int32))
    again = [index.cell_number(row, col) for row, col in zip(rows.tolist(), cols.tolist(), strict=True)]
    assert again == numbers


def test_cells_are_numbered_row_by_row_within_a_tile():
    index = index_of([(0, 0), (-1, -1)])
    assert index.cell_number(0, 0) == 0
    assert index.cell_number(0, 7) == 7
    assert index.cell_number(1, 0) == 8
    assert index.cell_number(-1, -1) == 127
    assert index.cell_number(-8, -8) == 64


@pytest.mark.parametrize("cell", [(8, 0), (0, 8), (-1, 0), (0, -1), (10**6, 10**6), (-(10**6), 0)])
def test_a_cell_of_no_tile_has_no_number(cell):
    assert index_of([(0, 0)]).cell_number(*cell) == NO_CELL


def test_an_empty_index_has_no_cells():
    index = TileIndex(SPEC, 64)
    assert index.n_cells == 0
    assert index.cell_number(0, 0) == NO_CELL
    assert index.extent.shape == (0, 0)
    assert index.to_dense(np.empty(0), np.nan).shape == (0, 0)


def test_the_extent_bounds_the_tiles_in_use():
    index = index_of([(-2, 3), (1, 4)])
    assert index.extent == Extent(-16, 24, 32, 16, 0.5)
    assert index.extent.bounds == (12.0, 20.0, -8.0, 8.0)


def test_a_dense_array_has_every_cell_at_its_place_and_fill_elsewhere():
    index = index_of(FAR_TILES[:4])
    dense = index.to_dense(np.arange(index.n_cells, dtype=np.float64), np.nan)
    extent = index.extent
    assert dense.shape == extent.shape
    for row in range(extent.n_rows):
        for col in range(extent.n_cols):
            number = index.cell_number(row + extent.row0, col + extent.col0)
            assert dense[row, col] == number if number != NO_CELL else np.isnan(dense[row, col])


def test_covering_more_keeps_the_numbers_of_tiles_that_are_there():
    index = index_of([(0, 0), (2, 1)])
    before = [index.cell_number(row, col) for row in range(-20, 40) for col in range(-20, 40)]
    for box in (CellBox(500, 507, 0, 7), CellBox(-900, -893, -80, 7), CellBox(0, 7, 3000, 3007)):
        index.cover(box, "a scan")
        assert [index.cell_number(row, col) for row in range(-20, 40) for col in range(-20, 40)] == before


def test_covering_claims_no_tile():
    index = index_of([(0, 0)])
    index.cover(CellBox(-100, 100, -100, 100), "a scan")
    assert index.n_tiles == 1
    assert index.extent.shape == (8, 8)


def test_the_bound_counts_the_rectangle_around_everything_covered():
    index = index_of([(0, 0)], max_cells=64 * 10)
    index.cover(CellBox(0, 7, 0, 79), "a scan")  # ten tiles
    with pytest.raises(ExtentError, match=r"a scan.*would stretch the map to 44 m x 4 m, 704 cells"):
        index.cover(CellBox(0, 7, 80, 80), "a scan")


def test_what_was_refused_once_is_refused_again():
    index = index_of([(0, 0)], max_cells=64 * 10)
    for _ in range(2):
        with pytest.raises(ExtentError):
            index.cover(CellBox(0, 7, 0, 800), "a scan")


def test_after_a_refusal_as_much_can_be_covered_as_before():
    index = index_of([(0, 0)], max_cells=64 * 10)
    with pytest.raises(ExtentError):
        index.cover(CellBox(0, 7, -800, 0), "a scan")
    index.cover(CellBox(0, 7, 0, 79), "a scan")
    assert index.cell_number(0, 0) == 0


@pytest.mark.parametrize(("x", "y", "cell"), [(0.0, 0.0, (0, 0)), (-0.01, 0.49, (0, -1)), (0.5, -0.5, (-1, 1))])
def test_a_cell_owns_its_lower_borders(x, y, cell):
    assert SPEC.cell_of(x, y) == cell


def test_the_centre_of_a_cell_lies_in_it():
    for row, col in [(0, 0), (-1, 5), (800_000, -800_000)]:
        (x, y), *_ = GridSpec(0.05).centres([row], [col])
        assert GridSpec(0.05).cell_of(x, y) == (row, col)


def test_an_extent_finds_points_inside_and_none_outside():
    extent = Extent(-16, 24, 32, 16, 0.5)
    assert extent.index_of(12.0, -8.0) == (0, 0)
    assert extent.index_of(19.99, 7.99) == (31, 15)
    for x, y in [(11.99, 0.0), (20.0, 0.0), (15.0, -8.01), (15.0, 8.0)]:
        assert extent.index_of(x, y) is None


# The grid as a whole.


def config(max_cells: int) -> MapConfig:
    return MapConfig(SensingConfig(max_range_m=5.0), GridConfig(resolution_m=0.05, max_cells=max_cells))


def scan_at(t: float, x: float, y: float, label: str = "") -> Scan:
    angles = np.linspace(-3, 3, 20)
    return Scan(t, (x, y, 0.1), angles, np.full(20, 2.0), label=label)


def answers(grid: TemporalGrid, t: float):
    snapshot = grid.at(t, hold=10)
    return (*snapshot, grid.n_scans, grid.n_intervals, grid.n_cells, grid.surfaces.n_slots, grid.extent)


def test_a_scan_that_would_stretch_the_map_too_far_is_named():
    grid = TemporalGrid(config(2**20))
    grid.integrate(scan_at(0.0, 0.0, 0.0))
    with pytest.raises(ExtentError, match=r"line 17 at 1\.000 s, pose \(9000, -40\).*max_cells"):
        grid.integrate(scan_at(1.0, 9000.0, -40.0, label="line 17"))


@pytest.mark.parametrize("x", [9000.0, 1e12, -1e300])
def test_a_refused_scan_leaves_the_grid_unchanged_and_usable(x):
    grid, other = TemporalGrid(config(2**20)), TemporalGrid(config(2**20))
    for each in (grid, other):
        each.integrate(scan_at(0.0, 0.3, 0.2))
    with pytest.raises(ExtentError):
        grid.integrate(scan_at(1.0, x, 0.0))
    for t in (0.0, 1.0):
        for got, wanted in zip(answers(grid, t), answers(other, t), strict=True):
            np.testing.assert_array_equal(got, wanted)
    for each in (grid, other):
        each.integrate(scan_at(2.0, 1.0, 0.2))
    for got, wanted in zip(answers(grid, 2.0), answers(other, 2.0), strict=True):
        np.testing.assert_array_equal(got, wanted)


def test_a_scan_beyond_all_coordinates_is_refused_with_the_limit():
    grid = TemporalGrid(MapConfig())
    with pytest.raises(ExtentError, match=r"pose \(1e\+12, 0\); wanted coordinates within"):
        grid.integrate(scan_at(0.0, 1e12, 0.0))


@pytest.mark.parametrize(("x", "y"), [(40_000.0, -40_000.0), (-3e6, 3e6), (5e7, 5e7)])
def test_a_map_far_from_the_origin_holds_what_one_at_the_origin_holds(x, y):
    here, there = TemporalGrid(config(2**20)), TemporalGrid(config(2**20))
    for k in range(3):
        here.integrate(scan_at(k, 0.013 + 0.1 * k, 0.017))
        there.integrate(scan_at(k, x + 0.013 + 0.1 * k, y + 0.017))
    assert there.n_cells == pytest.approx(here.n_cells, rel=0.01)
    np.testing.assert_array_equal(there.at(2.0, 10).value, here.at(2.0, 10).value)


def test_the_map_grows_in_every_direction_and_forgets_nothing():
    grid = TemporalGrid(config(2**24))
    places = [(0, 0), (60, 0), (0, 60), (-60, 0), (0, -60), (-70, -70), (70, 70)]
    for t, (x, y) in enumerate(places):
        grid.integrate(scan_at(0.5 * t, x + 0.013, y + 0.017))
    for t, (x, y) in enumerate(places):
        history = grid.history(x + 0.013, y + 0.017)  # the robot's own place was free
        assert [(start, stop) for start, stop, _ in history] == [(t * 500_000_000,) * 2]
