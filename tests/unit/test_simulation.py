"""The simulator: exact beams, doors on time, nobody in anybody's way."""

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tempog.errors import ConfigError
from tempog.simulation import Door, Hit, Laser, Person, Robot, Wall, World, corridor, simulate
from tempog.simulation.polygons import covered_cells, outline
from tempog.simulation.raycast import NOTHING, cast_beams
from tempog.simulation.simulate import START_S

EXACT_M = 1e-9

SQUARE = (  # 4 m x 4 m inside, its middle at the origin
    Wall.box(-2.1, -2.1, 2.1, -2.0),
    Wall.box(-2.1, 2.0, 2.1, 2.1),
    Wall.box(-2.1, -2.0, -2.0, 2.0),
    Wall.box(2.0, -2.0, 2.1, 2.0),
)
QUIET = Laser(n_beams=5, fov_rad=math.pi, sigma_m=0.0, dropout=0.0)
STANDING = Robot(path=((0.0, 0.0),))


@pytest.fixture(scope="module")
def drive():
    return simulate(corridor())


# --- the kernel, against a slow and obvious version ---


def cast(x, y, angles, segments, discs, max_range=math.inf):
    distance = np.full(len(angles), np.nan)
    hit = np.full(len(angles), -99, dtype=np.int32)
    segments = np.asarray(segments, dtype=np.float64).reshape(-1, 4)
    discs = np.asarray(discs, dtype=np.float64).reshape(-1, 3)
    cast_beams(x, y, np.asarray(angles, dtype=np.float64), segments, discs, float(max_range), distance, hit)
    return distance, hit


def slow_distances(x, y, angle, segments, discs):
    """Distance to each segment, then to each disc, by solving the equations; inf for a miss."""
    c, s = math.cos(angle), math.sin(angle)
    distances = []
    for x0, y0, x1, y1 in segments:
        # (x, y) + d (c, s) = (x0, y0) + u (x1 - x0, y1 - y0)
        coefficients = np.array([[c, x0 - x1], [s, y0 - y1]])
        if np.linalg.det(coefficients) == 0:
            distances.append(math.inf)
            continue
        d, u = np.linalg.solve(coefficients, [x0 - x, y0 - y])
        distances.append(d if d > 0 and 0 <= u <= 1 else math.inf)
    for mx, my, radius in discs:
        # |(x, y) + d (c, s) - (mx, my)| = radius
        half_b = c * (x - mx) + s * (y - my)
        rest = (x - mx) ** 2 + (y - my) ** 2 - radius**2
        root = math.sqrt(max(half_b**2 - rest, 0.0))
        ahead = [d for d in (-half_b - root, -half_b + root) if half_b**2 > rest and d > 0]
        distances.append(min(ahead, default=math.inf))
    return np.array(distances)


# Corners on a coarse lattice, beams from beside it at odd angles: no beam grazes a corner so closely that
# rounding decides, so every disagreement is an error.
lattice = st.integers(-20, 20).map(lambda i: i / 4)
points = st.tuples(lattice, lattice)
segment_lists = st.lists(
    st.tuples(points, points).filter(lambda ends: ends[0] != ends[1]).map(lambda ends: (*ends[0], *ends[1])),
    max_size=12,
)
disc_lists = st.lists(st.tuples(lattice, lattice, st.sampled_from([0.25, 0.4, 1.5])), max_size=5)
odd_angles = st.lists(st.integers(-183, 183).map(lambda i: 0.0171 * i + 0.00519), min_size=1, max_size=8)


@settings(deadline=None, max_examples=300)
@given(points, odd_angles, segment_lists, disc_lists, st.sampled_from([math.inf, 8.0, 3.0]))
@example((0.0, 0.0), [0.00519], [(1.0, -1.0, 1.0, 1.0), (1.0, -1.0, 1.0, 1.0)], [], math.inf)  # a tie
@example((0.0, 0.0), [0.00519], [], [(0.0, 0.0, 1.5)], math.inf)  # inside a disc
def test_beams_reach_as_far_as_the_equations_say(point, angles, segments, discs, max_range):
    x, y = point[0] + 0.01237, point[1] + 0.03713
    distance, hit = cast(x, y, angles, segments, discs, max_range)
    for k, angle in enumerate(angles):
        expected = slow_distances(x, y, angle, segments, discs)
        nearest = expected.min(initial=math.inf)
        if nearest >= max_range:
            assert distance[k] == math.inf
            assert hit[k] == NOTHING
        else:
            assert abs(distance[k] - nearest) <= EXACT_M
            assert hit[k] in np.flatnonzero(expected <= nearest + EXACT_M)


