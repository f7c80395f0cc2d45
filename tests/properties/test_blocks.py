"""Method ``evidence``: neither the size of blocks nor what is known from earlier analyses changes the answer."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fed_grid import empty_grid, feed, grid_of
from strategies import STREAM_START_NS, Stream
from tempog.analysis.evidence import blocks, places
from tempog.analysis.evidence.known import Known
from tempog.analysis.evidence.places import Place, as_arrays
from tempog.analysis.find_objects import FoundObjects, find_objects
from tempog.analysis.growing import EvidenceAnalysis
from tempog.errors import ConfigError, TimeError
from tempog.grid.temporal_grid import TemporalGrid
from tempog.methods import EvidenceConfig
from tempog.pipeline import build_grid
from tempog.simulation import load_world, random_building, simulate

FEW = settings(max_examples=8, deadline=None, derandomize=True)
NS = 1_000_000_000
PERIOD_S = 0.25
WHOLE_MAP = 10_000  # tiles: one block, or four where the map lies around the origin


SEEDS = st.integers(0, 10_000)


def drive(seed: int) -> Stream:
    """Things that stand in one of up to three places at a time, somebody who walks by, and times without a look."""
    rng = np.random.default_rng(seed)
    n_scans = 240
    row0, col0 = [(200, 300), (-20, -9), (4_000, -70_000)][seed % 3]
    occupied: list[set[tuple[int, int]]] = [set() for _ in range(n_scans)]
    unseen: list[set[tuple[int, int]]] = [set() for _ in range(n_scans)]
    for _ in range(1 + seed % 2):
        corner = rng.integers(-24, 24, 2)
        spots = [box(corner + rng.integers(-6, 6, 2), rng) for _ in range(rng.integers(1, 4))]
        k = 0
        while k < n_scans:
            there = spots[rng.integers(len(spots))] if rng.random() < 0.8 else set()
            until = k + int(rng.integers(20, 110))
            for taken in occupied[k:until]:
                taken |= there
            if rng.random() < 0.4:
                for hidden in unseen[k : until - 15]:
                    hidden |= spots[0]
            k = until
    for k in range(n_scans):  # somebody walks by every half minute
        if k % 120 < 60:
            occupied[k] |= {(k // 120 * 5 - 10 + i, k % 120 - 30 + j) for i in range(3) for j in range(3)}
    every = set().union(*occupied)
    statements = [
        [((row + row0, col + col0), 0.9 if (row, col) in taken else 0.1) for row, col in sorted(every - hidden)]
        for taken, hidden in zip(occupied, unseen, strict=True)
    ]
    stamps = [STREAM_START_NS + round(k * PERIOD_S * NS) for k in range(n_scans)]
    return Stream(stamps, statements, NS, 0.2)


def box(corner, rng) -> set[tuple[int, int]]:
    """The cells of a leaf or a box."""
    deep, long = int(rng.integers(1, 3)), int(rng.integers(5, 15))
    shape = (deep, long) if rng.random() < 0.5 else (long, deep)
    return {(int(corner[0]) + i, int(corner[1]) + j) for i in range(shape[0]) for j in range(shape[1])}


def passes(seed: int) -> tuple[Stream, list[float]]:
    """A robot that drives to and fro 1 m beside a pane of glass, by a clock that jitters, and its x at each scan."""
    rng = np.random.default_rng(seed)
    n_scans = 700
    stamps = STREAM_START_NS + (np.arange(n_scans) * PERIOD_S * NS).astype(np.int64)
    stamps += rng.integers(-NS // 100, NS // 100, n_scans)
    x_m = 4.0 * np.sin(np.arange(n_scans) / rng.uniform(10, 14)) + 0.5
    pane = [(20, k) for k in range(20)]
    statements = []
    for x in x_m:
        towards = [math.degrees(math.atan2(x - 0.05 * (col + 0.5), 1.0)) for _, col in pane]
        hit = [0.9 if abs(off + rng.normal(0, 3)) < 25 else 0.1 for off in towards]
        statements.append([(cell, p) for cell, p in zip(pane, hit, strict=True) if rng.random() < 0.9])
    return Stream(stamps.tolist(), statements, NS, 0.2), x_m.tolist()


def document(found: FoundObjects) -> str:
    return json.dumps(found.document(), sort_keys=True)


@given(SEEDS, st.sampled_from([1, 2, 5]))
@FEW
def test_small_blocks_give_what_one_block_gives(seed, block_tiles):
    grid = grid_of(drive(seed))
    whole = EvidenceAnalysis(block_tiles=WHOLE_MAP).update(grid)
    assert document(EvidenceAnalysis(block_tiles=block_tiles).update(grid)) == document(whole)
    assert document(find_objects(grid)) == document(whole)


@given(SEEDS, st.sampled_from([1, 2, 5]))
@FEW
def test_the_pairs_of_small_blocks_are_those_of_one_block_to_the_last_bit(seed, block_tiles):
    grid = grid_of(drive(seed))
    small, whole = (blocks.cell_states(grid, EvidenceConfig(), None, n) for n in (block_tiles, WHOLE_MAP))
    pairs = [sorted(zip(*map(np.ndarray.tolist, states.alike), strict=True)) for states in (small, whole)]
    assert pairs[0] == pairs[1]
    np.testing.assert_array_equal(small.evidence, whole.evidence)
    np.testing.assert_array_equal(small.seconds, whole.seconds)
    which = np.arange(len(whole.rows))[::-1]
    for got, wanted in zip(small.courses.of(which), whole.courses.of(which), strict=True):
        np.testing.assert_array_equal(got, wanted)


@given(SEEDS, st.sampled_from([1, 4]), st.lists(st.floats(0.1, 1.0), min_size=1, max_size=3))
@FEW
def test_a_map_that_grows_is_analysed_as_if_for_the_first_time(seed, block_tiles, shares):
    stream = drive(seed)
    grid, fed = empty_grid(stream), 0
    analysis = EvidenceAnalysis(block_tiles=block_tiles)
    for share in [*sorted(shares), 1.0]:
        until = max(1, round(share * len(stream.stamps_ns)))
        for stamp_ns in stream.stamps_ns[fed:until]:
            feed(grid, stamp_ns)
        fed = max(fed, until)
        assert document(analysis.update(grid)) == document(find_objects(grid))


@given(SEEDS, SEEDS)
@FEW
def test_an_analysis_may_go_from_any_history_to_any_other(seed, other):
    analysis = EvidenceAnalysis()
    one, two = grid_of(drive(seed)), grid_of(drive(other))
    for history in (one, two, one.window("+5", "+40"), one):
        assert document(analysis.update(history)) == document(find_objects(history))


@given(SEEDS, st.sampled_from([1, 2, 5]), st.lists(st.floats(0.3, 1.0), min_size=1, max_size=3))
@FEW
def test_glass_is_the_same_in_blocks_of_any_size_and_while_the_map_grows(seed, block_tiles, shares):
    stream, x_m = passes(seed)
    grid, fed = empty_grid(stream), 0
    analysis = EvidenceAnalysis(block_tiles=block_tiles)
    for share in [*sorted(shares), 1.0]:
        until = round(share * len(x_m))
        for stamp_ns, x in zip(stream.stamps_ns[fed:until], x_m[fed:until], strict=True):
            feed(grid, stamp_ns, x)
        fed = max(fed, until)
        found = analysis.update(grid)
        assert document(found) == document(EvidenceAnalysis(block_tiles=WHOLE_MAP).update(grid))
    assert len(found.uncertain_points_map) >= 10


def test_what_was_seen_from_elsewhere_is_worked_out_again() -> None:
    stream, x_m = passes(0)
    driving, elsewhere = empty_grid(stream), empty_grid(stream)
    for stamp_ns, x in zip(stream.stamps_ns, x_m, strict=True):
        feed(driving, stamp_ns, x)
    for stamp_ns in stream.stamps_ns:
        feed(elsewhere, stamp_ns, 0.5)
    analysis = EvidenceAnalysis()
    n_uncertain = [len(analysis.update(grid).uncertain_points_map) for grid in (driving, elsewhere, driving)]
    assert n_uncertain[0] == n_uncertain[2] >= 10
    assert n_uncertain[1] == 0


def test_where_scans_were_between_two_looks_is_part_of_what_was_measured() -> None:
    def content(x: float, seen_last: bool = True) -> int:
        cells = [[((0, 0), 0.9)], [], [((0, 0), 0.9)] if seen_last else [], []]
        stream = Stream([STREAM_START_NS + k * NS // 4 for k in range(4)], cells, NS, 0.2)
        grid = empty_grid(stream)
        for stamp_ns, there in zip(stream.stamps_ns, (0.0, x, 0.0, x), strict=True):
            feed(grid, stamp_ns, there)
        return int(blocks.cell_content(grid)[grid.tiles.cell_number(0, 0)])

    assert content(1.0) != content(2.0)
    assert content(1.0, seen_last=False) == content(2.0, seen_last=False)


@pytest.mark.parametrize("world", [random_building(5), load_world("rooms"), load_world("hallway")])
def test_a_simulated_drive_gives_the_same_in_blocks_and_in_parts(world):
    scans = simulate(world, 240.0, seed=4, people=8).scans
    whole = find_objects(build_grid(scans))
    assert whole.configurations
    grid, analysis = TemporalGrid(scan_period_s=0.1), EvidenceAnalysis(block_tiles=3)
    for first in range(0, len(scans), 900):
        grid.integrate_many(scans[first : first + 900])
        found = analysis.update(grid)
    assert document(found) == document(whole) == document(find_objects(grid))


def two_doors_then_one() -> tuple[Stream, int]:
    """Two doors 20 m apart; after a while only the second is seen."""
    first, second = {(0, k) for k in range(14)}, {(400, 400 + k) for k in range(14)}
    statements = []
    for k in range(600):
        seen = first | second if k < 400 else second
        closed = (first if k // 100 % 2 else set()) | (second if k // 50 % 2 else set())
        statements.append([(cell, 0.9 if cell in closed else 0.1) for cell in sorted(seen)])
    return Stream([STREAM_START_NS + round(k * PERIOD_S * NS) for k in range(600)], statements, NS, 0.2), 400


def test_only_what_changed_is_worked_out_again(monkeypatch) -> None:
    looked = []
    real = blocks.look_at_block
    monkeypatch.setattr(blocks, "look_at_block", lambda *given: looked.append(given[1].tolist()) or real(*given))
    stream, n_before = two_doors_then_one()
    grid, analysis = empty_grid(stream), EvidenceAnalysis()
    for stamp_ns in stream.stamps_ns[:n_before]:
        feed(grid, stamp_ns)
    assert len(analysis.update(grid).configurations) == 2
    assert (len(looked), analysis.share_recalled) == (2, 0.0)
    for stamp_ns in stream.stamps_ns[n_before:]:
        feed(grid, stamp_ns)
    looked.clear()
    assert len(analysis.update(grid).configurations) == 2
    assert looked == [[400] * 14]
    assert 0.4 < analysis.share_recalled < 0.6
    looked.clear()
    analysis.update(grid)
    assert (looked, analysis.share_recalled) == ([], 1.0)


def test_a_place_is_judged_anew_when_only_what_is_around_it_changed(monkeypatch) -> None:
    judged, real = [], places.place_odds
    monkeypatch.setattr(places, "place_odds", lambda traits: judged.append(traits) or real(traits))
    leaf, beside = {(0, k) for k in range(14)}, {(row, k) for row in (3, 4) for k in range(0, 14, 2)}
    statements = []
    for k in range(800):  # what is hit beside the closed leaf looks like a wall, until it is seen to be gone
        closed = k // 80 % 2 == 0
        if k < 640:
            statements.append(
                [*((cell, 0.9 if closed else 0.1) for cell in leaf), *((c, 0.9) for c in beside if closed)]
            )
        else:
            statements.append([(cell, 0.1) for cell in beside])
    stream = Stream([STREAM_START_NS + round(k * PERIOD_S * NS) for k in range(800)], statements, NS, 0.2)
    chosen = EvidenceConfig(reach_m=0.05, ring_m=0.2)  # so near that what is beside is no part of the leaf
    grid, analysis = empty_grid(stream), EvidenceAnalysis(chosen)
    for stamp_ns in stream.stamps_ns[:640]:
        feed(grid, stamp_ns)
    analysis.update(grid)
    assert [traits.leak for traits in judged] == [0.0]
    for stamp_ns in stream.stamps_ns[640:]:
        feed(grid, stamp_ns)
    judged.clear()
    analysis.update(grid)
    (remembered,) = judged
    assert remembered.leak == pytest.approx(1.0)
    judged.clear()
    find_objects(grid, settings=chosen)
    assert judged == [remembered]


def piece(x_m: float, y_m: float, length_m: float) -> Place:
    """Cells in a row from a point on."""
    n = round(length_m / 0.05)
    points = np.stack([x_m + 0.05 * np.arange(n), np.full(n, y_m)], axis=-1)
    return Place(np.arange(n), points, as_arrays([]), (), 0.05)


@given(st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40), st.integers(3, 60)), max_size=12))
@FEW
def test_faces_are_looked_for_as_far_as_the_larger_piece_is_large(triples):
    pieces = [piece(0.1 * x, 0.1 * y, 0.05 * length) for x, y, length in triples]
    wanted = [
        (i, j)
        for (i, one), (j, other) in itertools.combinations(enumerate(pieces), 2)
        if math.dist(one.centre_m, other.centre_m) <= max(one.size_m, other.size_m) + 0.11
    ]
    assert places.close_pairs(pieces, 0.11) == wanted


def test_a_piece_as_long_as_the_map_makes_no_pairs_of_the_others() -> None:
    pieces = [piece(-100.0, 0.0, 300.0), *(piece(3.0 * (k % 30), 3.0 * (k // 30), 0.8) for k in range(900))]
    assert places.close_pairs(pieces, 0.11) == [(0, k) for k in range(1, 901)]


def test_what_was_not_needed_is_forgotten_and_other_contexts_know_nothing() -> None:
    known = Known()
    known.begin("a")
    known.keep(b"1", 1)
    known.begin("a")
    assert known.recall(b"1") == (True, 1)
    known.begin("a")
    known.begin("a")
    assert known.recall(b"1") == (False, None)
    known.keep(b"1", 1)
    known.begin("b")
    assert known.recall(b"1") == (False, None)


def test_an_analysis_says_what_it_cannot_work_with() -> None:
    with pytest.raises(ConfigError, match="block_tiles = 0 cannot work; wanted a whole number of tiles, 1 or more"):
        EvidenceAnalysis(block_tiles=0)
    with pytest.raises(ConfigError, match="settings is a str; wanted EvidenceConfig"):
        EvidenceAnalysis("evidence")  # type: ignore[arg-type]
    with pytest.raises(TimeError, match="no scans"):
        EvidenceAnalysis().update(TemporalGrid())
