"""How far surfaces were seen displaced: against poses that are wrong by known amounts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tempog import GridConfig, MapConfig, Scan, TemporalGrid, build_grid, open_map, pose_consistency, save_map
from tempog.errors import ConfigError
from tempog.simulation import PoseError, load_world, simulate
from tempog.simulation.simulate import pose_errors, take_scans


@pytest.fixture(scope="module", params=[("rooms", 8), ("hallway", 40)], ids=["rooms", "crowd"])
def drives(request):
    """Scans of one drive with poses that drift by so many metres, and a sixth of a degree for each centimetre."""
    world, people = request.param
    driven = simulate(load_world(world), duration_s=300.0, seed=12, people=people)
    laser = driven.world.laser
    drives = {}
    for drift_m in (0.0, 0.01, 0.03, 0.05):
        error = PoseError(drift_m=drift_m, drift_rad=math.radians(drift_m * 100 / 6))
        told = driven.poses + pose_errors(error, driven.t, np.random.default_rng(2))
        drives[drift_m] = take_scans(laser, driven.t, told, driven.distances, np.random.default_rng(3))
    return drives


def mapped(scans, resolution_m=0.05):
    return build_grid(scans, MapConfig(grid=GridConfig(resolution_m=resolution_m)))


@pytest.mark.parametrize("resolution_m", [0.05, 0.1])
def test_perfect_poses_agree_and_drifting_ones_do_not(drives, resolution_m: float) -> None:
    spreads = {}
    for drift_m, scans in drives.items():
        answer = pose_consistency(mapped(scans, resolution_m))
        spreads[drift_m] = answer.spread_m
        assert answer.quarter_m >= answer.spread_m
        assert answer.consistent == (drift_m <= 0.01), (drift_m, answer)
        assert (answer.warning is None) == answer.consistent
    assert spreads[0.0] <= 0.002
    assert 0.003 < spreads[0.01] < 0.018
    assert 0.018 <= spreads[0.03] <= 0.045
    assert 0.03 <= spreads[0.05] <= 0.075


def test_a_saved_map_says_the_same(drives, tmp_path) -> None:
    grid = mapped(drives[0.03][:1000])
    saved = open_map(save_map(grid, tmp_path / "m.tempog"))
    got, wanted = pose_consistency(saved), pose_consistency(grid)
    assert got.n_pieces == wanted.n_pieces
    # A saved map has the hits in the order of cells, a grid in that of first hits: sums may round differently.
    assert (got.spread_m, got.quarter_m) == pytest.approx((wanted.spread_m, wanted.quarter_m), rel=1e-12)


def wall_scan(t: float, wall_y: float, robot_y: float, x: float) -> Scan:
    """A scan of a long wall at `wall_y`, from one side or the other."""
    angles = np.radians(np.linspace(-60, 60, 121)) + (math.pi / 2 if wall_y > robot_y else -math.pi / 2)
    return Scan(t, (x, robot_y, 0.0), angles, (wall_y - robot_y) / np.sin(angles))


@pytest.mark.parametrize("between_m", [0.0, 0.04, 0.08, 0.15])
def test_two_passes_see_one_wall_so_far_apart(between_m: float) -> None:
    grid = TemporalGrid(scan_period_s=0.1)
    for k in range(200):
        displaced_m = between_m * (k >= 100)
        grid.integrate(wall_scan(k / 10 + 60 * (k >= 100), 3.013 + displaced_m, 1.0, (k % 100) / 20))
    answer = pose_consistency(grid)
    # Half of the hits lie half the distance to either side: that is their standard deviation.
    expected_m = math.sqrt(max((between_m / 2) ** 2 - 0.01**2, 0.0))
    assert answer.spread_m == pytest.approx(expected_m, abs=0.004 + 0.1 * expected_m)


def test_walls_seen_far_apart_are_told_by_those_who_looked_through(drives) -> None:
    """Halfway the poses jump, as after a wrong loop closure: farther than surfaces are compared."""
    scans, jump_m = drives[0.0][:2000], 0.6
    late = [
        Scan(
            0.0,
            (one.x + 0.6 * jump_m, one.y + 0.8 * jump_m, one.theta),
            one.angles,
            one.ranges,
            one.max_range,
            stamp_ns=one.stamp_ns,
        )
        for one in scans[len(scans) // 2 :]
    ]
    assert pose_consistency(mapped(scans)).doubled_share < 0.03
    answer = pose_consistency(mapped(scans[: len(scans) // 2] + late))
    assert 0.12 < answer.doubled_share < 0.6
    assert answer.consistent is False
    assert "of the walls stand where other passes looked through" in answer.warning


def test_both_faces_of_a_wall_are_two_surfaces() -> None:
    for thick_m in (0.08, 0.12, 0.2):
        grid = TemporalGrid(scan_period_s=0.1)
        for k in range(100):
            grid.integrate(wall_scan(k / 10, 3.013, 1.0, k / 20))
        for k in range(100):
            grid.integrate(wall_scan(60 + k / 10, 3.013 + thick_m, 5.0, k / 20))
        answer = pose_consistency(grid)
        assert answer.consistent, (thick_m, answer)
        assert answer.quarter_m < 0.01, (thick_m, answer)


def test_too_little_is_no_verdict_and_a_window_is_refused() -> None:
    grid = TemporalGrid()
    assert pose_consistency(grid) == (None, None, 0, None)
    grid.integrate(wall_scan(0.0, 3.0, 1.0, 0.0))
    answer = pose_consistency(grid)
    assert (answer.spread_m, answer.consistent, answer.warning) == (None, None, None)
    assert "too little" in str(answer)
    assert answer.to_dict()["consistent"] is None
    for part in (grid.window(), grid.area(-1, 1, 0, 4)):
        with pytest.raises(ConfigError, match="whole map"):
            pose_consistency(part)