@settings(deadline=None)
@given(st.integers(3, 9), points, st.floats(0.1, 50.0), st.floats(-math.pi, math.pi))
def test_no_beam_leaks_through_a_corner(n_corners, centre, radius, turn):
    corner_angles = turn + 2 * math.pi * np.arange(n_corners) / n_corners
    corners = np.array(centre) + radius * np.column_stack([np.cos(corner_angles), np.sin(corner_angles)])
    angles = np.arctan2(corners[:, 1] - centre[1], corners[:, 0] - centre[0])  # straight at the corners
    for nudged in (angles, np.nextafter(angles, 9.0), np.nextafter(angles, -9.0)):
        distance, _ = cast(*centre, nudged, outline(corners), [])
        np.testing.assert_allclose(distance, radius, rtol=1e-9)


def test_a_segment_seen_edge_on_is_hit_at_its_nearer_end():
    distance, hit = cast(0.0, 0.0, [0.0], [(5.0, 0.0, 3.0, 0.0)], [])
    assert (distance[0], hit[0]) == (3.0, 0)


def test_of_two_things_at_one_distance_the_lower_id_is_hit():
    wall = (2.0, -1.0, 2.0, 1.0)
    _, hit = cast(0.0, 0.0, [0.0], [(5.0, -1.0, 5.0, 1.0), wall, wall], [(3.0, 0.0, 1.0)])
    assert hit[0] == 1


def test_what_lies_behind_or_at_the_maximum_range_is_not_seen():
    behind, at_max_range = (-1.0, -1.0, -1.0, 1.0), (4.0, -1.0, 4.0, 1.0)
    distance, hit = cast(0.0, 0.0, [0.0], [behind, at_max_range], [(-3.0, 0.0, 0.5)], max_range=4.0)
    assert (distance[0], hit[0]) == (math.inf, NOTHING)


def test_a_disc_that_begins_within_the_maximum_range_is_seen():
    distance, hit = cast(0.0, 0.0, [0.0], [], [(4.2, 0.0, 0.5)], max_range=4.0)
    assert distance[0] == pytest.approx(3.7)
    assert hit[0] == 0


# --- scans ---


def test_a_quiet_scan_of_a_square_room_has_the_distances_worked_out_by_hand():
    scan = simulate(World(STANDING, SQUARE, laser=QUIET), duration_s=0.1).scans[0]
    np.testing.assert_allclose(scan.angles, np.deg2rad([-90, -45, 0, 45, 90]))
    np.testing.assert_allclose(scan.ranges, [2, 2 * math.sqrt(2), 2, 2 * math.sqrt(2), 2], atol=0.0005 + 1e-6)


def test_beams_start_at_the_pose_and_turn_with_it():
    robot = Robot(path=((1.0, 0.5),), heading_rad=math.pi / 2)
    simulation = simulate(World(robot, SQUARE, laser=QUIET), duration_s=0.1)
    expected = [1.0, math.sqrt(2), 1.5, 1.5 * math.sqrt(2), 3.0]
    np.testing.assert_allclose(simulation.distances[0], expected, rtol=1e-12)
    scan = simulation.scans[0]
    assert (scan.x, scan.y, scan.theta) == (1.0, 0.5, math.pi / 2)


def test_every_beam_knows_what_it_has_hit():
    world = World(
        STANDING,
        walls=(Wall.box(-1.0, -3.0, 1.0, -2.0),),
        doors=(Door((1.0, 0.9), closed_rad=-math.pi / 2, open_rad=0.0, length_m=1.8),),
        people=(Person(path=((0.0, 3.0),)),),
        laser=replace(QUIET, n_beams=9, max_range_m=5.0),
    )
    simulation = simulate(world, duration_s=0.1)
    wall, door, person, nothing = Hit.WALL, Hit.DOOR, Hit.PERSON, Hit.NOTHING
    # Every 22.5 degrees, from the right: the wall ends at 63.4 degrees, the door spans 43.5 to either side.
    expected = [wall, wall, nothing, door, door, door, nothing, nothing, person]
    assert simulation.hits[0].tolist() == expected
    assert simulation.distances[0, 4] == pytest.approx(1.0 - 0.05)  # opens away, so the back face is nearer
    assert simulation.distances[0, 8] == pytest.approx(3.0 - 0.25)
    assert simulation.distances[0, 6] == math.inf
    assert simulation.scans[0].ranges[6] == math.inf


