"""Scans of a room where something moves, and whether two histories answer alike."""

from __future__ import annotations

import numpy as np

from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.grid.temporal_grid import TemporalGrid
from tempog.scans.scan import Scan
from tempog.store.manifest import read_manifest

CONFIG = MapConfig(SensingConfig(max_range_m=6.0), GridConfig(0.1, gap_s=1.0, tolerance=0.3))
PERIOD_S = 0.1
ANGLES = np.linspace(-np.pi, np.pi, 40, endpoint=False)


def room_scans(n_scans: int, start_s: float = 100.0, seed: int = 0) -> list[Scan]:
    """A robot in a room of about 6 m by 4 m whose walls come and go in places."""
    rng = np.random.default_rng(seed)
    walls = np.minimum(3.0 / np.maximum(abs(np.cos(ANGLES)), 1e-3), 2.0 / np.maximum(abs(np.sin(ANGLES)), 1e-3))
    scans = []
    for k in range(n_scans):
        ranges = walls + rng.normal(0, 0.01, len(ANGLES))
        ranges[(np.arange(len(ANGLES)) + 3 * (k // 4)) % 10 < 3] *= 0.6
        pose = (0.3 * np.sin(0.05 * k), 0.2 * np.cos(0.03 * k), 0.01 * k)
        scans.append(Scan(start_s + PERIOD_S * k, pose, ANGLES, ranges))
    return scans


def grid_of(scans: list[Scan], config: MapConfig = CONFIG) -> TemporalGrid:
    grid = TemporalGrid(config)
    for scan in scans:
        grid.integrate(scan)
    return grid


def assert_same(got, wanted) -> None:
    """Everything is equal to the last bit: what is known, and what is answered about some moments."""
    np.testing.assert_array_equal(got.stamps_ns, wanted.stamps_ns)
    np.testing.assert_array_equal(got.poses, wanted.poses)
    n_tiles = wanted.tiles.n_tiles
    assert got.tiles.n_tiles == n_tiles
    for name in ("tile_rows", "tile_cols"):
        np.testing.assert_array_equal(getattr(got.tiles, name)[:n_tiles], getattr(wanted.tiles, name)[:n_tiles])
    for mine, yours in zip(got.all_runs(), wanted.all_runs(), strict=True):
        np.testing.assert_array_equal(mine, yours)
    assert (got.n_scans, got.n_cells, got.n_intervals) == (wanted.n_scans, wanted.n_cells, wanted.n_intervals)
    cells = np.sort(wanted.surfaces.cell_of_slot[: wanted.surfaces.n_slots])
    np.testing.assert_array_equal(np.sort(got.surfaces.cell_of_slot[: got.surfaces.n_slots]), cells)
    mine, yours = (surfaces.slot_of_cell[cells] for surfaces in (got.surfaces, wanted.surfaces))
    np.testing.assert_array_equal(got.surfaces.hit_count[mine], wanted.surfaces.hit_count[yours])
    np.testing.assert_array_equal(got.surfaces.moments[mine], wanted.surfaces.moments[yours])
    assert_same_moments(got, wanted)


def assert_same_moments(got, wanted) -> None:
    for share in (0.0, 0.3, 0.8, 1.0):
        stamp_ns = wanted.stamps_ns[int(share * (wanted.n_scans - 1))]
        moment = np.datetime64(int(stamp_ns), "ns")
        for mine, yours in zip(got.at(moment, hold=5.0), wanted.at(moment, hold=5.0), strict=True):
            np.testing.assert_array_equal(mine, yours)


def debris(root) -> list[str]:
    """What is in a map's folder that map.json does not name."""
    manifest = read_manifest(root)
    named = {segment.name for segment in manifest.segments} | set(manifest.retired)
    found = [path.relative_to(root).as_posix() for path in (*root.glob("segments/*"), *root.glob("journal/*"))]
    others = [path.name for path in root.iterdir() if path.name not in ("map.json", "segments", "journal")]
    beside = [path.name for path in root.parent.glob(f".{root.name}.*")]
    return [name for name in (*found, *others) if name not in named] + beside
