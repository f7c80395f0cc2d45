"""The corridor: nobody in anybody's way, and every state of the door seen from both sides."""

import math

import numpy as np
import pytest

from clearance import assert_nobody_overlaps, gaps
from tempog.errors import WorldError
from tempog.simulation import Hit, corridor, simulate
from tempog.simulation.corridor import DOOR_SCHEDULE
from tempog.simulation.polygons import outline, placed
from tempog.simulation.raycast import cast_beams
from tempog.simulation.simulation import MOVING, START_S

CLOSED, OPEN = 0, 1


@pytest.fixture(scope="module")
def drive():
    return simulate(corridor())


@pytest.mark.parametrize("seed", range(5))
def test_nobody_in_the_corridor_ever_touches_anything(seed):
    simulation = simulate(corridor(seed))
    assert_nobody_overlaps(simulation)
    assert np.isfinite(simulation.people).all()  # the person walks all the time


def test_the_closed_door_fills_its_frame_and_the_open_one_stands_clear_of_the_walls():
    world = corridor()
    (door,) = world.things
    closed = door.corners("closed")
    assert (closed[:, 0].min(), closed[:, 0].max()) == pytest.approx((6.525, 7.425))
    assert (closed[:, 1].min(), closed[:, 1].max()) == pytest.approx((2.525, 2.575))
    # A frame without play is passed within a millimetre: the leaf's diagonal is that much longer.
    for angle in np.linspace(math.pi, math.pi / 2, 91):
        corners = placed(door.rectangle, (7.425, 2.575, angle))
        shrunk = corners.mean(axis=0) + 0.995 * (corners - corners.mean(axis=0))
        sides = outline(shrunk)
        samples = np.concatenate([sides[:, :2] + u * (sides[:, 2:] - sides[:, :2]) for u in np.linspace(0, 1, 50)])
        assert all(gaps(samples, wall.corners).min() > 0 for wall in world.walls)


def test_the_door_moves_when_it_should(drive):
    expected = [(0.0, "closed")]
    for t, state in DOOR_SCHEDULE.times:
        expected += [(t, "moving"), (t + 1.0, state)]
    assert [(t - START_S, state) for t, state in drive.states("D1")] == expected


def test_the_robot_passes_the_door_closed_and_open_in_both_directions(drive):
    x, theta = drive.poses[:, 0], drive.poses[:, 2]
    passes = np.flatnonzero((x[:-1] < 7.0) != (x[1:] < 7.0))
    seen = [("east" if abs(theta[k]) < 1 else "west", drive.places[k, 0] == OPEN) for k in passes]
    assert len(seen) == 8
    assert set(seen) == {("east", False), ("east", True), ("west", False), ("west", True)}


def test_the_robot_sees_the_leaf_closed_open_and_moving(drive):
    sees = (drive.hits == Hit.DOOR).any(axis=1)
    place = drive.places[:, 0]
    assert sees[place == CLOSED].sum() > 100
    assert sees[place == OPEN].sum() > 100
    assert sees[place == MOVING].sum() > 10


def test_the_robot_sees_where_the_open_leaf_stands_while_the_door_is_closed(drive):
    place = drive.segments("D1", "open")[:1]
    distance, hit = np.empty(181), np.empty(181, dtype=np.int32)
    looked_across = 0
    for k in np.flatnonzero(drive.places[:, 0] == CLOSED):
        x, y, theta = drive.poses[k]
        x, y = np.full(181, x), np.full(181, y)
        glass = np.zeros((0, 181), dtype=np.uint8)
        cast_beams(x, y, theta + drive.world.laser.angles, place, np.empty((0, 3)), glass, math.inf, distance, hit)
        looked_across += np.count_nonzero(drive.distances[k] > distance)
    assert looked_across > 300


def test_beams_end_in_the_cells_of_what_they_have_hit(drive):
    resolution_m = 0.05
    walls = {tuple(cell) for cell in drive.static_cells(resolution_m)}
    leaf = {state: {tuple(cell) for cell in drive.cells("D1", state, resolution_m)} for state in ("closed", "open")}
    just_inside = 1e-6
    n_walls = n_leaf = 0
    for k in range(0, len(drive.scans), 20):
        x, y, theta = drive.poses[k]
        angles = theta + drive.world.laser.angles
        distance = drive.distances[k] + just_inside
        with np.errstate(invalid="ignore"):
            ends = np.column_stack([y + distance * np.sin(angles), x + distance * np.cos(angles)])
        state = {CLOSED: "closed", OPEN: "open"}.get(int(drive.places[k, 0]))
        for end, hit in zip(ends, drive.hits[k], strict=True):
            if hit == Hit.WALL:
                n_walls += 1
                assert tuple(np.floor(end / resolution_m).astype(int)) in walls
            elif hit == Hit.DOOR and state:
                n_leaf += 1
                assert tuple(np.floor(end / resolution_m).astype(int)) in leaf[state]
    assert n_walls > 10_000
    assert n_leaf > 100


def test_truth_cells_cover_the_walls_and_leave_the_ways_free(drive):
    cells = {tuple(cell) for cell in drive.static_cells(0.05)}
    assert (48, 20) in cells  # north wall, y = 2.425 m
    assert (24, 281) in cells  # east wall, x = 14.05 m
    for path in (drive.poses[:, :2], drive.people[:, 0]):
        assert not cells & {(math.floor(y / 0.05), math.floor(x / 0.05)) for x, y in path}
    # Walls of 0.15 m whose faces lie in mid-cell cover 4 rows of cells, 0.2 m: a third more than their area.
    area = sum((w.corners[2][0] - w.corners[0][0]) * (w.corners[2][1] - w.corners[0][1]) for w in drive.world.walls)
    assert area < len(cells) * 0.05**2 < area * 1.4


def test_the_leaf_covers_a_strip_along_the_wall_when_closed_and_across_it_when_open(drive):
    assert drive.cells("D1", "closed", 0.05).tolist() == [[r, c] for r in (50, 51) for c in range(130, 149)]
    assert drive.cells("D1", "open", 0.05).tolist() == [[r, c] for r in range(51, 70) for c in (147, 148)]
    assert drive.segments("D1", "open").shape == (4, 4)
    np.testing.assert_allclose(drive.segments("D1", "open")[0], [7.425, 2.575, 7.425, 3.475])
    with pytest.raises(WorldError, match="no place 'moving'"):
        drive.segments("D1", "moving")


def test_the_truth_about_people_is_where_beams_end_on_them(drive):
    scan, beam = np.argwhere(drive.hits == Hit.PERSON)[0]
    x, y, theta = drive.poses[scan]
    angle = theta + drive.world.laser.angles[beam]
    d = drive.distances[scan, beam]
    end = np.array([x + d * math.cos(angle), y + d * math.sin(angle)])
    assert np.hypot(*(end - drive.people[scan, 0])) == pytest.approx(0.25)
