"""Tiles of the viewer show what the history says, pixel by pixel."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fixed_history import FixedHistory, cells_of, tiles_of
from png_pixels import pixels_of
from tempog.config import GridConfig, MapConfig
from tempog.grid.history import OCCUPIED_ABOVE
from tempog.grid.segments import Runs
from tempog.times import NS_PER_S
from tempog.views.web.blocks import SIDE, Blocks, Read, TilesOfBlocks, Where, numbers_at
from tempog.views.web.layers import palette
from tempog.views.web.model import Model
from tempog.views.web.png import encode_png
from tempog.views.web.prepared import changes_per_scan
from tempog.views.web.sources import HistorySource
from tempog.views.web.tiles import Pyramid, age_codes, fade_s, occupancy_codes, scans_at, seen_codes

QUICK = settings(max_examples=60, deadline=None, derandomize=True)
N_SCANS = 9
# Where blocks of 256 cells, and tiles of 8, meet; and around the origin, where rows and columns become negative.
COORDINATES = st.sampled_from([-513, -512, -257, -256, -255, -9, -8, -1, 0, 1, 7, 8, 255, 256, 511, 512])
HOLDS = st.sampled_from([0.0, 0.5, 1.0, 2.5, math.inf])


@st.composite
def histories(draw: st.DrawFn) -> FixedHistory:
    """A few cells, near and far, with intervals that touch, leave gaps, or last for one scan."""
    steps = draw(st.lists(st.sampled_from([0, 1, 2, 10, 100]), min_size=N_SCANS, max_size=N_SCANS))
    stamps_ns = 10**9 + np.cumsum(np.array(steps, dtype=np.int64)) * (NS_PER_S // 4)
    intervals = {}
    for cell in draw(st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=12, unique=True)):
        scan, found = draw(st.integers(0, 3)), []
        while scan < N_SCANS:
            last = min(scan + draw(st.integers(0, 3)), N_SCANS - 1)
            found.append((scan, last, draw(st.sampled_from([0.1, 0.3, 0.5, 0.51, 0.9]))))
            scan = last + draw(st.integers(1, 4))
        intervals[cell] = found
    tiles = {(row // 8, col // 8) for row, col in intervals}
    config = MapConfig(grid=GridConfig(resolution_m=0.1, gap_s=1.0))
    return FixedHistory(config, tiles, stamps_ns, np.zeros((N_SCANS, 3)), intervals)


def blocks_of(history: FixedHistory, budget_bytes: int = 2**30) -> Blocks:
    return Blocks(TilesOfBlocks(history.tiles), reader(history), budget_bytes)


def reader(history: FixedHistory) -> Read:
    def read(rows: np.ndarray, cols: np.ndarray) -> tuple[np.ndarray, list[Runs]]:
        numbers = numbers_at(history.tiles, rows, cols)
        return numbers, list(history.runs_of_tiles(np.sort(numbers)))

    return read


def moments(history: FixedHistory) -> st.SearchStrategy[int]:
    """Stamps of scans, just before and after, and far from all."""
    near = [int(stamp) + step for stamp in history.stamps_ns for step in (-1, 0, 1, 10**8)]
    return st.sampled_from([*near, 0, 10**12])


def oracle(history: FixedHistory, stamp_ns: int, hold_s: float) -> dict[tuple[int, int], tuple[int, float]]:
    """Of each known cell: 2 for occupied, 1 for free; and how long ago it was seen, in seconds."""
    snapshot = history.at(np.datetime64(stamp_ns, "ns"), hold_s)
    extent = snapshot.extent
    return {
        (row, col): (2 if value > OCCUPIED_ABOVE else 1, float(snapshot.age_s[row - extent.row0, col - extent.col0]))
        for row in {row for row, _ in cells_of(history)}
        for col in {col for _, col in cells_of(history)}
        for value in [snapshot.value[row - extent.row0, col - extent.col0]]
        if not math.isnan(value)
    }


def tiles_to_ask(history: FixedHistory, z: int) -> list[Where]:
    """Those with cells, and one without."""
    side = SIDE << z
    return [*{Where(z, row * 8 // side, col * 8 // side) for row, col in tiles_of(history)}, Where(z, 40, -40)]


def pooled(cells: dict[tuple[int, int], int], where: Where) -> np.ndarray:
    """The largest code of each pixel's cells, the northern row first."""
    codes = np.zeros((SIDE, SIDE), dtype=np.uint8)
    for (row, col), code in cells.items():
        y, x = (row >> where.z) - where.row * SIDE, (col >> where.z) - where.col * SIDE
        if 0 <= y < SIDE and 0 <= x < SIDE:
            codes[SIDE - 1 - y, x] = max(codes[SIDE - 1 - y, x], code)
    return codes


