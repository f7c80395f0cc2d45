"""A rectangle of a history answers as the whole history does there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fixed_history import strand_of_small_segments
from same_answers import assert_same_analyses, assert_same_states
from tempog import LiveMap, build_grid, find_objects, map_dynamics, open_map, save_map
from tempog.errors import ConfigError, EmptyWindowError
from tempog.grid.merged import Merged
from tempog.simulation import corridor, simulate
from tempog.store import committer, segment_files, strand, tables


@pytest.fixture(scope="module")
def grid():
    return build_grid(simulate(corridor(), duration_s=120.0).scans)


def part_of(dense, whole, area):
    row, col = area.extent.row0 - whole.extent.row0, area.extent.col0 - whole.extent.col0
    return dense[row : row + area.extent.n_rows, col : col + area.extent.n_cols]


def test_states_dynamics_and_histories_are_those_of_the_whole(grid) -> None:
    area = grid.area(5.0, 9.0, 1.9, 4.0)
    assert 0 < area.n_intervals < grid.n_intervals / 2
    for t in ("+1", "+40", "+110"):
        np.testing.assert_array_equal(
            area.at(t, hold=math.inf).value, part_of(grid.at(t, math.inf).value, grid, area)
        )
    np.testing.assert_array_equal(map_dynamics(area), part_of(map_dynamics(grid), grid, area))
    for x, y in ((6.98, 2.53), (7.4, 3.2), (5.02, 2.0)):
        mine, whole = area.history(x, y), grid.history(x, y)
        assert list(mine) == list(whole)
    assert len(area.history(1.0, 2.0)) == 0


def test_a_period_of_an_area_is_an_area_of_the_period(grid) -> None:
    one, other = grid.window("+20", "+60").area(5, 9, 2, 4), grid.area(5, 9, 2, 4).window("+20", "+60")
    assert one.n_intervals == other.n_intervals < grid.area(5, 9, 2, 4).n_intervals
    np.testing.assert_array_equal(map_dynamics(one), map_dynamics(other))


def test_the_area_of_everything_holds_the_same_objects(grid, tmp_path) -> None:
    full = find_objects(grid)
    assert len(full.objects) == 1
    for history in (grid, open_map(save_map(grid, tmp_path / "c.tempog"))):
        for bounds in (grid.extent.bounds, (2.0, 12.0, -2.0, 8.0)):
            found = find_objects(history.area(*bounds))
            assert [one.cells.tolist() for one in found.configurations] == [
                one.cells.tolist() for one in full.configurations
            ]
            assert [one.timeline for one in found.objects] == [one.timeline for one in full.objects]


def test_what_is_no_area_is_refused(grid) -> None:
    for wrong in ((1, 0, 0, 1), (0, 1, 1, 0), (0, math.nan, 0, 1), (0, math.inf, 0, 1)):
        with pytest.raises(ConfigError, match="no rectangle"):
            grid.area(*wrong)
    with pytest.raises(EmptyWindowError, match="the map covers"):
        grid.area(500, 501, 0, 1)


# What is read of a map on disk.

DOOR = (6.5, 7.2, 2.3, 2.8)
ROWS = 500  # of a group; the area has some 2000 of 130 000


class Reads:
    """Which intervals were read: rows of each segment's tables, by table."""

    def __init__(self, monkeypatch) -> None:
        self.rows: dict = {"intervals": {}, "open": {}}
        whole = segment_files.read_table

        def read_table(path, wanted, tiles=None):
            columns = whole(path, wanted, tiles)
            if path.stem in self.rows:
                rows = self.rows[path.stem]
                rows[path.parent.name] = rows.get(path.parent.name, 0) + len(columns["cell"])
            return columns

        monkeypatch.setattr(segment_files, "read_table", read_table)

    def of(self, question) -> tuple[int, int, int]:
        """How many segments a question read intervals of that ended, how many of them, and of those going on."""
        self.rows = {"intervals": {}, "open": {}}
        question()
        ended = self.rows["intervals"]
        return len(ended), sum(ended.values()), sum(self.rows["open"].values())