def test_stamps_start_at_the_fixed_time_and_follow_the_rate():
    world = World(STANDING, SQUARE, laser=Laser(rate_hz=100.0))
    scans = simulate(world, duration_s=0.07).scans  # 7 scans, though 0.07 * 100 > 7
    assert [scan.stamp_ns - START_S * 10**9 for scan in scans] == [k * 10**7 for k in range(7)]


def test_an_empty_world_returns_nothing():
    simulation = simulate(World(STANDING), duration_s=0.5)
    assert np.isinf([scan.ranges for scan in simulation.scans]).all()
    assert (simulation.hits == Hit.NOTHING).all()
    assert simulation.truth_static_cells(0.1).shape == (0, 2)


def test_about_the_right_share_of_returns_is_lost():
    world = World(STANDING, SQUARE, laser=Laser(dropout=0.1))
    ranges = np.array([scan.ranges for scan in simulate(world, duration_s=20.0).scans])
    assert ranges.size == 36200  # so the share's standard deviation is 0.0016
    assert np.isinf(ranges).mean() == pytest.approx(0.1, abs=0.008)


def test_ranges_scatter_around_the_truth_as_much_as_the_laser_says():
    world = World(STANDING, SQUARE, laser=Laser(sigma_m=0.03, dropout=0.0))
    simulation = simulate(world, duration_s=10.0)
    error = np.array([scan.ranges for scan in simulation.scans]) - simulation.distances
    assert error.std() == pytest.approx(0.03, rel=0.05)
    assert error.mean() == pytest.approx(0.0, abs=0.001)


def test_noise_never_makes_a_range_zero_negative_or_too_long():
    room = (Wall.box(0.02, -9.0, 0.1, 0.0), Wall.box(1.97, 0.0, 2.1, 9.0))  # at the laser, and at its limit
    world = World(STANDING, room, laser=Laser(sigma_m=0.05, max_range_m=2.0))
    simulation = simulate(world, duration_s=5.0)
    ranges = np.array([scan.ranges for scan in simulation.scans])
    returns = ranges[np.isfinite(ranges)]
    assert returns.min() > 0
    assert returns.max() < 2.0
    assert (np.isinf(ranges) & np.isfinite(simulation.distances)).any()


def test_the_same_seed_gives_the_same_scans_and_another_seed_other_noise():
    first, again, other = (simulate(corridor(3), duration_s=5.0, seed=seed) for seed in (7, 7, 8))
    for one, two in zip(first.scans, again.scans, strict=True):
        assert one.stamp_ns == two.stamp_ns
        np.testing.assert_array_equal(one.ranges, two.ranges)
    assert any((one.ranges != two.ranges).any() for one, two in zip(first.scans, other.scans, strict=True))
    np.testing.assert_array_equal(first.distances, other.distances)


def test_describing_a_world_does_not_load_numba():
    code = "import sys, tempog.simulation as s; s.corridor(); sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- doors ---


def test_a_door_is_where_its_schedule_says():
    door = Door((1.0, 2.0), closed_rad=0.0, open_rad=math.pi / 2, schedule=((3.0, "open"), (8.0, "closed")))
    assert door.states(20.0) == [
        (0.0, "closed"),
        (3.0, "moving"),
        (4.0, "open"),
        (8.0, "moving"),
        (9.0, "closed"),
    ]
    angles_deg = np.rad2deg(door.angles([0.0, 3.0, 3.5, 4.0, 7.9, 8.25, 9.0, 99.0]))
    np.testing.assert_allclose(angles_deg, [0, 0, 45, 90, 90, 67.5, 0, 0], atol=1e-9)


def test_a_door_moved_at_once_is_never_at_rest_first():
    door = Door((0.0, 0.0), 0.0, 1.0, schedule=((0.0, "open"), (1.0, "closed")))
    assert door.states(9.0) == [(0.0, "moving"), (1.0, "moving"), (2.0, "closed")]


