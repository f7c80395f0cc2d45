"""Method ``evidence``: other processes find in parts of a map what one process finds in all of it."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_blocks import SEEDS, document, drive, passes

from fed_grid import empty_grid, feed, grid_of
from strategies import STREAM_START_NS, Stream
from tempog.analysis.evidence.elsewhere import part_of
from tempog.analysis.evidence.find import find_by_evidence
from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.series import Intervals
from tempog.grid.history import History
from tempog.methods import EvidenceConfig
from tempog.pipeline import build_grid
from tempog.simulation import load_world, random_building, simulate

FEW = settings(max_examples=8, deadline=None, derandomize=True)


class Posted:
    """Workers that are this process, but see only what can be sent."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def each(self, what, work, items, n_items):
        self.asked.append(what)
        answers = []
        for item in items:
            there, sent = pickle.loads(pickle.dumps((work, item), protocol=5))
            answers.append(pickle.loads(pickle.dumps(there(sent), protocol=5)))
        assert len(answers) == n_items
        return answers


def found_elsewhere(history: History, block_tiles: int = 16) -> str:
    chosen, workers = EvidenceConfig(), Posted()
    walls, places, objects = find_by_evidence(history, chosen, None, block_tiles, workers)
    assert workers.asked == ["blocks", "bundles of cells", "groups of cells", "pieces of places", "places"]
    extent = history.extent
    return document(FoundObjects(history, "evidence", chosen, walls, extent, tuple(places), tuple(objects)))


@given(SEEDS, st.sampled_from([1, 2, 5, 16]))
@FEW
def test_parts_give_what_the_whole_gives(seed, block_tiles):
    grid = grid_of(drive(seed))
    assert found_elsewhere(grid, block_tiles) == document(find_objects(grid))


@given(SEEDS, st.sampled_from([1, 16]))
@FEW
def test_parts_of_a_window_give_what_the_window_gives(seed, block_tiles):
    window = grid_of(drive(seed)).window("+5", "+40")
    assert found_elsewhere(window, block_tiles) == document(find_objects(window))


@given(SEEDS, st.sampled_from([1, 16]))
@FEW
def test_glass_is_told_from_the_scans_that_saw_it(seed, block_tiles):
    stream, x_m = passes(seed)
    grid = empty_grid(stream)
    for stamp_ns, x in zip(stream.stamps_ns, x_m, strict=True):
        feed(grid, stamp_ns, x)
    found = found_elsewhere(grid, block_tiles)
    assert len(json.loads(found)["uncertain"]) >= 10
    assert found == document(find_objects(grid))


@pytest.mark.parametrize("world", [random_building(5), load_world("rooms")])
@pytest.mark.parametrize("block_tiles", [4, 16])
def test_a_simulated_drive_gives_the_same_elsewhere(world, block_tiles):
    grid = build_grid(simulate(world, 240.0, seed=4, people=8).scans)
    found = found_elsewhere(grid, block_tiles)
    assert json.loads(found)["unassociated"] + json.loads(found)["objects"]
    assert found == document(find_objects(grid))


def test_a_map_without_anything_in_it_is_no_matter() -> None:
    grid = grid_of(Stream([STREAM_START_NS, STREAM_START_NS + 10**9], [[((0, 0), 0.1)], []], 10**9, 0.2))
    assert found_elsewhere(grid) == document(find_objects(grid))


@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 5), st.booleans()), min_size=1, max_size=300),
    st.sets(st.integers(0, 5), min_size=1),
    st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
@example([(0, k % 2, False) for k in range(200)], {0}, (0.0, 1.0))  # many scans of one stamp
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_part_has_the_series_and_the_scans_of_its_cells(looks, chosen, shares):
    """Of each look: how much later it is than the one before, which cell it sees, and as what."""
    stamps = STREAM_START_NS + 10**9 * np.cumsum([later for later, _, _ in looks])
    statements = [[((0, col), 0.9 if hit else 0.1)] for _, col, hit in looks]
    grid = grid_of(Stream(stamps.tolist(), statements, 3 * 10**9, 0.2))
    first, last = sorted(int(share * (len(looks) - 1)) for share in shares)
    whole = Intervals(list(grid.runs()), grid.stamps_ns, first, last, 10**9)
    numbers = np.sort([number for col in chosen if (number := grid.tiles.cell_number(0, col)) >= 0]).astype(np.int32)
    part, kept = part_of(whole, numbers)
    wanted, got = whole.series(numbers), part.series(numbers)
    for name, array in vars(wanted).items():
        np.testing.assert_array_equal(vars(got)[name], array, strict=True)
    np.testing.assert_array_equal(part.stamps_ns, whole.stamps_ns[kept])
    for start_ns, stop_ns in zip(wanted.start_ns, wanted.stop_ns - whole.look_ns, strict=True):
        during = (whole.stamps_ns >= start_ns) & (whole.stamps_ns <= stop_ns)
        assert set(np.flatnonzero(during)) <= set(kept)
    assert np.array_equal(kept, np.unique(kept))


def test_a_part_leaves_out_the_scans_that_saw_none_of_its_cells() -> None:
    """One cell is seen for a second, twice in half an hour, the other all the time."""
    n_scans = 18_000
    stamps = [STREAM_START_NS + k * 10**8 for k in range(n_scans)]
    statements = [[((0, 9), 0.1)] + [((0, 0), 0.9)] * (k % 9_000 in range(5_000, 5_010)) for k in range(n_scans)]
    grid = grid_of(Stream(stamps, statements, 10**9, 0.2))
    numbers = np.array([grid.tiles.cell_number(0, 0)], dtype=np.int32)
    part, kept = part_of(Intervals.of(grid), numbers)
    assert {5_000, 5_009, 14_000, 14_009} <= set(kept.tolist())
    assert len(kept) == 2 * 64
    assert sum(runs.n_intervals for runs in part.sets) == 2
