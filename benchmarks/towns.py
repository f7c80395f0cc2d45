"""A map of as many cells as wanted, saved: one simulated drive through an office, side by side and over and over.

python benchmarks/towns.py MAP [CELLS [INTERVALS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

from objects import Town

from tempog import TemporalGrid, build_grid, save_map
from tempog.simulation import load_world, simulate

WORLD, N_PEOPLE, DRIVE_S = "office", 20, 180.0
CELLS, INTERVALS = 4_000_000, 40_000_000


def save_town(path: Path, n_cells: int = CELLS, n_intervals: int = INTERVALS) -> Path:
    """Save a town of at least so many observed cells and intervals; half a minute for four million cells."""
    drive = build_grid(simulate(load_world(WORLD), DRIVE_S, people=N_PEOPLE).scans)
    assert isinstance(drive, TemporalGrid)
    return save_map(Town([drive], n_cells, n_intervals), path)


if __name__ == "__main__":
    save_town(Path(sys.argv[1]), *(int(number) for number in sys.argv[2:4]))