def test_states_after_the_end_are_left_out():
    door = Door((0.0, 0.0), 0.0, 1.0, schedule=((3.0, "open"),))
    assert door.states(3.5) == [(0.0, "closed"), (3.0, "moving")]


@pytest.mark.parametrize(("open_rad", "behind"), [(math.pi / 2, -0.1), (-math.pi / 2, 0.1)])
def test_the_thickness_of_a_leaf_lies_behind_the_face_that_leads_when_it_opens(open_rad, behind):
    door = Door((1.0, 2.0), closed_rad=0.0, open_rad=open_rad, length_m=0.8, thickness_m=0.1)
    expected = [(1.0, 2.0), (1.8, 2.0), (1.8, 2.0 + behind), (1.0, 2.0 + behind)]
    np.testing.assert_allclose(door.leaf_corners(0.0), expected, atol=1e-12)


def test_a_scan_in_mid_swing_sees_the_leaf_halfway():
    hinge = (3.0, -1.0)  # in front of the robot, swings from across its view to along it
    door = Door(hinge, closed_rad=math.pi / 2, open_rad=0.0, length_m=2.0, schedule=((1.0, "open"),))
    laser = replace(QUIET, n_beams=1)
    simulation = simulate(World(STANDING, doors=(door,), laser=laser), duration_s=2.5)
    ahead = simulation.distances[:, 0]
    assert ahead[10] == pytest.approx(3.0 - 0.05)  # its back face, still closed
    assert simulation.door_angles[15, 0] == pytest.approx(math.pi / 4)
    # The leading face runs through (4, 0), the back face is 0.05 m in front of it, at 45 degrees to the beam.
    assert ahead[15] == pytest.approx(4.0 - 0.05 * math.sqrt(2))
    assert ahead[20] == math.inf
    assert simulation.door_states() == [
        (START_S, "closed"),
        (START_S + 1.0, "moving"),
        (START_S + 2.0, "open"),
    ]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Door((0.0, 0.0), 0.0, 1.0, schedule=((1.0, "open"), (1.5, "closed"))),
        lambda: Door((0.0, 0.0), 0.0, 1.0, schedule=((1.0, "closed"),)),
        lambda: Door((0.0, 0.0), 0.0, 1.0, schedule=((-1.0, "open"),)),
        lambda: Door((0.0, 0.0), 0.0, 1.0, schedule=((1.0, "ajar"),)),
        lambda: Door((0.0, 0.0), 0.0, 1.0, length_m=0.0),
        lambda: Door((0.0, 0.0), 1.0, 1.0),
        lambda: Door((0.0, 0.0), 0.0, 1.0).rest_angle("moving"),
        lambda: Wall(((0.0, 0.0), (1.0, 0.0))),
        lambda: Person(path=()),
        lambda: Robot(path=((0.0, 0.0), (0.0, 0.0))),
        lambda: Robot(path=((0.0, 0.0), (1.0, 0.0)), speed_m_s=0.0),
        lambda: Laser(n_beams=0),
        lambda: Laser(dropout=1.5),
        lambda: simulate(World(STANDING), duration_s=0.0),
        lambda: covered_cells([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], 0.0),
    ],
)
def test_what_cannot_be_simulated_is_refused(make):
    with pytest.raises(ConfigError, match=r"wanted|stands still"):
        make()


# --- robot and people ---


