"""What is on the move, as intervals of cells, is what each scan says of it."""

from __future__ import annotations

import numpy as np
import pytest

from tempog import build_grid, find_objects
from tempog.simulation import corridor, load_world, simulate


@pytest.fixture(scope="module", params=["corridor", "hallway"])
def grid(request):
    if request.param == "corridor":
        return build_grid(simulate(corridor(), duration_s=90.0).scans)
    return build_grid(simulate(load_world("hallway"), 120.0, people=20).scans)


@pytest.mark.parametrize("method", ["evidence", "paper-tuned"])
def test_intervals_reach_over_the_scans_that_saw_a_cell_on_the_move(grid, method):
    found = find_objects(grid, method)
    runs = found.moving_intervals()
    assert runs.n_intervals > 100
    assert (np.diff(runs.cells) > 0).all()
    cell = runs.cell
    for scan, measured in enumerate(found.high_dynamics()):
        rows, cols = grid.tiles.rows_cols(np.unique(cell[(runs.first <= scan) & (runs.last >= scan)]))
        there = np.stack([rows, cols], axis=-1)[np.lexsort((cols, rows))]
        np.testing.assert_array_equal(there, measured.cells)
