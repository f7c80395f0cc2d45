"""What appeared, vanished or moved between two moments, where the truth is known."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from tempog import ConfigError, History, MapDiff, Scan, TemporalGrid, TimeError, build_grid, find_objects, map_diff
from tempog.analysis.configurations import Configuration, Period
from tempog.analysis.moved_objects import moved_objects, whereabouts
from tempog.analysis.objects import MovingObject, timeline_of
from tempog.errors import MomentError
from tempog.simulation import corridor, load_world, simulate
from tempog.simulation.simulation import MOVING
from tempog.simulation.truth import Truth
from tempog.views.diff import draw_diff

ANGLES = np.linspace(-0.6, 0.6, 241)
WALL_M = 4.0
FAR_M = 1e6  # a box that is not there
S = 10**9
World = Callable[[float], tuple[float, float]]  # at a time: how far the wall is, and the box in front of it


def ranges(wall_m: float, box_m: float) -> np.ndarray:
    """Of a laser at the origin that looks along x: a wall across, and the face of a box 0.6 m wide before it."""
    to_wall, to_box = wall_m / np.cos(ANGLES), box_m / np.cos(ANGLES)
    return np.where(abs(box_m * np.tan(ANGLES)) <= 0.3, np.minimum(to_box, to_wall), to_wall)


def watched(world: World, until_s: float = 120.0, unseen: tuple[float, float] = (math.inf, math.inf)) -> TemporalGrid:
    """Ten looks a second; in between the robot looks the other way."""
    grid = TemporalGrid(scan_period_s=0.1)
    for t in np.arange(0.0, until_s, 0.1):
        away = unseen[0] <= t < unseen[1]
        beams = np.full(len(ANGLES), 1.0) if away else ranges(*world(t))
        grid.integrate(Scan(1000.0 + t, (0.02, 0.02, math.pi if away else 0.0), ANGLES, beams, max_range=10.0))
    return grid


def changes_of(history: History, t1: str, t2: str, **settings: float) -> MapDiff:
    """What changed, as if no object were known: the box is one, else."""
    found = dataclasses.replace(find_objects(history), configurations=(), objects=())
    return map_diff(history, t1, t2, found=found, **settings)


def box_between(since_s: float, until_s: float) -> World:
    return lambda t: (WALL_M, 2.0 if since_s <= t < until_s else FAR_M)


def test_a_box_that_was_put_there_appeared():
    diff = changes_of(watched(box_between(60.0, math.inf)), "+30", "+110")
    (box,) = diff.appeared
    assert not diff.moved
    assert not diff.vanished
    assert not diff.brief
    assert box.centre_m == pytest.approx((2.03, 0.02), abs=0.05)
    assert box.bounds.y_max - box.bounds.y_min == pytest.approx(0.6, abs=0.11)
    assert box.area_m2 == pytest.approx(len(box.cells) * 0.05**2)
    assert box.first_after_ns == pytest.approx(1060 * S, abs=S)
    assert box.last_before_ns == pytest.approx(1060 * S, abs=S)
    assert box.watched_s == pytest.approx(60.0, abs=1.0)
    assert (box.age_before_s, box.age_after_s) == pytest.approx((0.0, 0.0), abs=0.11)


def test_a_known_object_comes_and_is_not_reported_twice():
    diff = map_diff(watched(box_between(60.0, math.inf)), "+30", "+110")
    (move,) = diff.moved
    assert (move.before.configuration, move.after.configuration) == (None, move.one.configurations[0].id)
    assert (diff.appeared, diff.vanished, diff.brief) == ((), (), ())


def test_a_box_that_was_taken_away_vanished():
    diff = changes_of(watched(box_between(0.0, 60.0)), "+30", "+110")
    (box,) = diff.vanished
    assert (diff.moved, diff.appeared, diff.brief) == ((), (), ())
    assert box.centre_m == pytest.approx((2.03, 0.02), abs=0.05)
    assert box.last_before_ns == pytest.approx(1060 * S, abs=S)


@pytest.mark.parametrize(("stays_s", "listed"), [(10.0, False), (30.0, True)])
def test_whoever_waits_is_brief_whether_gone_or_still_there(stays_s, listed):
    grid = watched(box_between(60.0, 60.0 + stays_s))
    coming, going = changes_of(grid, "+30", "+65"), changes_of(grid, "+65", "+110")
    assert [len(diff.brief) for diff in (coming, going)] == ([0, 0] if listed else [1, 1])
    assert (len(coming.appeared), len(going.vanished)) == ((1, 1) if listed else (0, 0))
    assert len(changes_of(grid, "+30", "+65", for_s=5.0).appeared) == 1


def test_what_was_glimpsed_twice_was_not_watched_in_between():
    grid = watched(box_between(60.0, 110.0), unseen=(64.0, 106.0))
    diff = changes_of(grid, "+30", "+62")
    assert not diff.appeared
    (box,) = diff.brief
    assert box.watched_s == pytest.approx(8.0, abs=1.0)


def test_a_surface_seen_a_little_displaced_is_no_change():
    def shifted(by_m: float) -> TemporalGrid:
        return watched(lambda t: (WALL_M - (by_m if t >= 60 else 0.0), FAR_M))

    assert not changes_of(shifted(0.15), "+30", "+110").changes
    assert changes_of(shifted(0.15), "+30", "+110", surface_m=0.0).changes
    assert changes_of(shifted(0.6), "+30", "+110").appeared


def test_small_things_are_dropped():
    grid = watched(box_between(60.0, math.inf))
    assert not changes_of(grid, "+30", "+110", smallest_m=1.0).changes


def test_what_was_not_seen_again_is_no_change_but_counted():
    grid = watched(box_between(60.0, math.inf), unseen=(50.0, 1000.0))
    diff = changes_of(grid, "+30", "+110")
    assert not diff.changes
    assert not diff.brief
    assert diff.areas.compared_m2 > 0  # looked at until +50
    later = changes_of(grid, "+49.95", "+110")
    assert later.areas.compared_m2 <= 0.05**2  # the robot's own cell
    assert sum(later.areas[:2]) == pytest.approx(sum(diff.areas[:2]))  # all that was known before
    assert later.areas.first_seen_m2 > 0  # where it looks now
    assert later.not_seen_again.sum() * 0.05**2 == pytest.approx(later.areas.not_seen_again_m2)


def test_old_looks_may_be_refused():
    grid = watched(box_between(30.0, math.inf), unseen=(60.0, 1000.0))
    assert changes_of(grid, "+20", "+110").appeared
    diff = changes_of(grid, "+20", "+110", hold=20.0)
    assert not diff.changes
    assert diff.areas.compared_m2 <= 0.05**2
    assert changes_of(grid, "+20", "+70", hold=20.0).appeared


def test_a_map_that_grows_is_drawn_with_what_was_not_seen_again_in_its_place():
    grid = watched(box_between(60.0, math.inf), unseen=(50.0, 1000.0))
    diff = map_diff(grid, "+49.95", "+110")
    extent = diff.extent
    grid.integrate(Scan(2000.0, (-9.0, -9.0, math.pi), [0.0], [5.0]))
    assert grid.extent.row0 < extent.row0
    figure = draw_diff(diff)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    rgb = np.asarray(axes.images[0].get_array())
    x_min, _, y_min, _ = axes.images[0].get_extent()
    at = rgb[int((0.02 - y_min) / 0.05), int((1.5 - x_min) / 0.05)]
    assert at == pytest.approx((0.93, 0.90, 0.72), abs=1e-6)


def test_the_corridors_door_moves_when_it_truly_did():
    simulation = simulate(corridor())
    truth, grid = Truth.of(simulation), build_grid(simulation.scans)
    found = find_objects(grid)
    (door,) = found.objects
    rests = truth.places[:, 0] != MOVING
    moments = [k for k in range(100, len(truth.t), 150) if rests[k - 30 : k + 1].all()]
    n_moved = 0
    for i, before in enumerate(moments):
        for after in moments[i + 1 :]:
            t1, t2 = (np.datetime64(int(grid.stamps_ns[k]), "ns") for k in (before, after))
            diff = map_diff(grid, t1, t2, found=found)
            seen = [
                truth.places[np.searchsorted(grid.stamps_ns, stamp) - 1, 0]
                for where in [whereabouts(door, int(grid.stamps_ns[k])) for k in (before, after)]
                if where is not None
                for stamp in [where.last_seen_ns]
            ]
            assert len(diff.moved) == (len(seen) == 2 and seen[0] != seen[1])
            assert not diff.appeared
            assert not diff.vanished
            n_moved += len(diff.moved)
    assert n_moved > 10


def test_boxes_of_an_office_move_and_are_not_reported_twice():
    simulation = simulate(load_world("office"), duration_s=600.0, seed=210, people=0)
    truth, grid = Truth.of(simulation), build_grid(simulation.scans)
    found = find_objects(grid)
    diff = map_diff(grid, "+250", "+590", found=found)
    boxes = [k for k, thing in enumerate(truth.things) if thing.kind == "box"]
    n_boxes = 0
    for move in diff.moved:
        places = [move.place(where) for where in (move.before, move.after)]
        for place, stamp in zip(places, (move.before.last_seen_ns, move.after.last_seen_ns), strict=True):
            if place is None:
                continue
            scan = np.searchsorted(grid.stamps_ns, stamp) - 1
            corners = truth.corners[scan].mean(axis=1)
            off_m = np.hypot(*(corners - place.centre_m).T)
            assert np.nanmin(off_m) < 0.5
            n_boxes += np.nanargmin(off_m) in boxes
        for patch in (*diff.appeared, *diff.vanished, *diff.brief):
            assert not {tuple(cell) for cell in patch.cells} & {
                tuple(cell) for place in move.one.configurations for cell in place.cells
            }
    assert len(diff.moved) >= 8
    assert n_boxes >= 1


def course(*periods: tuple[float, float, str]) -> tuple[Period, ...]:
    return tuple(Period(round(a * S), round(b * S), state) for a, b, state in periods)


def thing(*courses: tuple[Period, ...]) -> MovingObject:
    nowhere = np.empty((0, 2))
    places = tuple(Configuration(k + 1, nowhere, nowhere, periods) for k, periods in enumerate(courses))
    timeline, *seconds = timeline_of(places)
    return MovingObject(1, places, timeline, *seconds, confidence=None)


def test_a_thing_of_one_place_comes_and_goes():
    one = thing(course((0, 10, "occupied"), (10, 20, "free"), (50, 60, "occupied")))
    (move,), unseen = moved_objects([one], 5 * S, 15 * S, math.inf)
    assert (move.before.configuration, move.after.configuration, move.n_moves) == (1, None, 1)
    assert not unseen
    (move,), _ = moved_objects([one], 15 * S, 55 * S, math.inf)
    assert (move.before.configuration, move.after.configuration) == (None, 1)
    assert moved_objects([one], 5 * S, 55 * S, math.inf) == ([], [])


def test_an_object_nobody_looked_at_since_is_said_to_be_so():
    one = thing(course((0, 10, "occupied"), (60, 70, "free")), course((0, 10, "free"), (60, 70, "occupied")))
    assert moved_objects([one], 20 * S, 50 * S, math.inf) == ([], [1])
    (move,), unseen = moved_objects([one], 20 * S, 65 * S, math.inf)
    assert (move.before.configuration, move.after.configuration, unseen) == (1, 2, [])
    assert move.before.last_seen_ns == 10 * S
    assert moved_objects([one], 20 * S, 65 * S, 5.0) == ([], [])  # it was seen 10 s before, and that is too old
    assert moved_objects([one], 5 * S, 200 * S, 5.0) == ([], [1])


def test_an_object_that_moved_and_came_back_did_not_move():
    there, back = (
        course((0, 10, "occupied"), (10, 20, "free"), (20, 30, "occupied")),
        course((0, 10, "free"), (10, 20, "occupied"), (20, 30, "free")),
    )
    one = thing(there, back)
    assert moved_objects([one], 5 * S, 25 * S, math.inf) == ([], [])
    (move,), _ = moved_objects([one], 5 * S, 15 * S, math.inf)
    assert move.n_moves == 1


def test_errors_say_what_to_do():
    grid = watched(box_between(60.0, math.inf), until_s=5.0)
    with pytest.raises(MomentError, match=r"the first moment, .* comes after the second, .*; exchange the two"):
        map_diff(grid, "+3", "+2")
    for moments in (("+1", "+9"), (3.0, "+2")):
        with pytest.raises(TimeError, match=r"nothing is known of .*the scans run from .* to .*; choose"):
            map_diff(grid, *moments)
    with pytest.raises(TimeError, match="nothing is known"):
        map_diff(grid.window("+1", "+2"), "+0", "+2")
    with pytest.raises(TimeError, match="holds no scans yet"):
        map_diff(TemporalGrid(), "+0", "+1")
    for name in ("for_s", "smallest_m", "join_m", "surface_m", "hold"):
        with pytest.raises(ConfigError, match=f"{name} = -1"):
            map_diff(grid, "+1", "+2", **{name: -1.0})
    with pytest.raises(ConfigError, match="for_s = nan"):
        map_diff(grid, "+1", "+2", for_s=math.nan)


def test_a_window_knows_its_own_period_only():
    grid = watched(box_between(60.0, 90.0))
    assert changes_of(grid, "+30", "+65").appeared
    diff = changes_of(grid.window("+20", "+66"), "+30", "+65")
    assert not diff.appeared  # it was there for 6 s of that time
    assert len(diff.brief) == 1
