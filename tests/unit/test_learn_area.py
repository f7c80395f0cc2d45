"""Objects found later: areas that are due, and what learning them changes."""

from __future__ import annotations

import numpy as np
import pytest

from tempog import GridConfig, MapConfig, ObjectTracker, Scan, TemporalGrid, build_grid, find_objects
from tempog.analysis.objects import timeline_of
from tempog.analysis.static import CellClass
from tempog.analysis.unexplained import STAY_S, Unexplained
from tempog.errors import ConfigError, EmptyWindowError
from tempog.sensing.grid_spec import Bounds, GridSpec
from tempog.sensing.tiles import CellBox, TileIndex
from tempog.simulation import corridor, load_world, simulate
from tempog.views.objects import draw_objects, draw_people

NS = 10**9


def cells_of(found):
    return [place.cells.tolist() for place in found.configurations]


def drawn(figure):
    return np.asarray(figure.axes[0].images[0].get_array())


@pytest.fixture(scope="module")
def scans():
    return simulate(corridor()).scans


def drive(scans, known: int):
    """A tracker of what was known after some scans, which then follows the others; yields both every 5 s."""
    grid = TemporalGrid(scan_period_s=0.1)
    grid.integrate_many(scans[:known])
    tracker = ObjectTracker(find_objects(grid))
    for k, scan in enumerate(scans[known:], 1):
        grid.integrate(scan)
        tracker.update(scan)
        if k % 50 == 0:
            yield grid, tracker


def test_a_door_that_first_moves_later_makes_its_area_due_and_is_learned(scans) -> None:
    learned = []
    for grid, tracker in drive(scans, known=120):  # 12 s: the door has not moved yet
        assert learned or not tracker.found.objects
        for area in tracker.due():
            change = tracker.learn(grid, area)
            learned.append(change)
            # As good as a full analysis at the same time.
            now = find_objects(grid)
            theirs = [place for place in now.configurations if area.holds(place.points_map).any()]
            mine = [place for place in tracker.found.configurations if area.holds(place.points_map).any()]
            assert sorted(place.cells.tolist() for place in mine) == sorted(place.cells.tolist() for place in theirs)
            assert sorted(place.periods for place in mine) == sorted(place.periods for place in theirs)
            for place in mine:
                if place.id in change.new_configurations:
                    assert tracker.state(place.id) == place.periods[-1].state
            for one in tracker.found.objects:
                ids = {place.id for place in one.configurations}
                assert ids >= {period.configuration for period in one.timeline} - {None}
            at = area.holds(tracker.found.static_points_map), area.holds(now.static_points_map)
            assert at[0].sum() == at[1].sum()
    (door,) = tracker.found.objects
    assert len(door.configurations) == 2
    assert tracker.where(door.id) in [place.id for place in door.configurations]
    # Each id is new once, and nothing is learned without end.
    ids = [i for change in learned for i in change.new_configurations]
    assert sorted(ids) == sorted(set(ids))
    assert len(learned) <= 12


def test_what_was_found_in_a_grid_is_still_all_there_after_the_grid_has_grown() -> None:
    scans = simulate(load_world("hallway", 3), 120.0, seed=3, people=2).scans
    grid = TemporalGrid(scan_period_s=0.1)
    grid.integrate_many(scans[:300])
    found = find_objects(grid)
    before, extent, walls = found.document(), grid.extent, found.static_points_map
    moving = found.high_dynamic("+10").cells
    picture = drawn(draw_objects(found))
    grid.integrate_many(scans[300:])
    assert grid.extent != extent == found.extent
    after = found.document()
    assert [after[part] for part in ("static", "objects", "unassociated")] == [
        before[part] for part in ("static", "objects", "unassociated")
    ]
    np.testing.assert_array_equal(found.static_points_map, walls)
    assert len(walls) > 1000
    np.testing.assert_array_equal(found.high_dynamic("+10").cells, moving)
    np.testing.assert_array_equal(drawn(draw_objects(found)), picture)
    draw_people(found)  # over the extent of now
    over = found.walls_over(grid.extent)
    rows, cols = np.nonzero(over == CellClass.STATIC)
    centres = grid.tiles.spec.centres(rows + grid.extent.row0, cols + grid.extent.col0)
    np.testing.assert_array_equal(centres, walls)


