"""However a history is cut, its segments say what the whole says; and mapping goes on as if it had never stopped."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fed_grid import begin_session, config_of, feed, grid_of, listening
from fixed_history import a_folder, strand_of_small_segments
from questions import ask, ask_all
from same_answers import assert_same_intervals, assert_same_surfaces
from same_runs import assert_identical
from strategies import odd_scans, streams
from tempog.config import GridConfig, MapConfig, SensingConfig
from tempog.grid.mapper import Mapper, MapState
from tempog.grid.segments import Runs, join
from tempog.grid.temporal_grid import TemporalGrid
from tempog.sensing.surfaces import SurfaceMemory
from tempog.sensing.tiles import TileIndex
from tempog.store import committer, strand
from tempog.store.live_map import LiveMap
from tempog.store.rewrite import contents_of
from tempog.store.saved_map import open_map
from tempog.store.segment_files import Content, SegmentFiles, joined

QUICK = settings(max_examples=25, deadline=None, derandomize=True)
ANY_SCANS_S = 1e-9  # s; a scan period that no gap threshold is too short for


@given(streams(), st.integers(1, 12), st.sampled_from([1, 4]), st.data())
@QUICK
def test_a_history_cut_into_small_segments_answers_as_before(stream, most_intervals, n_states, data):
    grid = grid_of(stream)
    with a_folder() as folder, patch.object(strand, "HELD_STATES", n_states):
        for _ in range(2):
            ask(data, strand_of_small_segments(grid, folder, most_intervals), grid, stream.stamps_ns)
        ask_all(data, strand_of_small_segments(grid, folder, most_intervals), grid, stream.stamps_ns)


# Cuts.


def cut_live(data: st.DataObject, path: Path, n_scans: int, feed_next) -> list[Content]:
    """What a live map writes that is flushed here and there."""
    with patch.object(committer, "FANOUT", 10**6), LiveMap(path, **feed_next.settings) as live:
        for k in range(n_scans):
            feed_next(live, k)
            if data.draw(st.integers(0, 2)) == 0:
                live.flush()
    return [SegmentFiles(path, segment).content() for segment in open_map(path).segments]


def assert_same_content(got: Content, wanted: Content) -> None:
    assert (got.first_scan, got.first_tile) == (wanted.first_scan, wanted.first_tile)
    for name in ("stamps_ns", "poses", "tile_rows", "tile_cols"):
        np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name), name)
    for name in ("sealed", "open_runs"):
        assert_identical(getattr(got, name), getattr(wanted, name))
    order = [np.argsort(content.hits.cells) for content in (got, wanted)]
    for name in ("cells", "counts", "moments"):
        mine, theirs = (getattr(c.hits, name)[o] for c, o in zip((got, wanted), order, strict=True))
        np.testing.assert_array_equal(mine, theirs, name)


def assert_any_cuts_join_to(data: st.DataObject, contents: list[Content], whole: Content) -> None:
    cuts = sorted(data.draw(st.sets(st.integers(1, len(contents)), max_size=4)) | {0, len(contents)})
    groups = [joined(contents[a:b]) for a, b in pairwise(cuts)]
    assert_same_content(joined(groups), whole)
    assert_same_content(joined(contents), whole)


@given(streams(), st.integers(1, 12), st.data())
@QUICK
def test_what_was_cut_joins_to_the_whole(stream, most_intervals, data):
    grid = grid_of(stream)
    ((whole, n_cells),) = contents_of(grid)
    assert whole.full
    assert n_cells == grid.n_cells
    contents = [content for content, _ in contents_of(grid, most_intervals)]
    assert_any_cuts_join_to(data, contents, whole)

    def feed_next(live: LiveMap, k: int) -> None:
        feed(live, stream.stamps_ns[k])

    feed_next.settings = {"config": config_of(stream), "scan_period_s": ANY_SCANS_S}
    with a_folder() as folder, listening(stream):
        contents = cut_live(data, folder / "map", len(stream.stamps_ns), feed_next)
        assert_any_cuts_join_to(data, contents, whole)


@given(odd_scans(max_scans=12), st.sampled_from(["surface", "literal"]), st.data())
@settings(QUICK, max_examples=12)
def test_scans_that_were_cut_join_to_the_whole(scans, evidence, data):
    config = config_for(evidence)
    grid = TemporalGrid(config)
    grid.integrate_many(scans)

    def feed_next(live: LiveMap, k: int) -> None:
        live.integrate(scans[k])

    feed_next.settings = {"config": config, "scan_period_s": ANY_SCANS_S}
    with a_folder() as folder:
        contents = cut_live(data, folder / "map", len(scans), feed_next)
        ((whole, _),) = contents_of(grid)
        assert_any_cuts_join_to(data, contents, whole)
        saved = open_map(folder / "map")
        assert_same_intervals(saved, grid)
        assert_same_surfaces(saved.surfaces, grid.surfaces, with_lines=evidence == "surface")


# Resuming.


def config_for(evidence: str) -> MapConfig:
    sensing = SensingConfig(evidence=evidence, max_range_m=5.0, surface_min_hits=2)
    return MapConfig(sensing, GridConfig(0.1, gap_s=4.0))


def state_of(mapper: Mapper, session_start: int, n_more_scans: int) -> MapState:
    """What a map on disk would know of a mapper, with some stamps more than are needed."""
    tiles, surfaces, used = mapper.tiles, mapper.surfaces, slice(0, mapper.tiles.n_tiles)
    slots = np.argsort(surfaces.cell_of_slot[: surfaces.n_slots])
    hits = (getattr(surfaces, name)[slots] for name in ("cell_of_slot", "hit_count", "moments"))
    stamps_ns = mapper.stamps_ns
    needed = int(np.searchsorted(stamps_ns, stamps_ns[-1] - 4 * 10**9))
    since = max(session_start - mapper.first_kept, needed - n_more_scans, 0)
    return MapState(
        TileIndex.from_tiles(tiles.spec, tiles.max_cells, tiles.tile_rows[used].copy(), tiles.tile_cols[used].copy()),
        SurfaceMemory.of(tiles.n_cells, *hits),
        Runs(*(column.copy() for column in mapper.open_runs())),
        mapper.n_scans,
        session_start,
        stamps_ns[since:].copy(),
        mapper.poses[since:].copy(),
    )


@given(odd_scans(max_scans=16), st.sampled_from(["surface", "literal"]), st.data())
@QUICK
def test_a_mapper_that_goes_on_equals_one_that_never_stopped(scans, evidence, data):
    config = config_for(evidence)
    through, resumed, session_start = Mapper(config), Mapper(config), 0
    sealed: list[list[Runs]] = [[], []]
    for scan in scans:
        for mapper in (through, resumed):
            mapper.integrate(scan)
        then = data.draw(st.sampled_from(["go on", "go on", "go on", "forget", "resume", "new session"]))
        if then == "forget":
            resumed.forget_scans(data.draw(st.integers(0, resumed.n_scans)))
        elif then != "go on":
            if then == "new session":
                session_start = through._session_start = through.n_scans
            sealed[1] += [runs for runs in [resumed.take_sealed()] if runs is not None]
            state = state_of(resumed, session_start, data.draw(st.integers(0, 3)))
            resumed = Mapper(config, state=state)
    for k, mapper in enumerate((through, resumed)):
        sealed[k] += [runs for runs in [mapper.take_sealed()] if runs is not None]
    assert resumed.n_scans == through.n_scans
    assert_identical(join(sealed[1]), join(sealed[0]))
    assert_identical(resumed.open_runs(), through.open_runs())
    n_tiles = through.tiles.n_tiles
    assert resumed.tiles.n_tiles == n_tiles
    for name in ("tile_rows", "tile_cols"):
        np.testing.assert_array_equal(
            getattr(resumed.tiles, name)[:n_tiles], getattr(through.tiles, name)[:n_tiles], name
        )
    assert_same_surfaces(resumed.surfaces, through.surfaces, with_lines=evidence == "surface")
    n_kept = len(resumed.stamps_ns)
    np.testing.assert_array_equal(resumed.stamps_ns, through.stamps_ns[through.n_scans - n_kept :])
    np.testing.assert_array_equal(resumed.poses, through.poses[through.n_scans - n_kept :])


@given(odd_scans(max_scans=16), st.sampled_from(["surface", "literal"]), st.data())
@settings(QUICK, max_examples=12)
def test_sessions_of_scans_leave_the_hit_points_and_intervals_of_one_grid(scans, evidence, data):
    config = config_for(evidence)
    grid, live = TemporalGrid(config), None
    with a_folder() as folder, patch.object(committer, "FANOUT", 2), patch.object(committer, "SEGMENT_INTERVALS", 40):
        for k, scan in enumerate(scans):
            if live is None:
                window = data.draw(st.sampled_from([None, 0.1, 4.0]))
                live = LiveMap(folder / "map", config, session=str(k), window=window, scan_period_s=ANY_SCANS_S)
                begin_session(grid)
            live.integrate(scan)
            grid.integrate(scan)
            then = data.draw(st.sampled_from(["go on", "flush", "close"]))
            if then == "flush":
                live.flush()
            elif then == "close" or k == len(scans) - 1:
                live.close()
                assert_same_surfaces(live.surfaces, grid.surfaces, with_lines=evidence == "surface")
                live = None
        if live is not None:
            live.close()
        saved = open_map(folder / "map")
        assert_same_intervals(saved, grid)
        assert_same_surfaces(saved.surfaces, grid.surfaces, with_lines=evidence == "surface")
