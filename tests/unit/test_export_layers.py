"""Layers, doors, ways and masks of an export, on cells made by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tempog import build_grid, find_objects
from tempog.analysis.configurations import Configuration, Period
from tempog.analysis.objects import MovingObject, ObjectPeriod, timeline_of
from tempog.analysis.static import CellClass
from tempog.errors import ConfigError, TimeError
from tempog.export.doors import hinge_of, leaf_cells, outline_of, swept_cells
from tempog.export.layers import planning_cells
from tempog.export.masks import grown, keepout_mask, speed_mask
from tempog.export.passages import blocks_way
from tempog.export.site_map import Thing, site_map
from tempog.scans.scan import Scan
from tempog.sensing.grid_spec import Extent
from tempog.simulation import corridor, simulate
from tempog.times import NS_PER_S

SIZE_M = 0.05
S = NS_PER_S


def place(number: int, points: list[tuple[float, float]], periods: tuple = ()) -> Configuration:
    at = np.array(points)
    cells = np.floor(at[:, ::-1] / SIZE_M).astype(np.int32)
    return Configuration(number, cells, at, periods)


def leaf(number: int, hinge: tuple[float, float], degrees: float, hidden_m: float = 0.0, length_m: float = 0.9):
    """Cells of a leaf in one place, but for its first part."""
    r = np.arange(hidden_m, length_m, SIZE_M / 2)
    x = hinge[0] + r * math.cos(math.radians(degrees))
    y = hinge[1] + r * math.sin(math.radians(degrees))
    cells = sorted(set(zip(np.floor(x / SIZE_M).tolist(), np.floor(y / SIZE_M).tolist(), strict=True)))
    return place(number, [((col + 0.5) * SIZE_M, (row + 0.5) * SIZE_M) for col, row in cells])


@pytest.mark.parametrize("turn", [-170, -90, -45, 30, 90, 120, 180])
@pytest.mark.parametrize("start", [0, 25, 135])
@pytest.mark.parametrize("hidden_m", [0.0, 0.3])
def test_a_leaf_that_turns_has_its_hinge_found(turn: float, start: float, hidden_m: float) -> None:
    hinge = hinge_of([leaf(1, (2.0, -3.0), start), leaf(2, (2.0, -3.0), start + turn, hidden_m)], SIZE_M)
    assert hinge is not None
    across = 0.12 if abs(turn) < 160 else hidden_m / 2 + 0.1  # nothing says where along a straight line it lies
    assert math.hypot(hinge.x - 2.0, hinge.y + 3.0) < across
    for degrees, (x, y) in zip((start, start + turn), hinge.tips, strict=True):
        end = 2.0 + 0.9 * math.cos(math.radians(degrees)), -3.0 + 0.9 * math.sin(math.radians(degrees))
        assert math.hypot(x - end[0], y - end[1]) < 0.25 + hidden_m / 2


def test_three_places_share_one_hinge() -> None:
    hinge = hinge_of([leaf(k, (0.0, 0.0), degrees) for k, degrees in enumerate((0, 45, 100))], SIZE_M)
    assert hinge is not None
    assert math.hypot(hinge.x, hinge.y) < 0.08
    assert hinge.length_m == pytest.approx(0.9, abs=0.1)


def square(number: int, x: float, y: float) -> Configuration:
    return place(number, [(x + a, y + b) for a in np.arange(0.025, 0.5, 0.05) for b in np.arange(0.025, 0.5, 0.05)])


@pytest.mark.parametrize(
    "places",
    [
        [leaf(1, (0, 0), 0)],
        [leaf(1, (0, 0), 0), leaf(2, (0, 0), 5)],  # hardly turned
        [leaf(1, (0, 0), 0), leaf(2, (3, 3), 90)],  # far apart
        [leaf(1, (0, 0), 0), leaf(2, (0, 1), 0)],  # beside each other
        [leaf(1, (0, 0), 0), leaf(2, (0, 0), 90, length_m=0.3)],  # too short to have a direction
        [leaf(1, (0, 0), 0, length_m=3.0), leaf(2, (0, 0), 90, length_m=3.0)],  # a gate that no leaf is
        [leaf(1, (0, 0), 0), leaf(2, (0.45, 0), 90)],  # meet in the middle of one
        [square(1, 0, 0), square(2, 0.5, 0.5)],  # a box
        [leaf(1, (0, 0), 0), square(2, 0, 0)],
    ],
)
def test_what_is_no_door_has_no_hinge(places: list[Configuration]) -> None:
    assert hinge_of(places, SIZE_M) is None


def test_leaf_cells_lie_along_the_leaf_and_spare_the_jamb() -> None:
    places = [leaf(1, (0.0, 0.0), 0), leaf(2, (0.0, 0.0), 90)]
    hinge = hinge_of(places, SIZE_M)
    assert hinge is not None
    extent = Extent(-40, -40, 80, 80, SIZE_M)
    y, x = ((leaf_cells(hinge, 1, extent) + 0.5) * SIZE_M).T
    assert np.abs(x).max() < 0.2
    assert (y.min(), y.max()) == (pytest.approx(0.2, abs=0.1), pytest.approx(1.0, abs=0.1))


@pytest.mark.parametrize(
    ("degrees", "share"),
    [((0, 90), 1 / 4), ((350, 80), 1 / 4), ((0, 45, 100), 100 / 360), ((0, 180), 1), ((10, 200), 1)],
)
def test_a_leaf_sweeps_the_sector_between_its_places(degrees: tuple[float, ...], share: float) -> None:
    hinge = hinge_of([leaf(k, (1.0, 1.0), one) for k, one in enumerate(degrees)], SIZE_M)
    assert hinge is not None
    swept = swept_cells(hinge, Extent(-10, -10, 80, 80, SIZE_M))
    whole = math.pi * hinge.length_m**2 / SIZE_M**2
    assert len(swept) / whole == pytest.approx(share, abs=0.08)
    assert len(swept_cells(hinge, Extent(25, 25, 80, 80, SIZE_M))) < len(swept)  # cut at the map's rim


def test_an_outline_is_convex_and_holds_all_cells() -> None:
    corners = np.array(outline_of(leaf(1, (0.2, 0.1), 30), SIZE_M))
    ahead = np.roll(corners, -1, axis=0) - corners
    turn = np.roll(ahead, -1, axis=0)
    assert (ahead[:, 0] * turn[:, 1] - ahead[:, 1] * turn[:, 0] > 0).all()
    for x, y in leaf(1, (0.2, 0.1), 30).points_map:
        to_point = np.array([x, y]) - corners
        assert (ahead[:, 0] * to_point[:, 1] - ahead[:, 1] * to_point[:, 0] >= 0).all()


def room_with_door() -> tuple[np.ndarray, Extent]:
    """A wall from west to east with a doorway of 0.9 m in the middle of it."""
    floor = np.ones((80, 80), dtype=np.bool_)
    floor[40:43] = False
    floor[40:43, 31:49] = True
    return floor, Extent(-40, -40, 80, 80, SIZE_M)


def test_a_closed_leaf_blocks_a_way_and_an_open_one_does_not() -> None:
    floor, extent = room_with_door()
    hinge = (-9 * SIZE_M, 0.02)
    assert blocks_way(floor, leaf(1, hinge, 0).cells, extent)
    assert not blocks_way(floor, leaf(1, hinge, 90).cells, extent)
    assert not blocks_way(floor, leaf(1, hinge, -90).cells, extent)
    assert not blocks_way(floor, leaf(1, hinge, 0, length_m=0.4).cells, extent)  # half a metre is left


def test_a_slit_at_the_hinge_is_no_way() -> None:
    floor, extent = room_with_door()
    assert blocks_way(floor, leaf(1, (-9 * SIZE_M, 0.02), 0, hidden_m=0.1).cells, extent)


def test_where_no_floor_is_known_behind_nothing_is_blocked() -> None:
    floor, extent = room_with_door()
    floor[43:] = False
    assert not blocks_way(floor, leaf(1, (-9 * SIZE_M, 0.02), 0).cells, extent)
    assert not blocks_way(np.zeros_like(floor), leaf(1, (0, 0), 0).cells, extent)


def layers(n: int = 40) -> dict[str, np.ndarray]:
    """Free floor, seen for ten minutes."""
    return {
        "classes": np.full((n, n), CellClass.FREE, dtype=np.int8),
        "share": np.zeros((n, n), dtype=np.float32),
        "seen_s": np.full((n, n), 600, dtype=np.float32),
        "places": np.zeros((n, n), dtype=np.bool_),
        "guessed": np.zeros((n, n), dtype=np.bool_),
    }


def test_walls_and_glass_are_occupied_and_doors_are_not() -> None:
    given = layers()
    given["classes"][0], given["share"][0] = CellClass.STATIC, 0.95
    given["classes"][39], given["share"][39] = CellClass.UNCERTAIN, 0.5
    given["classes"][20, 5:15], given["share"][20, 5:15], given["places"][20, 5:15] = CellClass.CHANGING, 0.9, True
    given["classes"][30] = CellClass.UNEXPLORED
    cells = planning_cells(**given, resolution_m=SIZE_M)
    assert (cells[0] == 100).all()
    assert (cells[39] == 100).all()
    assert (cells[20] == 0).all()
    assert (cells[30] == -1).all()


def test_a_walls_rim_is_wall_and_what_came_and_went_is_floor() -> None:
    given = layers()
    given["classes"][0], given["share"][0] = CellClass.STATIC, 0.95
    for row, share in ((1, 0.6), (2, 0.3), (20, 0.6)):
        given["classes"][row], given["share"][row] = CellClass.CHANGING, share
    cells = planning_cells(**given, resolution_m=SIZE_M)
    assert [int(cells[row, 0]) for row in (0, 1, 2, 20)] == [100, 100, 0, 0]


def test_beside_a_door_a_rim_is_of_the_door() -> None:
    given = layers()
    given["classes"][:, 0], given["share"][:, 0] = CellClass.STATIC, 0.95
    given["classes"][20, 1:15], given["share"][20, 1:15], given["places"][20, 1:15] = CellClass.CHANGING, 0.7, True
    given["classes"][21, 1:15], given["share"][21, 1:15] = CellClass.CHANGING, 0.6
    cells = planning_cells(**given, resolution_m=SIZE_M)
    assert (cells[20:22, 1:] == 0).all()
    assert (cells[:, 0] == 100).all()


def test_who_was_seen_once_is_unknown_and_who_was_watched_is_not() -> None:
    given = layers()
    for row, seen_s in ((10, 5.0), (25, 100.0)):
        given["classes"][row, 10:16], given["share"][row, 10:16] = CellClass.STATIC, 1.0
        given["seen_s"][row, 10:16] = seen_s
    given["classes"][35, 2:38], given["share"][35, 2:38], given["seen_s"][35, 2:38] = CellClass.STATIC, 1.0, 5.0
    cells = planning_cells(**given, resolution_m=SIZE_M)
    assert (cells[10, 10:16] == -1).all()
    assert (cells[25, 10:16] == 100).all()
    assert (cells[35, 2:38] == 100).all()  # too long for somebody: a wall far away


def test_a_place_that_is_a_hypothesis_is_unknown_floor() -> None:
    given = layers()
    given["classes"][20, 5:15], given["share"][20, 5:15] = CellClass.CHANGING, 1.0
    given["places"][20, 5:15] = given["guessed"][20, 5:15] = True
    given["classes"][21, 7], given["share"][21, 7] = CellClass.STATIC, 1.0  # a hit beside it
    cells = planning_cells(**given, resolution_m=SIZE_M)
    assert (cells[20, 5:15] == -1).all()
    assert cells[21, 7] == -1


def thing(states: list[tuple[int, int, int | None]], blocks: tuple[bool, ...], n_places: int = 2) -> Thing:
    places = tuple(leaf(k + 1, (0, 0), 90 * k) for k in range(n_places))
    course = tuple(ObjectPeriod(a * S, b * S, state) for a, b, state in states)
    one = MovingObject(1, places, course, 100.0, 0.0, 0.0, 0.9)
    return Thing(one, None, blocks, one.stays[-1] if one.stays else None)


def test_open_is_where_it_blocks_no_way() -> None:
    door = thing([(0, 30, 1), (30, 35, None), (35, 95, 2)], (True, False))
    assert door.share_open == pytest.approx(60 / 90)  # a swing is neither
    assert door.is_open is True
    assert thing([(0, 30, 2), (30, 50, 1)], (True, False)).is_open is False


def test_a_sliding_door_is_open_while_it_is_away() -> None:
    door = thing([(0, 30, 1), (30, 70, None)], (True,), n_places=1)
    assert door.share_open == pytest.approx(40 / 70)
    assert door.is_open is True


@pytest.mark.parametrize("blocks", [(False, False), (True, True)])
def test_nobody_says_what_open_is_if_all_places_are_alike(blocks: tuple[bool, bool]) -> None:
    door = thing([(0, 30, 1), (30, 70, 2)], blocks)
    assert (door.share_open, door.is_open) == (None, None)


def test_what_was_never_seen_is_neither_open_nor_closed() -> None:
    door = thing([], (True, False))
    assert (door.share_open, door.is_open, door.at) == (None, None, None)


def test_a_mask_grows_by_metres() -> None:
    mask = np.zeros((21, 21), dtype=np.bool_)
    assert not grown(mask, 0.5, SIZE_M).any()
    mask[10, 10] = True
    assert grown(mask, 0.1, SIZE_M).sum() == 13  # a disc of two cells
    assert grown(mask, 0.0, SIZE_M).sum() == 1


@pytest.fixture(scope="module")
def site():
    return site_map(find_objects(build_grid(simulate(corridor(seed=0), duration_s=30, seed=0).scans)))


@pytest.mark.parametrize(("there_s", "wanted"), [(90, 100), (40, 0)])
def test_what_may_be_a_wall_stays_if_poses_are_bad(site, there_s: int, wanted: int) -> None:
    periods = (Period(0, there_s * S, "occupied"), Period(there_s * S, 100 * S, "free"))
    places = (place(1, [(5.0, 1.0), (5.05, 1.0)], periods),)
    found = replace(site.found, configurations=places, objects=(MovingObject(1, places, *timeline_of(places), 0.9),))
    where = site.extent.index_of(5.0, 1.0)
    assert site_map(found).planning[where] == 0
    assert site_map(found, doubtful_are_walls=True).planning[where] == wanted


@pytest.mark.parametrize("percent", [0, 101, -5])
def test_a_speed_is_a_percent(site, percent: int) -> None:
    with pytest.raises(ConfigError, match="wanted a percent"):
        speed_mask(site, swing_percent=percent)
    with pytest.raises(ConfigError, match="wanted a percent"):
        speed_mask(site, people_percent=percent)


def test_a_moment_outside_is_refused(site) -> None:
    with pytest.raises(TimeError, match="nothing is known of"):
        site_map(site.found, "+31")
    with pytest.raises(TimeError, match="nothing is known of"):
        site_map(site.found, 0.0)


def test_a_single_scan_is_a_site() -> None:
    scan = Scan(1.0, (0.0, 0.0, 0.0), np.linspace(-1, 1, 21), np.full(21, 3.0), 8.0)
    one = site_map(find_objects(build_grid([scan])))
    assert (one.planning == 0).any()
    assert one.things == ()
    assert (speed_mask(one) == 0).all()


def test_a_box_that_came_stands_in_the_current_map_and_somebody_passing_does_not() -> None:
    """A wall at 4 m; from 30 s on something stands at 2 m ahead, and at the end somebody walks by to the left."""
    angles = np.linspace(-0.6, 0.6, 121)
    scans = []
    for k in range(600):
        ranges = 4.0 / np.cos(angles)
        if k >= 300:
            ranges = np.where(np.abs(angles) < 0.1, 2.0, ranges)
        if k >= 595:
            ranges = np.where(np.abs(angles - 0.4) < 0.05, 1.5, ranges)
        scans.append(Scan(k * 0.1, (0.0, 0.0, 0.0), angles, ranges, 8.0))
    found = find_objects(build_grid(scans))
    now, before = site_map(found), site_map(found, 25.0)
    box, passer, wall = (now.extent.index_of(*at) for at in ((2.01, 0.0), (1.5 * 0.921, 1.5 * 0.389), (4.01, 0.0)))
    assert (now.current[box], now.current[passer], now.current[wall]) == (100, 0, 100)
    assert (before.current[box], before.current[wall]) == (0, 100)
    assert now.planning[box] == 0


def test_keepout_spares_doors_that_open_now_and_then(site) -> None:
    """A place counts from half of the time on; one that blocks a way only if it is nearly always taken."""

    def door(closed_s: int, blocks: bool) -> Thing:
        periods = (Period(0, closed_s * S, "occupied"), Period(closed_s * S, 100 * S, "free"))
        places = (place(1, [(5.0, 1.0)], periods),)
        return Thing(MovingObject(1, places, *timeline_of(places), 0.9), None, (blocks,), None)

    where = site.extent.index_of(5.0, 1.0)
    for closed_s, blocks, wanted in [
        (40, False, -1),
        (60, False, 100),
        (60, True, -1),
        (94, True, -1),
        (96, True, 100),
    ]:
        mask = keepout_mask(replace(site, things=(door(closed_s, blocks),)))
        assert mask[where] == wanted, (closed_s, blocks)
        assert (mask == 100).sum() == (wanted == 100)


def test_a_sliding_door_slows_down_in_front_of_it(site) -> None:
    places = (place(1, [(5.0 + k * SIZE_M, 1.0) for k in range(18)], (Period(0, S, "occupied"),)),)
    one = MovingObject(1, places, *timeline_of(places), 0.9)
    floor = replace(site, planning=np.zeros(site.extent.shape, dtype=np.int8))
    mask = speed_mask(replace(floor, things=(Thing(one, None, (True,), None),)), swing_percent=30)
    assert mask[site.extent.index_of(5.4, 1.45)] == 30
    assert mask[site.extent.index_of(5.4, 1.7)] != 30
    other = speed_mask(replace(floor, things=(Thing(one, None, (False,), None),)), swing_percent=30)
    assert not (other == 30).any()