def test_places_that_the_history_does_not_bear_out_are_retired_and_their_ids_with_them(scans) -> None:
    grid = build_grid(scans)
    tracker = ObjectTracker(find_objects(grid))
    for scan in scans:
        tracker.update(scan)
    (door,) = tracker.found.objects
    closed, opened = door.configurations
    around = Bounds(6.0, 8.5, 2.0, 4.0)

    again = tracker.learn(grid, around)
    assert not any(again)
    assert [one.id for one in tracker.found.objects] == [door.id]
    assert tracker.found.objects[0].timeline == door.timeline
    assert tracker.where(door.id) == closed.id

    never_open = tracker.learn(grid.window("+5", "+10"), around)
    assert never_open.retired_configurations == (closed.id, opened.id)
    assert never_open.retired_objects == (door.id,)
    assert tracker.found.configurations == () == tracker.found.objects
    with pytest.raises(ConfigError, match="there is no place"):
        tracker.state(closed.id)

    back = tracker.learn(grid, around)
    assert back.new_configurations == (closed.id + 2, opened.id + 2)
    assert back.new_objects == (door.id + 1,)


def test_outside_the_rectangle_nothing_changes() -> None:
    simulation = simulate(load_world("rooms"), duration_s=300.0, seed=4)
    grid = build_grid(simulation.scans)
    found = find_objects(grid.window("+0", "+200"))
    assert len(found.configurations) > 3
    tracker = ObjectTracker(found)
    first = found.configurations[0]
    x, y = first.centre_m
    bounds = Bounds(x, x, y, y).grown(0.8)
    learned = tracker.learn(grid, bounds)
    affected = {first.id} | {i for change in learned for i in change}
    for one in found.objects:
        ids = {place.id for place in one.configurations}
        if any(bounds.holds(place.points_map).any() for place in one.configurations):
            affected |= ids
    kept = [place for place in found.configurations if place.id not in affected]
    assert kept
    now = {place.id: place for place in tracker.found.configurations}
    n_same = sum(now.get(place.id) is place for place in kept)
    assert n_same >= len(kept) - 2  # partners of what was found in the rectangle
    rows, cols = np.indices(found.walls.shape).reshape(2, -1)
    extent = found.history.extent
    outside = ~bounds.holds(GridSpec(extent.resolution_m).centres(rows + extent.row0, cols + extent.col0))
    differs = (found.walls != tracker.found.walls).ravel() & outside
    assert np.all(tracker.found.walls.ravel()[differs] == CellClass.CHANGING)


def test_a_tracker_that_knows_nothing_yet_learns_the_walls(scans) -> None:
    for grid, tracker in drive(scans, known=1):
        for area in tracker.due():
            tracker.learn(grid, area)
    static = len(tracker.found.static_points_map)
    assert static > 0.85 * len(find_objects(grid).static_points_map)


def test_memory_and_areas_due_stay_bounded(scans) -> None:
    sizes = []
    tracker = ObjectTracker(find_objects(build_grid(scans[:120])))
    for lap in range(3):
        for scan in scans[120::2]:
            again = type(scan)(
                0.0,
                (scan.x, scan.y, scan.theta),
                scan.angles,
                scan.ranges,
                scan.max_range,
                stamp_ns=scan.stamp_ns + lap * 200 * NS,
            )
            tracker.update(again)
        sizes.append((tracker.memory_bytes, len(tracker.due())))
    assert sizes[2][0] <= 1.2 * sizes[1][0]
    assert 1 <= sizes[2][1] <= 5


def one_tile() -> TileIndex:
    tiles = TileIndex(GridSpec(0.1), 10**6)
    tiles.cover(CellBox(0, 7, 0, 7), "a test")
    return TileIndex.from_tiles(GridSpec(0.1), 10**6, np.zeros(1, np.int32), np.zeros(1, np.int32))


def watch(unexplained: Unexplained, start_s: float, lasts_s: float, strange: bool, n: int = 4) -> None:
    cells = np.arange(n, dtype=np.int32)
    for k in range(round(lasts_s * 10)):
        unexplained.look(round((start_s + k / 10) * NS), 64, cells, np.full(n, strange))