@pytest.fixture(params=["saved", "live", "merged", "chosen"])
def on_disk(request, grid, tmp_path, monkeypatch):
    """The grid in some twenty segments on disk, of small groups of rows, and the same in memory."""
    monkeypatch.setattr(tables, "ROWS_PER_GROUP", ROWS)
    monkeypatch.setattr(strand, "HELD_PARTS", 0)
    monkeypatch.setattr(committer, "FANOUT", 1000)
    scans = simulate(corridor(), duration_s=120.0).scans
    if request.param == "live":
        live = LiveMap(tmp_path / "map", grid.config, window=1e-9, flush_s=6.0)
        live.integrate_many(scans)
        live.flush()
        yield live, grid
        live.close()
        return
    saved = strand_of_small_segments(grid, tmp_path, grid.n_intervals // 20)
    if request.param == "saved":
        yield saved, grid
    elif request.param == "chosen":
        yield Merged([saved], [np.ones(grid.n_scans, dtype=bool)]), grid
    else:
        beside = build_grid(scans[:20])
        other = strand_of_small_segments(beside, tmp_path / "other", 10**6)
        yield Merged([saved, other]), Merged([grid, beside])


def test_an_area_reads_only_its_tiles_and_its_time(on_disk, monkeypatch) -> None:
    history, in_memory = on_disk
    area, n_cells = history.area(*DOOR), in_memory.n_cells
    reads = Reads(monkeypatch)
    n_segments, n_ended, _ = reads.of(area.all_runs)
    assert n_segments > 15
    assert area.n_intervals < 0.02 * in_memory.n_intervals
    assert n_ended < 0.15 * in_memory.n_intervals
    n_read, n_ended, n_open = reads.of(lambda: area.at("+60", 1.0))
    assert 1 <= n_read <= 4
    assert n_ended <= 2 * ROWS * n_read
    assert n_open < 0.25 * n_cells
    for part in (history.window("+40", "+60").area(*DOOR), area.window("+40", "+60")):
        n_read, n_ended, n_open = reads.of(part.all_runs)
        assert 3 <= n_read < n_segments / 2
        assert n_ended <= 2 * ROWS * n_read
        assert n_open < 0.25 * n_cells


def test_tiles_that_were_seen_first_and_last_are_read_without_those_between(on_disk, monkeypatch) -> None:
    history, _ = on_disk
    reads = Reads(monkeypatch)
    tiles = np.array([0, history.tiles.n_tiles - 1], dtype=np.int32)
    n_read, n_ended, _ = reads.of(lambda: list(history.runs_of_tiles(tiles)))
    assert n_ended <= 3 * ROWS * n_read  # a tile's rows may be in two groups


def test_what_an_area_reads_is_enough(on_disk) -> None:
    history, in_memory = on_disk
    for t in ("+1", "+33", "+60", "+119"):
        assert_same_states(history.area(*DOOR), in_memory.area(*DOOR), in_memory.parse_moment(t), 1.0)
    mine, theirs = history.window("+40", "+60"), in_memory.window("+40", "+60")
    assert_same_analyses(mine.area(*DOOR), theirs.area(*DOOR))
    assert_same_analyses(history.area(*DOOR).window("+40", "+60"), theirs.area(*DOOR))


def test_a_small_area_that_is_asked_again_is_not_read_again(grid, tmp_path, monkeypatch) -> None:
    saved = strand_of_small_segments(grid, tmp_path, grid.n_intervals // 20)
    reads, area = Reads(monkeypatch), saved.area(*DOOR)
    n_segments, *_ = reads.of(area.all_runs)
    assert n_segments == len(saved.segments)
    assert reads.of(area.all_runs) == (0, 0, 0)
    assert reads.of(lambda: area.window("+40", "+60").n_intervals)[:2] == (0, 0)
