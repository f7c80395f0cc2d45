"""What the surface model says, and keeps quiet about, on scans made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fed_grid import as_dict
from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.grid.temporal_grid import TemporalGrid
from tempog.scans.scan import Scan

RESOLUTION_M = 0.05
HALF_DIAGONAL_M = RESOLUTION_M / math.sqrt(2)  # a cell's centre may lie so far beyond a beam's end in it
INF = math.inf


def new_grid(**sensing) -> TemporalGrid:
    return TemporalGrid(MapConfig(SensingConfig(**sensing), GridConfig(RESOLUTION_M, gap_s=100)))


def said_by(grid: TemporalGrid, scan: Scan) -> tuple[set, set]:
    """The cells that `scan` calls a hit, and those it calls free."""
    statements = grid._mapper.sensor.sense(scan, grid.tiles, grid.surfaces)
    rows, cols = (place.tolist() for place in grid.tiles.rows_cols(statements.cells))
    said = list(zip(rows, cols, statements.prob > 0.5, strict=True))
    return {(row, col) for row, col, hit in said if hit}, {(row, col) for row, col, hit in said if not hit}


def scan_of(points, origin=(0.01, 0.01), **kwargs) -> Scan:
    """A scan whose beams end at `points`, in this order."""
    x, y = origin
    angles = [math.atan2(py - y, px - x) for px, py in points]
    ranges = [math.hypot(px - x, py - y) for px, py in points]
    return Scan(0.0, (x, y, 0.0), angles, ranges, **kwargs)


def fan(ranges, **kwargs) -> Scan:
    """A fan of beams from (0.01, 0.013), 0.3 rad apart, with these readings."""
    return Scan(0.0, (0.01, 0.013, 0.02), 0.3 * np.arange(len(ranges)), ranges, **kwargs)


def farthest_free_m(free: set, angle: float) -> float:
    """How far from (0.01, 0.013) the centres of free cells reach in the direction of a beam of `fan`."""
    reach = 0.0
    for row, col in free:
        x, y = (col + 0.5) * RESOLUTION_M - 0.01, (row + 0.5) * RESOLUTION_M - 0.013
        if abs(math.atan2(y, x) - angle) < 0.1:
            reach = max(reach, math.hypot(x, y))
    return reach


def distance_m(cell, x, y) -> float:
    """From a point to the nearest point of a cell."""
    row, col = cell
    off_x = max(col * RESOLUTION_M - x, x - (col + 1) * RESOLUTION_M, 0.0)
    off_y = max(row * RESOLUTION_M - y, y - (row + 1) * RESOLUTION_M, 0.0)
    return math.hypot(off_x, off_y)


# Near a surface nothing is free.


def wall_seen_at_a_low_angle() -> Scan:
    """Along a wall at y = 0.512, from 0.2 m beside it: hits are up to 0.3 m apart, beams cross its cells."""
    return scan_of([(x, 0.512) for x in (1.0, 1.2, 1.4, 1.6, 1.85, 2.1, 2.4, 2.7)], origin=(0.01, 0.31))


WALL_ROW = 10
WALL_COLS = range(math.floor(1.0 / RESOLUTION_M), math.floor(2.7 / RESOLUTION_M) + 1)


def test_a_grazed_wall_is_called_free_by_the_literal_model():
    _, free = said_by(new_grid(evidence="literal"), wall_seen_at_a_low_angle())
    assert len(free & {(WALL_ROW, col) for col in WALL_COLS}) > 5


def test_a_grazed_wall_is_not_called_free_by_the_surface_model():
    hits, free = said_by(new_grid(), wall_seen_at_a_low_angle())
    assert len(hits) == 8
    assert not free & {(WALL_ROW, col) for col in WALL_COLS}
    assert free


# Hits all around, off the lattice; the beams to some of them pass close to others.
HITS = [
    (1.023, 0.607),
    (2.007, 1.312),
    (2.003, 0.631),
    (1.613, 0.211),
    (0.508, 0.417),
    (1.411, -0.703),
    (0.807, 1.414),
    (2.21, 1.03),
]


@pytest.mark.parametrize("protect_m", [0.0, 0.07, 0.1, 0.23])
def test_no_cell_within_protect_m_of_a_hit_is_free(protect_m):
    _, free = said_by(new_grid(protect_m=protect_m, bridge_m=0, free_margin_m=0), scan_of(HITS))
    assert min(distance_m(cell, *point) for cell in free for point in HITS) > protect_m


@pytest.mark.parametrize("protect_m", [0.0, 0.07, 0.1, 0.23])
def test_a_cell_beyond_protect_m_of_all_hits_is_free_as_in_the_literal_model(protect_m):
    _, literal = said_by(new_grid(evidence="literal"), scan_of(HITS))
    _, free = said_by(new_grid(protect_m=protect_m, bridge_m=0, free_margin_m=0), scan_of(HITS))
    near = {cell for cell in literal if min(distance_m(cell, *point) for point in HITS) <= protect_m}
    assert free == literal - near
    assert bool(near) == (protect_m > 0)


# Sparse hits in line are one surface.

GAP_CELL = (40, 5)  # midway between the hits at x = 0.01 and x = 0.51, on the wall y = 2.02
THROUGH = (0.54, 4.05)  # a beam to here crosses the wall in that cell


def passes_between(third, **sensing) -> bool:
    """Whether a beam between two hits frees the gap between them, given the hit after them."""
    points = [(0.01, 2.02), (0.51, 2.02), third, THROUGH]
    _, free = said_by(new_grid(**sensing), scan_of(points))
    assert (60, 8) in free or (59, 8) in free or (59, 7) in free  # it went on behind the wall
    return GAP_CELL in free


def test_the_gap_between_sparse_hits_in_line_is_not_freed():
    assert not passes_between(third=(1.01, 2.02))


def test_the_gap_between_hits_not_in_line_with_a_third_is_freed():
    assert passes_between(third=(1.01, 2.42))


def test_a_third_hit_counts_as_in_line_within_collinear_m():
    assert not passes_between(third=(1.01, 2.10), collinear_m=0.1)
    assert passes_between(third=(1.01, 2.10), collinear_m=0.07)


def test_a_third_hit_before_the_two_counts_as_one_after_them():
    points = [(-0.49, 2.02), (0.01, 2.02), (0.51, 2.02), THROUGH]
    _, free = said_by(new_grid(), scan_of(points))
    assert GAP_CELL not in free


def test_two_hits_alone_are_not_bridged():
    _, free = said_by(new_grid(), scan_of([(0.01, 2.02), (0.51, 2.02), THROUGH]))
    assert GAP_CELL in free


@pytest.mark.parametrize(("bridge_m", "freed"), [(0.51, False), (0.49, True)])
def test_a_gap_is_bridged_up_to_bridge_m(bridge_m, freed):
    assert passes_between(third=(1.01, 2.02), bridge_m=bridge_m) is freed


def test_a_bridge_protects_every_cell_along_it():
    # beams to far behind pass the whole length of the bridged wall
    wall = [(0.01, 2.02), (0.91, 2.02), (1.81, 2.02)]
    behind = [(2 * x, 4.03) for x in np.arange(0.05, 1.8, 0.02)]
    _, literal = said_by(new_grid(evidence="literal"), scan_of(wall + behind))
    _, free = said_by(new_grid(), scan_of(wall + behind))
    row = {(40, col) for col in range(1, 36)}
    assert row - {(40, 18)} <= literal
    assert not free & row


# Free only well before the beam's end.


@pytest.mark.parametrize("free_margin_m", [0.0, 0.12, 0.3])
def test_a_cell_is_free_only_if_the_beam_leaves_it_a_margin_before_its_end(free_margin_m):
    scan = Scan(0.0, (0.01, 0.02, 0.0), [0.0], [2.02])
    hits, free = said_by(new_grid(free_margin_m=free_margin_m, protect_m=0), scan)
    assert hits == {(0, 40)}
    assert free == {(0, col) for col in range(40) if (col + 1) * RESOLUTION_M - 0.01 <= 2.02 - free_margin_m}


def test_a_beam_beyond_max_range_frees_up_to_there_without_a_margin():
    scan = Scan(0.0, (0.01, 0.02, 0.0), [0.0], [5.0])
    hits, free = said_by(new_grid(max_range_m=2.02), scan)
    assert hits == set()
    assert free == {(0, col) for col in range(40)}


# A known surface is gone only for beams that cross it.

SURFACE_CELL = (0, 20)  # its surface is the line x = 1.02, hit around y = 0.010


def grid_with_surface(n_hits: int = 5, **sensing) -> TemporalGrid:
    """A grid that knows a short vertical surface in one cell, within about a centimetre of (1.02, 0.010)."""
    grid = new_grid(protect_m=0, free_margin_m=0.1, bridge_m=0, **sensing)
    for k in range(n_hits):
        said_by(grid, scan_of([(1.02, 0.006 + 0.002 * k)], origin=(0.01, 0.011)))
    return grid


def frees_surface(grid: TemporalGrid, start, end) -> bool:
    _, free = said_by(grid, scan_of([end], origin=start))
    assert free  # the beam says something
    return SURFACE_CELL in free


def test_a_beam_that_crosses_the_known_surface_frees_its_cell():
    assert frees_surface(grid_with_surface(), (0.01, 0.010), (2.0, 0.010))


def test_a_beam_that_passes_beside_the_known_surface_says_nothing():
    assert not frees_surface(grid_with_surface(), (0.01, 0.040), (2.0, 0.040))


def test_a_surface_reaches_a_few_standard_deviations_of_its_hits():
    # standard deviation of the five hits: 2.8 mm; 1.8 of them and 3 mm are 8.1 mm
    assert frees_surface(grid_with_surface(), (0.01, 0.0175), (2.0, 0.0175))
    assert not frees_surface(grid_with_surface(), (0.01, 0.0185), (2.0, 0.0185))


def test_without_a_known_surface_any_beam_through_the_cell_frees_it():
    assert frees_surface(grid_with_surface(n_hits=3), (0.01, 0.040), (2.0, 0.040))


def test_a_surface_is_known_from_surface_min_hits_on():
    assert frees_surface(grid_with_surface(n_hits=5, surface_min_hits=6), (0.01, 0.040), (2.0, 0.040))
    assert not frees_surface(grid_with_surface(n_hits=6, surface_min_hits=6), (0.01, 0.040), (2.0, 0.040))


@pytest.mark.parametrize("clear_behind_m", [0.15, 0.3])
def test_a_beam_that_ends_too_close_behind_the_known_surface_says_nothing(clear_behind_m):
    for off, frees in ((-0.02, False), (0.02, True)):
        grid = grid_with_surface(clear_behind_m=clear_behind_m)
        assert frees_surface(grid, (0.01, 0.010), (1.02 + clear_behind_m + off, 0.010)) == frees


def test_how_far_behind_the_known_surface_a_beam_ends_is_measured_square_to_it():
    # thirty degrees off the line x = 1.02, through the hits: 0.3 m along the beam are 0.15 m square to the line
    def end(metres: float) -> tuple[float, float]:
        return (1.02 + metres * math.sin(math.pi / 6), 0.01 + metres * math.cos(math.pi / 6))

    for behind, frees in ((0.3, False), (0.5, True)):
        assert frees_surface(grid_with_surface(clear_behind_m=0.2), end(-1.0), end(behind)) == frees


def test_a_beam_along_the_known_surface_says_nothing():
    # fifteen degrees off the line x = 1.02, crossing it right at the hits
    lean = math.tan(math.radians(15))
    assert not frees_surface(grid_with_surface(), (1.02 - lean, -0.99), (1.02 + lean, 1.01))


def test_a_beam_at_twenty_degrees_to_the_known_surface_frees_its_cell():
    lean = math.tan(math.radians(20))
    assert frees_surface(grid_with_surface(), (1.02 - lean, -0.99), (1.02 + lean, 1.01))


@pytest.mark.parametrize("across_first", [True, False])
def test_of_two_beams_through_a_known_surface_the_crossing_one_counts_in_either_order(across_first):
    across, beside = (2.0, 0.010), (2.0, 0.055)  # from (0.01, 0.010); the second is at y = 0.033 by then
    order = [across, beside] if across_first else [beside, across]
    assert not frees_surface(grid_with_surface(), (0.01, 0.010), beside)
    _, free = said_by(grid_with_surface(), scan_of(order, origin=(0.01, 0.010)))
    assert SURFACE_CELL in free


@pytest.mark.parametrize("x0", [0.0, 40_000.0, -40_000.0])
def test_surfaces_of_any_direction_are_crossed_head_on_and_passed_beside(x0):
    for degrees in range(0, 180, 15):
        along = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        across = -along[1], along[0]
        grid = new_grid(protect_m=0, bridge_m=0)
        middle = x0 + 0.525, 0.525
        cell = grid.tiles.spec.cell_of(*middle)
        start = middle[0] - 0.4 * across[0], middle[1] - 0.4 * across[1]
        for k in range(-2, 3):  # hits along a line of 8 mm
            point = middle[0] + 0.002 * k * along[0], middle[1] + 0.002 * k * along[1]
            said_by(grid, scan_of([point], origin=start))
        for aside, freed in ((0.0, True), (0.016, False)):
            ends = [
                (
                    middle[0] + aside * along[0] + way * across[0],
                    middle[1] + aside * along[1] + way * across[1],
                )
                for way in (-0.4, 0.6)
            ]
            _, free = said_by(grid, scan_of([ends[1]], origin=ends[0]))
            assert (cell in free) is freed, (degrees, aside)


# No-returns.


@pytest.mark.parametrize("evidence", ["surface", "literal"])
def test_one_drop_out_frees_nothing_under_neighbours(evidence):
    _, free = said_by(new_grid(evidence=evidence, max_range_m=6), fan([2.0, INF, 2.0]))
    assert farthest_free_m(free, 0.32) < 0.5  # where the beams beside it pass


def test_the_first_and_last_beam_of_a_run_free_nothing_under_neighbours():
    _, free = said_by(new_grid(max_range_m=6), fan([2.0, INF, INF, INF, 2.0]))
    assert farthest_free_m(free, 0.32) < 0.5
    assert farthest_free_m(free, 0.92) < 0.5
    assert farthest_free_m(free, 0.62) > 1.9


@pytest.mark.parametrize(("before", "after"), [(2.0, 3.0), (3.0, 2.0)])
def test_a_run_of_no_returns_reaches_no_farther_than_the_nearer_return_beside_it(before, after):
    _, free = said_by(new_grid(max_range_m=6), fan([before, INF, INF, INF, after]))
    assert 1.9 < farthest_free_m(free, 0.62) <= 2.0 + HALF_DIAGONAL_M


def test_a_run_of_no_returns_at_the_edge_reaches_as_far_as_its_one_neighbour():
    _, free = said_by(new_grid(max_range_m=6), fan([INF, INF, INF, 2.0]))
    assert 1.9 < farthest_free_m(free, 0.02) <= 2.0 + HALF_DIAGONAL_M
    _, free = said_by(new_grid(max_range_m=6), fan([2.0, INF, INF, INF]))
    assert 1.9 < farthest_free_m(free, 0.92) <= 2.0 + HALF_DIAGONAL_M


def test_the_literal_model_frees_a_run_of_no_returns_to_max_range():
    _, free = said_by(new_grid(evidence="literal", max_range_m=6), fan([2.0, INF, INF, INF, 3.0]))
    assert 5.9 < farthest_free_m(free, 0.62) <= 6.0 + HALF_DIAGONAL_M


@pytest.mark.parametrize("evidence", ["surface", "literal"])
def test_no_returns_everywhere_free_to_max_range(evidence):
    _, free = said_by(new_grid(evidence=evidence, max_range_m=6), fan([INF, INF, INF, INF]))
    for beam in range(4):
        assert 5.9 < farthest_free_m(free, 0.02 + 0.3 * beam) <= 6.0 + HALF_DIAGONAL_M


def test_no_returns_free_no_farther_than_the_sensor_reaches():
    _, free = said_by(new_grid(max_range_m=6), fan([4.0, 5.0, INF, 4.0], max_range=4.0))
    for beam in range(4):
        assert 3.9 < farthest_free_m(free, 0.02 + 0.3 * beam) <= 4.0 + HALF_DIAGONAL_M


def test_always_frees_a_single_drop_out_up_to_the_returns_beside_it():
    _, free = said_by(new_grid(max_range_m=6, no_return="always"), fan([2.0, INF, 3.0]))
    assert 1.9 < farthest_free_m(free, 0.32) <= 2.0 + HALF_DIAGONAL_M


def test_never_frees_nothing_for_no_returns():
    hits, free = said_by(new_grid(max_range_m=6, no_return="never"), fan([INF, INF, INF, INF]))
    assert (hits, free) == (set(), set())


@pytest.mark.parametrize("nothing", [math.nan, -INF, 0.0, -1.0])
def test_a_reading_that_says_nothing_is_no_no_return(nothing):
    # beside it, a beam without return has not two neighbours without return
    _, free = said_by(new_grid(max_range_m=6), fan([2.0, INF, nothing, INF, 2.0]))
    for beam in (1, 2, 3):
        assert farthest_free_m(free, 0.02 + 0.3 * beam) < 0.5


@pytest.mark.parametrize("nothing", [math.nan, -INF, 0.0, -1.0])
def test_a_scan_of_readings_that_say_nothing_says_nothing(nothing):
    assert said_by(new_grid(no_return="always"), fan([nothing] * 4)) == (set(), set())


# A stray hit counts for the surface beside it.


def grid_with_wall(n_hits: int, x: float = 1.02, **sensing) -> TemporalGrid:
    """A grid whose cell (0, 20) was hit so often."""
    grid = new_grid(**sensing)
    for _ in range(n_hits):
        said_by(grid, scan_of([(x, 0.02)]))
    return grid


def test_a_stray_hit_counts_for_the_surface_beside_it():
    hits, _ = said_by(grid_with_wall(8), scan_of([(1.07, 0.02)]))  # 2 cm into the next cell
    assert hits == {(0, 20)}


def test_a_hit_farther_than_snap_m_from_the_surface_counts_where_it_fell():
    hits, _ = said_by(grid_with_wall(8), scan_of([(1.085, 0.02)]))
    assert hits == {(0, 21)}


def test_a_stray_hit_counts_where_it_fell_with_snap_m_zero():
    hits, _ = said_by(grid_with_wall(8, snap_m=0), scan_of([(1.07, 0.02)]))
    assert hits == {(0, 21)}


def test_a_hit_beside_a_cell_with_few_hits_counts_where_it_fell():
    hits, _ = said_by(grid_with_wall(3), scan_of([(1.07, 0.02)]))
    assert hits == {(0, 21)}


def test_a_cell_with_many_hits_of_its_own_is_no_stray():
    grid = grid_with_wall(8)
    for _ in range(3):
        said_by(grid, scan_of([(1.07, 0.02)]))
    hits, _ = said_by(grid, scan_of([(1.07, 0.02)]))
    assert hits == {(0, 21)}


def test_a_stray_hit_point_is_remembered_in_the_cell_where_it_fell():
    grid = grid_with_wall(8)
    said_by(grid, scan_of([(1.07, 0.02)]))
    slot = grid.surfaces.slot_of_cell[grid.tiles.cell_number(0, 21)]
    assert grid.surfaces.hit_count[slot] == 1


def test_a_stray_hit_in_a_tile_that_nobody_saw_yet_is_remembered_in_its_own_cell():
    # the wall's cell (0, 23) is the last of its tile; the stray hit falls into (0, 24), the first of the next
    grid = grid_with_wall(8, x=1.18)
    said_by(grid, scan_of([(1.21, 0.02)]))
    used = grid.surfaces.cell_of_slot[: grid.surfaces.n_slots]
    assert used.min() >= 0
    slot = grid.surfaces.slot_of_cell[grid.tiles.cell_number(0, 24)]
    assert grid.surfaces.hit_count[slot] == 1


@pytest.mark.parametrize("x0", [0.0, -40_000.0])
def test_strays_are_found_on_every_side_and_corner(x0):
    for side_x in (-1, 0, 1):
        for side_y in (-1, 0, 1):
            grid = new_grid()
            middle = x0 + 1.025, 1.025
            for _ in range(8):
                said_by(grid, scan_of([middle], origin=(x0 + 0.01, 0.01)))
            stray = middle[0] + 0.04 * side_x, middle[1] + 0.04 * side_y
            hits, _ = said_by(grid, scan_of([stray], origin=(x0 + 0.01, 0.01)))
            assert hits == {grid.tiles.spec.cell_of(*middle)}


# Hit points.


@pytest.mark.parametrize("evidence", ["surface", "literal"])
@pytest.mark.parametrize("x0", [0.0, -123.4, 40_000.0])
def test_count_mean_and_covariance_of_hit_points_are_numpys(evidence, x0):
    rng = np.random.default_rng(7)
    grid = new_grid(evidence=evidence)
    points = []
    for k in range(20):
        pose = x0 + 0.003 * k, 0.01 * k, 0.1 * k
        angles = rng.uniform(-3, 3, 60)
        ranges = rng.normal(0.3, 0.05, 60).astype(np.float32)
        said_by(grid, Scan(0.0, pose, angles, ranges))
        directions = pose[2] + angles
        reach = ranges.astype(np.float64)
        points.append(np.stack([pose[0] + reach * np.cos(directions), pose[1] + reach * np.sin(directions)], axis=-1))
    points = np.concatenate(points)
    of_cell = {}
    for x, y in points:
        of_cell.setdefault(grid.tiles.spec.cell_of(x, y), []).append((x, y))
    surfaces = grid.surfaces
    assert surfaces.n_slots == len(of_cell)
    assert max(len(found) for found in of_cell.values()) > 20
    for (row, col), found in of_cell.items():
        slot = surfaces.slot_of_cell[grid.tiles.cell_number(row, col)]
        off = np.array(found) - grid.tiles.spec.centres([row], [col])
        covariance = np.cov(off, rowvar=False, bias=True) if len(found) > 1 else np.zeros((2, 2))
        assert surfaces.hit_count[slot] == len(found)
        np.testing.assert_allclose(surfaces.moments[slot, :2], off.mean(axis=0), atol=2e-8)
        wanted = [covariance[0, 0], covariance[0, 1], covariance[1, 1]]
        np.testing.assert_allclose(surfaces.moments[slot, 2:], wanted, rtol=1e-4, atol=1e-9)


def test_cells_that_were_never_hit_have_no_hit_points():
    grid = new_grid()
    hits, free = said_by(grid, scan_of([(1.0, 0.4)]))
    has_slot = as_dict(grid.tiles.to_dense(grid.surfaces.slot_of_cell, -1), grid.extent, unknown=-1)
    assert has_slot.keys() == hits
    assert free


def test_a_scan_is_not_judged_by_its_own_hit_points():
    # four hits in a cell in one scan; in the same scan another beam passes beside them
    near = [(1.02, 0.006 + 0.002 * k) for k in range(5)]
    grid = new_grid(protect_m=0, bridge_m=0)
    hits, free = said_by(grid, scan_of([*near, (2.0, 0.07)], origin=(0.01, 0.011)))
    assert SURFACE_CELL in hits  # the hit wins
    assert not hits & free