def test_a_robot_drives_turns_on_the_spot_and_comes_back():
    robot = Robot(path=((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), speed_m_s=1.0, turn_rad_s=math.pi / 2)
    # 2 m east, left turn (1 s), 1 m north, about turn (2 s), 1 m south, right turn (1 s), 2 m west, ...
    expected = [
        (1.0, 1.0, 0.0, 0),
        (2.5, 2.0, 0.0, 45),
        (3.5, 2.0, 0.5, 90),
        (6.5, 2.0, 0.5, -90),
        (8.5, 1.5, 0.0, 180),
        (12.0 + 1.0, 1.0, 0.0, 0),  # the next round
    ]
    for t, x, y, theta_deg in expected:
        pose = robot.poses(t)
        np.testing.assert_allclose(pose[:2], (x, y), atol=1e-9)
        assert math.cos(pose[2] - math.radians(theta_deg)) == pytest.approx(1.0)


def test_a_person_walks_there_and_back_from_the_start_time():
    person = Person(path=((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), speed_m_s=0.5, start_s=4.0)
    positions = person.positions([0.0, 4.0, 6.0, 9.0, 10.0, 11.0, 16.0, 18.0])
    expected = [(0, 0), (0, 0), (1, 0), (2, 0.5), (2, 1), (2, 0.5), (0, 0), (1, 0)]
    np.testing.assert_allclose(positions, expected, atol=1e-9)


# --- cells ---


def test_cells_of_a_slanted_leaf_are_those_it_reaches_into():
    covered = {tuple(cell) for cell in covered_cells([(0.05, 0.0), (1.05, 1.0), (1.0, 1.05), (0.0, 0.05)], 0.2)}
    inside = set()  # points of the leaf, densely
    for along in np.linspace(0.001, 0.999, 400):
        for across in np.linspace(0.001, 0.999, 40):
            x, y = 0.05 * (1 - across) + along, 0.05 * across + along
            inside.add((math.floor(y / 0.2), math.floor(x / 0.2)))
    assert covered == inside


def test_a_wall_that_ends_at_the_edge_of_a_cell_does_not_cover_the_next():
    corners = Wall.box(0.3, -0.1, 0.6, 0.1).corners
    assert covered_cells(corners, 0.1).tolist() == [[-1, 3], [-1, 4], [-1, 5], [0, 3], [0, 4], [0, 5]]


# --- the corridor ---


def gap_m(point, corners):
    """Distance from points (n, 2) to a convex polygon, 0 inside."""
    x, y = np.asarray(point).T[..., None]
    x0, y0, x1, y1 = outline(corners).T
    dx, dy = x1 - x0, y1 - y0
    u = np.clip(((x - x0) * dx + (y - y0) * dy) / (dx**2 + dy**2), 0, 1)
    to_side = np.hypot(x0 + u * dx - x, y0 + u * dy - y).min(axis=1)
    left = dx * (y - y0) - dy * (x - x0)
    inside = (left > 0).all(axis=1) | (left < 0).all(axis=1)
    return np.where(inside, 0.0, to_side)


def test_the_gap_to_a_polygon_is_what_it_should_be():
    corners = Wall.box(0.0, 0.0, 2.0, 1.0).corners
    np.testing.assert_allclose(gap_m([(1.0, 0.5), (1.0, 3.0), (5.0, 5.0)], corners), [0.0, 2.0, 5.0])


@pytest.mark.parametrize("seed", range(5))
def test_nobody_in_the_corridor_ever_touches_anything(seed):
    world = corridor(seed)
    t = np.arange(0.0, world.duration_s, 0.02)
    robot = world.robot.poses(t)[:, :2]
    (person,), (door,) = world.people, world.doors
    walker = person.positions(t)
    for wall in world.walls:
        assert gap_m(robot, wall.corners).min() > world.robot.radius_m
        assert gap_m(walker, wall.corners).min() > person.radius_m
    assert np.hypot(*(robot - walker).T).min() > world.robot.radius_m + person.radius_m
    for k, angle in enumerate(door.angles(t)):
        leaf = door.leaf_corners(angle)
        assert gap_m(robot[k : k + 1], leaf)[0] > world.robot.radius_m
        assert gap_m(walker[k : k + 1], leaf)[0] > person.radius_m


def test_the_closed_door_fills_its_frame_and_the_open_one_stands_clear_of_the_walls():
    world = corridor()
    (door,) = world.doors
    closed = door.leaf_corners(door.closed_rad)
    assert (closed[:, 0].min(), closed[:, 0].max()) == pytest.approx((6.525, 7.425))
    assert (closed[:, 1].min(), closed[:, 1].max()) == pytest.approx((2.525, 2.575))
    # A frame without play is passed within a millimetre: the leaf's diagonal is that much longer.
    for angle in np.linspace(door.closed_rad, door.open_rad, 91):
        corners = door.leaf_corners(angle)
        shrunk = corners.mean(axis=0) + 0.995 * (corners - corners.mean(axis=0))
        sides = outline(shrunk)
        samples = np.concatenate([sides[:, :2] + u * (sides[:, 2:] - sides[:, :2]) for u in np.linspace(0, 1, 50)])
        assert all(gap_m(samples, wall.corners).min() > 0 for wall in world.walls)


def test_the_robot_passes_the_door_closed_and_open_in_both_directions(drive):
    (door,) = drive.world.doors
    x, theta = drive.poses[:, 0], drive.poses[:, 2]
    passes = np.flatnonzero((x[:-1] < 7.0) != (x[1:] < 7.0))
    seen = [("east" if abs(theta[k]) < 1 else "west", drive.door_angles[k, 0] == door.open_rad) for k in passes]
    assert len(seen) == 8
    assert set(seen) == {("east", False), ("east", True), ("west", False), ("west", True)}


def test_the_robot_sees_the_leaf_closed_open_and_moving(drive):
    (door,) = drive.world.doors
    sees = (drive.hits == Hit.DOOR).any(axis=1)
    angle = drive.door_angles[:, 0]
    assert sees[angle == door.closed_rad].sum() > 100
    assert sees[angle == door.open_rad].sum() > 100
    assert sees[(angle != door.closed_rad) & (angle != door.open_rad)].sum() > 10


def test_the_robot_sees_where_the_open_leaf_stands_while_the_door_is_closed(drive):
    (door,) = drive.world.doors
    (x0, y0), (x1, y1) = door.leaf_corners(door.open_rad)[:2]
    place = np.array([[x0, y0, x1, y1]])
    looked_across = 0
    for k in np.flatnonzero(drive.door_angles[:, 0] == door.closed_rad):
        x, y, theta = drive.poses[k]
        distance, _ = cast(x, y, theta + drive.world.laser.angles, place, [])
        looked_across += np.count_nonzero(drive.distances[k] > distance)
    assert looked_across > 300


def test_beams_end_in_the_cells_of_what_they_have_hit(drive):
    resolution_m = 0.05
    walls = {tuple(cell) for cell in drive.truth_static_cells(resolution_m)}
    leaf = {
        state: {tuple(cell) for cell in drive.door_leaf_cells(state, resolution_m)} for state in ("closed", "open")
    }
    (door,) = drive.world.doors
    just_inside = 1e-6
    n_walls = n_leaf = 0
    for k in range(0, len(drive.scans), 20):
        x, y, theta = drive.poses[k]
        angles = theta + drive.world.laser.angles
        distance = drive.distances[k] + just_inside
        with np.errstate(invalid="ignore"):
            ends = np.column_stack([y + distance * np.sin(angles), x + distance * np.cos(angles)])
        state = {door.closed_rad: "closed", door.open_rad: "open"}.get(drive.door_angles[k, 0])
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
    cells = {tuple(cell) for cell in drive.truth_static_cells(0.05)}
    assert (48, 20) in cells  # north wall, y = 2.425 m
    assert (24, 281) in cells  # east wall, x = 14.05 m
    for path in (drive.poses[:, :2], drive.people[:, 0]):
        assert not cells & {(math.floor(y / 0.05), math.floor(x / 0.05)) for x, y in path}
    # Walls of 0.15 m whose faces lie in mid-cell cover 4 rows of cells, 0.2 m: a third more than their area.
    area = sum((w.corners[2][0] - w.corners[0][0]) * (w.corners[2][1] - w.corners[0][1]) for w in drive.world.walls)
    assert area < len(cells) * 0.05**2 < area * 1.4


def test_the_leaf_covers_a_strip_along_the_wall_when_closed_and_across_it_when_open(drive):
    assert drive.door_leaf_cells("closed", 0.05).tolist() == [[r, c] for r in (50, 51) for c in range(130, 149)]
    assert drive.door_leaf_cells("open", 0.05).tolist() == [[r, c] for r in range(51, 70) for c in (147, 148)]
    assert drive.door_leaf_segments("open").shape == (4, 4)
    np.testing.assert_allclose(drive.door_leaf_segments("open")[0], [7.425, 2.575, 7.425, 3.475])
    with pytest.raises(ConfigError, match="stands still"):
        drive.door_leaf_segments("moving")


def test_the_truth_about_people_is_where_beams_end_on_them(drive):
    scan, beam = np.argwhere(drive.hits == Hit.PERSON)[0]
    x, y, theta = drive.poses[scan]
    angle = theta + drive.world.laser.angles[beam]
    d = drive.distances[scan, beam]
    end = np.array([x + d * math.cos(angle), y + d * math.sin(angle)])
    assert np.hypot(*(end - drive.people[scan, 0])) == pytest.approx(0.25)