def dense(codes: np.ndarray | None) -> np.ndarray:
    return np.zeros((SIDE, SIDE), dtype=np.uint8) if codes is None else codes


@QUICK
@given(st.data(), histories(), HOLDS)
def test_occupancy_is_what_the_history_says(data, history, hold_s):
    blocks, stamp_ns = blocks_of(history), data.draw(moments(history))
    moment = scans_at(history.stamps_ns, stamp_ns, hold_s, 60.0)
    said = {cell: code for cell, (code, _) in oracle(history, stamp_ns, hold_s).items()}
    for z in range(4):
        for where in tiles_to_ask(history, z):
            np.testing.assert_array_equal(dense(occupancy_codes(blocks, where, moment)), pooled(said, where))


@QUICK
@given(st.data(), histories(), HOLDS)
def test_ages_are_those_of_the_youngest_cell_in_classes(data, history, hold_s):
    blocks, stamp_ns = blocks_of(history), data.draw(moments(history))
    longest_s = data.draw(st.sampled_from([60.0, 1000.0]))
    moment = scans_at(history.stamps_ns, stamp_ns, hold_s, longest_s)
    limits_s = np.geomspace(1.0, longest_s, len(moment.ages))
    # A pixel's code is the smallest of its cells'; the oracle pools by the largest.
    said = {
        cell: 255 - (1 + int(np.count_nonzero(limits_s < age_s - 1e-6)))
        for cell, (_, age_s) in oracle(history, stamp_ns, hold_s).items()
    }
    for z in range(4):
        for where in tiles_to_ask(history, z):
            expected = pooled(said, where)
            expected[expected > 0] = 255 - expected[expected > 0]
            np.testing.assert_array_equal(dense(age_codes(blocks, where, moment)), expected)


@QUICK
@given(histories(), st.integers(0, N_SCANS - 1))
def test_a_scan_saw_the_cells_whose_intervals_reach_over_it(history, scan):
    said = {
        cell: 1
        for cell, intervals in cells_of(history).items()
        if any(first <= scan <= last for first, last, _ in intervals)
    }
    for z in range(3):
        for where in tiles_to_ask(history, z):
            np.testing.assert_array_equal(dense(seen_codes(blocks_of(history), where, scan)), pooled(said, where))


@QUICK
@given(st.data(), histories())
def test_blocks_that_are_read_at_once_or_let_go_of_say_the_same(data, history):
    moment = scans_at(history.stamps_ns, data.draw(moments(history)), math.inf, 60.0)
    at_once, forgetful = blocks_of(history), blocks_of(history, 1)
    at_once.take_all(lambda: (history.tiles, list(history.runs())))
    afresh = blocks_of(history)
    for z in (0, 2):
        for where in tiles_to_ask(history, z):
            expected = dense(occupancy_codes(afresh, where, moment))
            for blocks in (at_once, forgetful):
                np.testing.assert_array_equal(dense(occupancy_codes(blocks, where, moment)), expected)
    assert len(forgetful._held) <= 1