def test_who_stands_for_long_is_due_and_who_passes_is_not() -> None:
    tiles, cells = one_tile(), np.arange(64, dtype=np.int32)
    passing = Unexplained()
    for k in range(20):
        watch(passing, 10.0 * k, 0.5, strange=True)
        watch(passing, 10.0 * k + 0.5, 9.5, strange=False)
    assert passing.areas(tiles) == []

    standing = Unexplained()
    watch(standing, 0.0, STAY_S - 1, strange=True)
    assert standing.areas(tiles) == []
    watch(standing, STAY_S - 1, 2.0, strange=True)
    (area,) = standing.areas(tiles)
    assert area.holds(np.array([[0.05, 0.05], [0.35, 0.05]])).all()

    # Learned in vain, it is due again only after twice the time.
    standing.learned(cells)
    assert standing.areas(tiles) == []
    watch(standing, STAY_S + 1, STAY_S - 2, strange=True)
    assert standing.areas(tiles) == []
    watch(standing, 2 * STAY_S - 1, 2.0, strange=True)
    assert standing.areas(tiles) != []


def test_what_comes_back_is_due_and_a_single_cell_is_not() -> None:
    tiles = one_tile()
    for n, due in ((4, 1), (1, 0)):
        again = Unexplained()
        for k in range(2):
            assert again.areas(tiles) == []
            watch(again, 30.0 * k, 3.0, strange=True, n=n)
            watch(again, 30.0 * k + 3, 5.0, strange=False, n=n)
        assert len(again.areas(tiles)) == due


def test_a_tracker_refuses_another_lattice_and_unmapped_areas(scans) -> None:
    grid = build_grid(scans[:120])
    tracker = ObjectTracker(find_objects(grid))
    coarse = build_grid(scans[:20], MapConfig(grid=GridConfig(resolution_m=0.1)))
    with pytest.raises(ConfigError, match=r"0\.1 m"):
        tracker.learn(coarse, Bounds(0, 1, 0, 1))
    with pytest.raises(EmptyWindowError):
        tracker.learn(grid, Bounds(500, 501, 0, 1))
    assert tracker.found.history is grid


def test_a_map_of_another_day_that_reaches_less_far_teaches_what_it_holds(scans) -> None:
    found = find_objects(build_grid(scans))
    tracker, today = ObjectTracker(found), TemporalGrid(scan_period_s=0.1)
    for scan in scans[:1200]:
        ranges = np.where(scan.ranges < 3.0, scan.ranges, np.nan)
        pose = (scan.x, scan.y, scan.theta)
        today.integrate(Scan(0.0, pose, scan.angles, ranges, stamp_ns=scan.stamp_ns + 86_400 * NS))
    assert today.extent.n_rows < found.extent.n_rows
    around = Bounds(6.0, 8.5, 2.0, 4.0)
    tracker.learn(today, around)
    now = tracker.found
    assert now.extent == found.extent
    outside = ~around.holds(found.static_points_map), ~around.holds(now.static_points_map)
    np.testing.assert_array_equal(now.static_points_map[outside[1]], found.static_points_map[outside[0]])
    assert len(now.high_dynamics(every_s=10.0)) == 12  # over the extent of today
    ids = {place.id for place in now.configurations}
    for one in now.objects:
        assert {period.configuration for period in one.timeline} <= ids | {None}


def test_learning_from_a_window_keeps_all_that_is_known_from_before(scans) -> None:
    grid = build_grid(scans)
    tracker = ObjectTracker(find_objects(grid))
    (door,) = tracker.found.objects
    start_ns = grid.parse_moment("+27")
    assert any(start < start_ns < stop for start, stop, _ in door.timeline)
    tracker.learn(grid.window("+27"), Bounds(6.0, 8.5, 2.0, 4.0))
    (now,) = tracker.found.objects

    def before(periods):
        return [(start, min(stop, start_ns), what) for start, stop, what in periods if start < start_ns]

    assert before(now.timeline) == before(door.timeline)
    for place, was in zip(now.configurations, door.configurations, strict=True):
        assert before(place.periods) == before(was.periods)
    everything = timeline_of(now.configurations)
    assert (now.timeline, now.common_s, now.none_s, now.both_s) == everything


def test_what_is_left_of_an_object_is_told_as_what_it_is_now(scans) -> None:
    grid = build_grid(scans)
    tracker = ObjectTracker(find_objects(grid))
    closed, opened = tracker.found.objects[0].configurations
    learned = tracker.learn(grid.window("+0", "+10"), Bounds(7.3, 7.5, 3.3, 3.5))  # an end of the open leaf
    assert opened.id in learned.retired_configurations
    (left,) = tracker.found.objects
    assert [place.id for place in left.configurations] == [closed.id]
    assert left.confidence is None
    assert (left.timeline, left.common_s, left.none_s, left.both_s) == timeline_of([closed])
    assert set(left.shares) == {closed.id, None}