@QUICK
@given(st.data(), histories())
def test_blocks_follow_a_history_that_grows(data, history):
    n, late = data.draw(st.integers(1, N_SCANS)), cells_of(history)
    early = {
        cell: [(first, min(last, n - 1), value) for first, last, value in intervals if first < n]
        for cell, intervals in late.items()
    }
    early = {cell: intervals for cell, intervals in early.items() if intervals}
    assume(early)
    tiles = {(row // 8, col // 8) for row, col in early}
    before = FixedHistory(history.config, tiles, history.stamps_ns[:n], history.poses[:n], early)
    # Tiles of `history` are numbered otherwise than those of `before`; what is read is of the newest.
    newest = [before]
    blocks = Blocks(TilesOfBlocks(before.tiles), lambda rows, cols: reader(newest[0])(rows, cols), 2**30)
    blocks.take_all(lambda: (before.tiles, list(before.runs())))
    for z in range(3):
        for where in tiles_to_ask(before, z):
            occupancy_codes(blocks, where, scans_at(before.stamps_ns, 10**12, math.inf, 60.0))
            age_codes(blocks, where, scans_at(before.stamps_ns, 10**12, math.inf, 60.0))
    newest[0] = history
    changed = blocks.follow(TilesOfBlocks(history.tiles), history.runs())
    untouched = {
        Where(0, row >> 8, col >> 8)
        for row, col in late
        if all(late[cell] == early.get(cell) for cell in late if (cell[0] >> 8, cell[1] >> 8) == (row >> 8, col >> 8))
    }
    assert not untouched & set(changed)
    moment = scans_at(history.stamps_ns, data.draw(moments(history)), math.inf, 60.0)
    afresh = blocks_of(history)
    for z in range(3):
        for where in tiles_to_ask(history, z):
            for codes_of in (occupancy_codes, age_codes):
                expected = dense(codes_of(afresh, where, moment))
                np.testing.assert_array_equal(dense(codes_of(blocks, where, moment)), expected)


@QUICK
@given(
    st.integers(-700, 700),
    st.integers(-700, 700),
    st.integers(1, 700),
    st.integers(1, 700),
    st.integers(0, 2**32 - 1),
)
def test_a_pyramid_pools_what_it_was_given(row0, col0, n_rows, n_cols, seed):
    from tempog.sensing.grid_spec import Extent

    chosen = np.random.default_rng(seed)
    codes = (chosen.integers(0, 200, (n_rows, n_cols)) == 0).astype(np.uint8) * chosen.integers(
        1, 5, (n_rows, n_cols)
    )
    codes = codes.astype(np.uint8)
    pyramid = Pyramid.of(codes, Extent(row0, col0, n_rows, n_cols, 0.1), 4)
    rows, cols = np.nonzero(codes)
    cells = {
        (row + row0, col + col0): int(codes[row, col]) for row, col in zip(rows.tolist(), cols.tolist(), strict=True)
    }
    for z in range(4):
        some = {Where(z, (row >> z) // SIDE, (col >> z) // SIDE) for row, col in list(cells)[:50]}
        for where in [*some, Where(z, 9, 9), Where(z, -9, 0)]:
            np.testing.assert_array_equal(dense(pyramid.codes(where)), pooled(cells, where))


@QUICK
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 3, 4, 5, 16, 17, 256]), st.sampled_from([8, 256, 264]))
def test_pictures_hold_the_colours_of_their_codes(seed, n_colours, n_cols):
    chosen = np.random.default_rng(seed)
    colours = [tuple(colour) for colour in chosen.integers(0, 256, (n_colours, 4)).tolist()]
    codes = chosen.integers(0, n_colours, (7, n_cols)).astype(np.uint8)
    np.testing.assert_array_equal(pixels_of(encode_png(codes, colours)), np.array(colours, dtype=np.uint8)[codes])


@QUICK
@given(st.data(), histories(), HOLDS, st.sampled_from(["light", "dark"]))
def test_a_tile_of_the_server_has_the_colours_of_the_moment(data, history, hold_s, theme):
    model = Model(HistorySource(history))
    stamp_ns = data.draw(moments(history))
    t = (stamp_ns - history.start_ns) / NS_PER_S
    said = {cell: code for cell, (code, _) in oracle(history, model.stamp_ns(t), hold_s).items()}
    colours = np.array(palette("occupancy", theme), dtype=np.uint8)
    for where in tiles_to_ask(history, 1):
        picture = model.tile("occupancy", where, theme, t, hold_s)
        np.testing.assert_array_equal(pixels_of(picture), colours[pooled(said, where)])
        assert model.tile("occupancy", where, theme, t, hold_s) == picture


@QUICK
@given(histories())
def test_changes_are_counted_where_a_cell_is_found_otherwise_than_before(history):
    counts = [0] * N_SCANS
    for intervals in cells_of(history).values():
        states = [(first, value > OCCUPIED_ABOVE) for first, _, value in intervals]
        for (_, before), (scan, after) in pairwise(states):
            counts[scan] += before != after
    assert changes_per_scan(history).tolist() == counts


def test_the_veil_is_densest_after_the_history_s_length_within_reason():
    assert [fade_s(duration_s) for duration_s in (0.0, 300.0, 1e9)] == [60.0, 300.0, 7 * 86_400.0]
