"""Worlds that run: nobody is ever inside anything, doors keep to their schedule or wait, and a seed says it all."""

import math
import subprocess
import sys
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from clearance import assert_nobody_overlaps
from slow_beams import slow_distances
from tempog.errors import ConfigError, WorldError
from tempog.simulation import (
    Crowd,
    Glass,
    Hit,
    Laser,
    PoseError,
    Route,
    Thing,
    Track,
    Wall,
    World,
    load_world,
    simulate,
)
from tempog.simulation.overlaps import overlap
from tempog.simulation.polygons import outline
from tempog.simulation.schedules import Dwell, Listed
from tempog.simulation.simulate import pose_errors
from tempog.simulation.simulation import MOVING, START_S

ROOM = (
    Wall.box(-0.2, -0.2, 8.2, 0.0),
    Wall.box(-0.2, 4.0, 8.2, 4.2),
    Wall.box(-0.2, 0.0, 0.0, 4.0),
    Wall.box(8.0, 0.0, 8.2, 4.0),
)
DRIVING = Route(((1.0, 2.0), (7.0, 2.0)), speed_m_s=1.0)
FEW_BEAMS = Laser(n_beams=5)
SQUARE = (  # 4 m x 4 m inside, its middle at the origin
    Wall.box(-2.1, -2.1, 2.1, -2.0),
    Wall.box(-2.1, 2.0, 2.1, 2.1),
    Wall.box(-2.1, -2.0, -2.0, 2.0),
    Wall.box(2.0, -2.0, 2.1, 2.0),
)
QUIET = Laser(n_beams=5, fov_rad=math.pi, sigma_m=0.0, dropout=0.0)
STANDING = Route(((0.0, 0.0),))


def door(schedule=None, places=None, **other):
    places = places or {"closed": (4.0, 3.9, math.pi), "open": (4.0, 3.9, 1.5 * math.pi)}
    return Thing("D", "hinged", 0.9, 0.05, places, schedule or Listed(()), **other)


def box(places, schedule, name="B"):
    return Thing(name, "box", 0.4, 0.3, places, schedule)


@pytest.mark.parametrize("seed", range(4))
def test_nobody_in_a_crowded_room_ever_overlaps_anything(seed):
    things = (
        door(Dwell({"closed": 3.0, "open": 3.0})),
        Thing(
            "S",
            "sliding",
            0.9,
            0.05,
            {"closed": (2.0, 1.0, 0), "open": (5.0, 1.0, 0)},
            Dwell({"closed": 4, "open": 4}),
        ),
        box({"here": (6.5, 3.0, 0.0), "there": (6.5, 3.5, 0.4)}, Dwell({"here": 2.0, "there": 2.0})),
    )
    world = World(DRIVING, ROOM, things, Crowd(12, speed_m_s=(0.05, 1.5)), FEW_BEAMS)
    simulation = simulate(world, 90.0, seed=seed)
    assert_nobody_overlaps(simulation)
    assert all((np.diff(simulation.places[:, k]) != 0).sum() > 5 for k in range(3))


@pytest.mark.parametrize("people", [0, 20, 60])
def test_nobody_in_the_hallway_ever_overlaps_anything(people):
    world = replace(load_world("hallway"), laser=FEW_BEAMS)
    simulation = simulate(world, 300.0, seed=people, people=people)
    assert_nobody_overlaps(simulation)
    assert np.linalg.norm(np.diff(simulation.poses[:, :2], axis=0), axis=1).sum() > 30  # the robot gets on


def test_the_robot_goes_from_a_to_b_and_back_several_times_even_through_a_crowd():
    world = replace(load_world("hallway"), laser=FEW_BEAMS)
    x = simulate(world, people=60).poses[:, 0]
    assert x.min() < 1.6
    assert x.max() > 34.4
    middle_passed = np.count_nonzero((x[:-1] < 18) != (x[1:] < 18))
    assert middle_passed >= 3


def test_nobody_walks_faster_than_they_can_or_leaves_the_building():
    world = replace(load_world("hallway"), laser=FEW_BEAMS, people=Crowd(30, speed_m_s=(0.4, 0.8)))
    people = simulate(world, 120.0).people
    speed = np.linalg.norm(np.diff(people, axis=0), axis=2) / 0.1
    assert speed.max() <= 0.8 + 1e-9
    assert np.sort(speed.max(axis=0))[3] >= 0.4 - 1e-9
    assert (speed.mean(axis=0) > 0.05).mean() > 0.9
    assert people.min() > -5
    assert people[..., 0].max() < 36
    assert people[..., 1].max() < 8


def test_a_robot_keeps_to_its_speed_and_turn_rate():
    route = Route(((1.0, 1.0), (7.0, 1.0), (7.0, 3.0)), speed_m_s=0.7, turn_rad_s=1.0)
    poses = simulate(World(route, ROOM, laser=FEW_BEAMS), 120.0).poses
    step = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    turn = abs((np.diff(poses[:, 2]) + np.pi) % (2 * np.pi) - np.pi)
    assert step.max() == pytest.approx(0.07)
    assert turn.max() == pytest.approx(0.1)
    assert {tuple(p) for p in np.array(route.waypoints)} <= {tuple(p) for p in np.round(poses[:, :2], 6)}
    moving = step > 1e-9
    heading = np.arctan2(*np.diff(poses[:, :2], axis=0).T[::-1])
    straight = moving & (turn < 1e-9)
    assert abs(np.sin(heading - poses[1:, 2]))[straight].max() < 1e-6  # a differential drive never slips sideways


def test_doors_keep_to_their_schedule_where_nobody_is_in_the_way():
    schedule = Listed(((2.0, "open"), (5.0, "closed"), (5.2, "open")))
    world = World(Route(((1.0, 1.0),)), ROOM, (door(schedule, move_s=1.5),), laser=FEW_BEAMS)
    simulation = simulate(world, 12.0)
    states = [(round(t - START_S, 1), state) for t, state in simulation.states("D")]
    assert states[:3] == [(0.0, "closed"), (2.0, "moving"), (3.5, "open")]
    assert states[3] == (5.0, "moving")  # wanted open again on the way: it closes first, then opens
    assert states[-1] == (8.0, "open")
    np.testing.assert_allclose(simulation.corners[45, 0], world.things[0].corners("open"), atol=1e-9)


def test_a_robot_waits_until_the_door_in_its_way_opens():
    across = door(Listed(((20.0, "open"),)), {"closed": (4.0, 2.4, 1.5 * math.pi), "open": (4.0, 2.4, 0.5 * math.pi)})
    x = simulate(World(DRIVING, ROOM, (across,), laser=FEW_BEAMS), 40.0).poses[:, 0]
    assert x[:200].max() == pytest.approx(3.95 - 0.3 - 0.2 - 0.9, abs=0.12)  # out of reach of the leaf
    assert x.max() == pytest.approx(7.0)


def test_a_door_waits_until_the_robot_in_its_way_has_gone():
    across = door(
        Listed(((3.0, "closed"), (60.0, "open"))),
        {"closed": (4.0, 2.4, 1.5 * math.pi), "open": (4.0, 2.4, 0.5 * math.pi)},
        initial="open",
    )
    simulation = simulate(World(DRIVING, ROOM, (across,), laser=FEW_BEAMS), 20.0)
    assert simulation.states("D")[1][0] > START_S + 3.05  # the robot passes x = 4 m at 3 s
    assert_nobody_overlaps(simulation)


def test_a_box_is_nowhere_while_it_is_carried():
    crate = box({"here": (2.0, 1.0, 0.0), "there": (6.0, 3.0, 0.5)}, Listed(((1.0, "there"),)))
    simulation = simulate(World(Route(((1.0, 2.0),)), ROOM, (crate,)), 4.0)
    gone = np.isnan(simulation.corners[:, 0, 0, 0])
    np.testing.assert_array_equal(gone, simulation.places[:, 0] == MOVING)
    assert gone.sum() == 10
    assert (simulation.hits[gone] != Hit.BOX).all()
    assert (simulation.hit_things[simulation.hits == Hit.BOX] == 0).all()
    assert (simulation.hits[0] == Hit.BOX).any()


def test_an_open_sliding_leaf_is_seen_by_nobody():
    world = load_world_with_sliding_door()
    simulation = simulate(world, 6.0)
    states = simulation.places[:, 0]
    sees = (simulation.hits == Hit.DOOR).any(axis=1)
    assert sees[states == 0].all()
    assert not sees[states == 1].any()


def load_world_with_sliding_door():
    walls = (Wall.box(0.0, 3.0, 3.0, 3.2), Wall.box(4.0, 3.0, 6.0, 3.2))
    leaf = Thing(
        "S",
        "sliding",
        1.0,
        0.05,
        {"closed": (3.0, 3.1, 0.0), "open": (4.0, 3.1, 0.0)},
        Listed(((2.0, "open"),)),
    )
    return World(Route(((3.0, 1.0),), heading_rad=math.pi / 2), walls, (leaf,))


def test_a_seed_says_it_all():
    world = load_world("hallway")
    first, again, other = (simulate(world, 20.0, seed=seed, people=20) for seed in (3, 3, 4))
    for name in ("poses", "people", "places", "corners", "distances", "hits"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    for one, two in zip(first.scans, again.scans, strict=True):
        np.testing.assert_array_equal(one.ranges, two.ranges)
    assert (first.people != other.people).any()


def test_d8_is_seen_open_only_while_it_is_open():
    world = load_world("hallway")
    simulation = simulate(world, 400.0)
    faces = outline(world.things[7].corners("open"))
    middle = faces[:, :2].mean(axis=0)
    closed = simulation.places[:, 7] == 0
    angles = simulation.poses[:, 2:] + world.laser.angles
    ends = simulation.poses[:, None, :2] + np.where(
        np.isfinite(simulation.distances), simulation.distances, world.laser.max_range_m
    )[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    inside_room = (ends[..., 1] < middle[1]) & (abs(ends[..., 0] - middle[0]) < 3)
    assert not inside_room[closed].any()
    assert inside_room[~closed].any()


def test_pose_error_is_told_and_the_truth_is_kept():
    world = World(DRIVING, ROOM, laser=FEW_BEAMS, pose_error=PoseError(white_m=0.02, drift_rad=0.01))
    simulation = simulate(world, 60.0)
    plain = simulate(replace(world, pose_error=PoseError()), 60.0)
    np.testing.assert_array_equal(simulation.poses, plain.poses)
    told = np.array([(scan.x, scan.y, scan.theta) for scan in simulation.scans])
    assert (told[:, :2] - simulation.poses[:, :2]).std() == pytest.approx(0.02, rel=0.1)
    assert [(scan.x, scan.y) for scan in plain.scans] == [tuple(p) for p in plain.poses[:, :2]]


def test_drift_is_as_large_and_as_slow_as_it_says():
    t = np.arange(0.0, 40_000.0, 0.5)
    error = pose_errors(PoseError(drift_m=0.03, drift_s=20.0), t, np.random.default_rng(0))
    assert error[:, :2].std() == pytest.approx(0.03, rel=0.1)
    assert (error[:, 2] == 0).all()
    x = error[:, 0]
    assert np.corrcoef(x[:-40], x[40:])[0, 1] == pytest.approx(math.exp(-1), abs=0.08)  # 20 s apart
    assert np.diff(x).std() < 0.03 * 0.3


# --- scans ---


def test_a_quiet_scan_of_a_square_room_has_the_distances_worked_out_by_hand():
    scan = simulate(World(STANDING, SQUARE, laser=QUIET), duration_s=0.1).scans[0]
    np.testing.assert_allclose(scan.angles, np.deg2rad([-90, -45, 0, 45, 90]))
    np.testing.assert_allclose(scan.ranges, [2, 2 * math.sqrt(2), 2, 2 * math.sqrt(2), 2], atol=0.0005 + 1e-6)


def test_beams_start_at_the_pose_and_turn_with_it():
    robot = Route(((1.0, 0.5),), heading_rad=math.pi / 2)
    simulation = simulate(World(robot, SQUARE, laser=QUIET), duration_s=0.1)
    expected = [1.0, math.sqrt(2), 1.5, 1.5 * math.sqrt(2), 3.0]
    np.testing.assert_allclose(simulation.distances[0], expected, rtol=1e-12)
    scan = simulation.scans[0]
    assert (scan.x, scan.y, scan.theta) == (1.0, 0.5, math.pi / 2)


def test_every_beam_knows_what_it_has_hit():
    world = World(
        STANDING,
        walls=(Wall.box(-1.0, -3.0, 1.0, -2.0),),
        things=(Thing("D", "hinged", 1.8, 0.05, {"closed": (1.0, 0.9, -math.pi / 2), "open": (1.0, 0.9, 0.0)}),),
        people=Crowd(tracks=(Track([(0.0, 0.0, 3.0)]),)),
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
    assert simulation.static_cells(0.1).shape == (0, 2)


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
    world = World(Route(((0.0, 0.0),), radius_m=0.01), room, laser=Laser(sigma_m=0.05, max_range_m=2.0))
    simulation = simulate(world, duration_s=5.0)
    ranges = np.array([scan.ranges for scan in simulation.scans])
    returns = ranges[np.isfinite(ranges)]
    assert returns.min() > 0
    assert returns.max() < 2.0
    assert (np.isinf(ranges) & np.isfinite(simulation.distances)).any()


def test_describing_a_world_does_not_load_numba():
    code = "import sys, tempog.simulation as s; s.corridor(); sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_scan_in_mid_swing_sees_the_leaf_halfway():
    hinge = (3.0, -1.0)  # in front of the robot, swings from across its view to along it
    places = {"closed": (*hinge, math.pi / 2), "open": (*hinge, 0.0)}
    leaf = Thing("D", "hinged", 2.0, 0.05, places, Listed(((1.0, "open"),)))
    simulation = simulate(World(STANDING, things=(leaf,), laser=replace(QUIET, n_beams=1)), 2.5)
    ahead = simulation.distances[:, 0]
    assert ahead[10] == pytest.approx(3.0 - 0.05)  # its back face, still closed
    # The leading face runs through (4, 0), the back face is 0.05 m in front of it, at 45 degrees to the beam.
    assert ahead[15] == pytest.approx(4.0 - 0.05 * math.sqrt(2))
    assert ahead[20] == math.inf
    assert simulation.states("D") == [(START_S, "closed"), (START_S + 1.0, "moving"), (START_S + 2.0, "open")]


@pytest.mark.parametrize(("open_rad", "behind"), [(math.pi / 2, -0.1), (-math.pi / 2, 0.1)])
def test_the_thickness_of_a_leaf_lies_behind_the_face_that_leads_when_it_opens(open_rad, behind):
    leaf = Thing("D", "hinged", 0.8, 0.1, {"closed": (1.0, 2.0, 0.0), "open": (1.0, 2.0, open_rad)})
    expected = [(1.0, 2.0), (1.8, 2.0), (1.8, 2.0 + behind), (1.0, 2.0 + behind)]
    np.testing.assert_allclose(leaf.corners("closed"), expected, atol=1e-12)


# --- people who are replayed ---


def test_a_replayed_person_is_exactly_where_the_samples_say_and_nowhere_else():
    track = Track([(-1.0, -1.5, 1.5), (0.5, 0.0, 1.5), (0.73, 0.0, 1.0), (2.0, 1.0, 1.0)])
    late = Track([(1.0, -1.0, -1.0), (1.5, -1.0, 1.0)])
    simulation = simulate(World(STANDING, SQUARE, people=Crowd(tracks=(track, late))), 3.0)
    assert simulation.people.shape == (30, 2, 2)
    for k, one in enumerate((track, late)):
        np.testing.assert_allclose(simulation.people[:, k], one.positions(simulation.t), atol=1e-12)
    np.testing.assert_array_equal(np.isfinite(simulation.people[:, 0, 0]), simulation.t < 2.05)
    np.testing.assert_array_equal(
        np.isfinite(simulation.people[:, 1, 0]), (simulation.t > 0.95) & (simulation.t < 1.55)
    )
    assert (simulation.hits[:20] == Hit.PERSON).any()
    assert not (simulation.hits[21:] == Hit.PERSON).any()


def test_a_replayed_person_waits_for_nobody_but_others_wait():
    across = Track([(0.0, 4.0, 3.5), (2.0, 4.0, 2.0), (12.0, 4.0, 2.0), (14.0, 4.0, 0.5)])
    leaf = door(Listed(((3.0, "open"),)), {"closed": (3.5, 0.7, math.pi), "open": (3.5, 0.7, math.pi / 2)})
    world = World(DRIVING, ROOM, (leaf,), Crowd(tracks=(across,)), FEW_BEAMS)
    simulation = simulate(world, 30.0)
    np.testing.assert_allclose(simulation.people[:, 0], across.positions(simulation.t), atol=1e-12)
    x = simulation.poses[:, 0]
    assert x[simulation.t < 12.0].max() == pytest.approx(4.0 - 0.55 - 0.2, abs=0.06)
    assert x.max() == pytest.approx(7.0)


def test_walkers_step_out_of_the_way_of_somebody_replayed():
    there_and_back = [(4.0 * k, 0.5 if k % 2 else 7.5, 1.0 + 0.2 * (k % 11)) for k in range(40)]
    crowd = Crowd(6, speed_m_s=(0.8, 1.5), tracks=(Track(there_and_back),))
    simulation = simulate(World(Route(((4.0, 0.4),)), ROOM, (), crowd, FEW_BEAMS), 150.0)
    walkers, replayed = simulation.people[:, :6], simulation.people[:, 6:]
    gaps = np.linalg.norm(walkers - replayed, axis=2)
    apart = np.linalg.norm(walkers[:, 0] - replayed[:, 0], axis=1)
    assert (apart < 1.5).any()  # they do meet
    assert (gaps < 0.5).mean() < 0.01
    for i, j in combinations(range(6), 2):
        assert np.linalg.norm(walkers[:, i] - walkers[:, j], axis=1).min() >= 0.5


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        ([], "wanted one row"),
        ([(1.0, 2.0)], "wanted one row"),
        ([(0.0, 0.0, 0.0), (1.0, math.nan, 0.0)], "sample 1 is not finite"),
        ([(0.0, 0.0, 0.0), (2.0, 1.0, 0.0), (1.0, 1.0, 0.0)], "sample 2 is at 1 s, after 2 s"),
    ],
)
def test_a_track_that_cannot_be_is_refused(samples, words):
    with pytest.raises(WorldError, match=words):
        Track(samples)


# --- things among themselves ---


def hinged(name, places, schedule):
    return Thing(name, "hinged", 0.9, 0.05, places, schedule)


def deepest_overlap(simulation, one, other):
    """Of two things over all scans, as an area."""
    areas = []
    for a, b in zip(simulation.corners[:, one], simulation.corners[:, other], strict=True):
        x, y = overlap(a, b).T if np.isfinite(a).all() and np.isfinite(b).all() else (np.zeros(0), np.zeros(0))
        areas.append(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)
    return max(areas)


def test_leaves_whose_sweeps_meet_take_turns():
    a = {"closed": (4.0, 3.9, 0.0), "open": (4.0, 3.9, -math.pi / 2)}
    b = {"closed": (4.5, 2.9, -math.pi / 2), "open": (4.5, 2.9, math.pi / 2)}  # open, it stands in the sweep of A
    things = tuple(
        hinged(name, places, Listed(((4.0, "open"), (8.0, "closed")))) for name, places in (("A", a), ("B", b))
    )
    simulation = simulate(World(Route(((1.0, 1.0),)), ROOM, things, laser=FEW_BEAMS), 12.0)
    assert deepest_overlap(simulation, 0, 1) == 0
    starts = [
        [round(t - START_S, 1) for t, state in simulation.states(name) if state == "moving"] for name in ("A", "B")
    ]
    assert starts[0] == pytest.approx([4.0, 9.0], abs=0.11)
    assert starts[1] == pytest.approx([5.0, 8.0], abs=0.11)


def test_both_leaves_of_a_double_door_open_and_close():
    east = {"closed": (4.0, 3.9, 0.0), "open": (4.0, 3.9, -math.pi / 2)}
    west = {"closed": (5.8, 3.9, math.pi), "open": (5.8, 3.9, 1.5 * math.pi)}
    schedule = Listed(((1.0, "open"), (4.0, "closed"), (7.0, "open")))
    things = (hinged("A", east, schedule), hinged("B", west, schedule))
    simulation = simulate(World(Route(((1.0, 1.0),)), ROOM, things, laser=FEW_BEAMS), 12.0)
    assert (simulation.places[95:] == 1).all()
    assert (np.diff((simulation.places == MOVING).astype(int), axis=0) == 1).sum(axis=0).tolist() == [3, 3]


def test_a_leaf_waits_for_a_box_in_its_way_and_a_box_for_a_leaf():
    leaf = hinged("A", {"closed": (4.0, 3.9, 0.0), "open": (4.0, 3.9, -math.pi / 2)}, Listed(((2.0, "open"),)))
    crate = box({"here": (4.5, 3.4, 0.3), "there": (6.0, 1.0, 0.0)}, Listed(((5.0, "there"), (9.0, "here"))))
    simulation = simulate(World(Route(((1.0, 1.0),)), ROOM, (leaf, crate), laser=FEW_BEAMS), 15.0)
    assert 5.0 <= simulation.states("A")[1][0] - START_S <= 6.1
    assert deepest_overlap(simulation, 0, 1) == 0
    close = {"closed": (4.0, 3.9, 0.0), "open": (4.0, 3.9, -math.pi / 2)}
    shut = hinged("A", close, Listed(((1.0, "open"), (9.0, "closed"))))
    late = box({"there": (6.0, 1.0, 0.0), "here": (4.1, 3.4, 0.0)}, Listed(((3.0, "here"),)))
    simulation = simulate(World(Route(((1.0, 1.0),)), ROOM, (shut, late), laser=FEW_BEAMS), 15.0)
    assert simulation.states("B")[1][0] - START_S >= 9.0
    assert deepest_overlap(simulation, 0, 1) == 0


def test_a_door_that_closes_all_the_time_never_traps_anybody():
    walls = (*ROOM, Wall.box(3.9, 0.0, 4.1, 1.5), Wall.box(3.9, 2.4, 4.1, 4.0))
    restless = Dwell({"closed": 1.5, "open": 2.5})
    leaf = hinged("A", {"closed": (4.1, 1.5, math.pi / 2), "open": (4.1, 1.5, 0.0)}, restless)
    crowd = Crowd(8, speed_m_s=(0.3, 1.5), pause_s=1.0, goals=((2.0, 2.0), (6.0, 2.0), (6.0, 1.2)))
    for seed in range(4):
        simulation = simulate(World(Route(((1.0, 0.5),)), walls, (leaf,), crowd, FEW_BEAMS), 200.0, seed=seed)
        assert_nobody_overlaps(simulation)
        x, y = np.moveaxis(simulation.people, -1, 0)
        in_doorway = (abs(x - 4.0) < 0.3) & (y > 1.5) & (y < 2.4)
        for k in range(8):
            edges = np.flatnonzero(np.diff(in_doorway[:, k], prepend=False, append=False))
            stays = np.diff(edges)[::2] / 10.0
            assert stays.max(initial=0.0) < 60.0
        assert (np.diff(np.sign(x - 4.0), axis=0) != 0).sum() > 20  # people get through


# --- goals ---


def test_people_walk_between_the_goals_they_are_given():
    goals = ((1.0, 3.0), (7.0, 1.0))
    crowd = Crowd(1, speed_m_s=(1.4, 1.5), turn_rate_hz=(0.0, 0.0), pause_s=0.1, goals=goals)
    people = simulate(World(Route(((4.0, 0.4),)), ROOM, (), crowd, FEW_BEAMS), 120.0).people[:, 0]
    for goal in goals:
        gaps = np.linalg.norm(people - goal, axis=1)
        arrivals = np.flatnonzero((gaps[1:] < 0.6) & (gaps[:-1] >= 0.6))
        assert len(arrivals) > 3
    middle = np.abs(people[:, 0] - 4.0) < 1.0
    assert people[middle, 1].min() > 0.7  # straight there, not all over the room
    assert people[middle, 1].max() < 3.3


# --- legs ---


def test_a_laser_sees_the_legs_that_the_truth_tells_and_nothing_else_of_people():
    walk = Track([(0.0, -1.5, 1.2), (3.0, 1.5, 1.2), (4.0, 1.5, 1.2)])
    crowd = Crowd(2, speed_m_s=(0.8, 1.2), legs=True, tracks=(walk,))
    simulation = simulate(World(STANDING, SQUARE, people=crowd, laser=Laser(n_beams=121)), 4.5, seed=3)
    faces = np.concatenate([outline(wall.corners) for wall in SQUARE])
    seen = 0
    for k in range(0, 45, 3):
        legs = [(x, y, 0.06) for x, y in simulation.legs[k].reshape(-1, 2) if np.isfinite(x)]
        for beam, angle in enumerate(simulation.poses[k, 2] + simulation.world.laser.angles):
            distances = slow_distances(*simulation.poses[k, :2], angle, faces, legs)
            nearest = distances.min()
            assert simulation.distances[k, beam] == pytest.approx(nearest, abs=1e-9)
            hits_leg = distances.argmin() >= len(faces)
            assert simulation.hits[k, beam] == (Hit.PERSON if hits_leg else Hit.WALL)
            seen += hits_leg
    assert seen > 30


def test_legs_swing_as_people_walk_and_stay_within_the_body():
    walk = Track([(0.0, -1.5, 1.2), (3.0, 1.5, 1.2), (5.0, 1.5, 1.2)])
    simulation = simulate(World(STANDING, SQUARE, people=Crowd(legs=True, tracks=(walk,))), 5.0)
    left, right = simulation.legs[:, 0, 0], simulation.legs[:, 0, 1]
    middle = simulation.people[:, 0]
    np.testing.assert_allclose((left + right) / 2, middle, atol=1e-12)
    assert np.linalg.norm(left - middle, axis=1).max() + 0.06 <= 0.25 + 1e-9
    walking = slice(1, 31)
    np.testing.assert_allclose((left - right)[walking, 1], 0.3, atol=1e-9)
    ahead = (left - right)[walking, 0]
    assert ahead.max() > 0.2
    assert ahead.min() < -0.2
    steps = np.flatnonzero(np.diff(np.sign(ahead)))  # legs pass each other every 0.7 m, 7 scans
    assert set(np.diff(steps).tolist()) == {7}
    np.testing.assert_allclose(np.diff(left[31:], axis=0), 0.0, atol=1e-12)  # who stands, stands


def test_legs_change_nobodys_way():
    world = World(DRIVING, ROOM, (), Crowd(5), FEW_BEAMS)
    plain = simulate(world, 20.0)
    legged = simulate(replace(world, people=Crowd(5, legs=True)), 20.0)
    np.testing.assert_array_equal(plain.people, legged.people)
    assert plain.legs is None


# --- glass ---

PANES = (Glass((-1.0, 1.0), (1.0, 1.2), 0.02, 0.7), Glass((1.0, -1.5), (1.0, 1.5), 0.05, 0.25))


def test_beams_pass_glass_or_end_on_it_and_never_elsewhere():
    world = World(STANDING, SQUARE, glass=PANES, laser=Laser(n_beams=91, fov_rad=1.9 * math.pi, max_range_m=2.4))
    simulation = simulate(world, 4.0, seed=5)
    walls = np.concatenate([outline(wall.corners) for wall in SQUARE])
    panes = [outline(pane.corners) for pane in PANES]
    met, passed = np.zeros(2), np.zeros(2)
    for beam, angle in enumerate(world.laser.angles):
        to_wall = slow_distances(0.0, 0.0, angle, walls, []).min()
        to_panes = [slow_distances(0.0, 0.0, angle, pane, []).min() for pane in panes]
        possible = {(min(to_wall, 2.4), Hit.WALL if to_wall < 2.4 else Hit.NOTHING)} | {
            (d, Hit.GLASS) for d in to_panes if d < min(to_wall, 2.4)
        }
        for distance, hit in zip(simulation.distances[:, beam], simulation.hits[:, beam], strict=True):
            assert any(abs(min(distance, 2.4) - d) < 1e-9 and hit == h for d, h in possible)
        order = np.argsort(to_panes)
        if np.isfinite(to_panes[order[0]]):
            met[order[0]] += 40
            passed[order[0]] += np.count_nonzero(abs(simulation.distances[:, beam] - to_panes[order[0]]) > 1e-9)
    np.testing.assert_allclose(passed / met, [0.7, 0.25], atol=0.05)
    again, other = simulate(world, 4.0, seed=5), simulate(world, 4.0, seed=6)
    np.testing.assert_array_equal(again.hits, simulation.hits)
    assert (other.hits != simulation.hits).any()


@pytest.mark.parametrize(("pass_share", "hits"), [(0.0, {Hit.GLASS}), (1.0, {Hit.WALL})])
def test_all_or_no_beams_pass(pass_share, hits):
    pane = Glass((1.0, -1.9), (1.0, 1.9), pass_share=pass_share)
    world = World(STANDING, SQUARE, glass=(pane,), laser=replace(QUIET, fov_rad=1.0, n_beams=7))
    assert set(simulate(world, 1.0).hits.ravel()) == hits


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_clear_panes_return_only_beams_that_are_about_square(turned):
    ends = [(1.0, -1.9), (1.0, 1.9)]
    cos, sin = math.cos(turned), math.sin(turned)
    start, end = ((cos * x - sin * y, sin * x + cos * y) for x, y in ends)
    pane = Glass(start, end, pass_share=0.0, seen_within_deg=20.0)
    route = replace(STANDING, heading_rad=turned)
    world = World(route, SQUARE, glass=(pane,), laser=replace(QUIET, fov_rad=math.radians(80), n_beams=81))
    hits = simulate(world, 0.5).hits
    square = abs(world.laser.angles) < math.radians(19.9)
    assert (hits[:, square] == Hit.GLASS).all()
    assert (hits[:, abs(world.laser.angles) > math.radians(20.1)] == Hit.WALL).all()


def test_nobody_walks_through_glass():
    panes = (Glass((4.0, 0.0), (4.0, 4.0), pass_share=1.0),)
    world = World(Route(((1.0, 2.0), (3.0, 2.0))), ROOM, (), Crowd(8, (0.8, 1.5)), FEW_BEAMS, glass=panes)
    simulation = simulate(world, 90.0)
    assert_nobody_overlaps(simulation)
    assert simulation.people[..., 0].max() < 3.75
    assert simulation.people[..., 0].min() < 1.0


# --- a laser that sweeps ---


def test_beams_of_a_sweep_start_where_the_laser_is_by_then():
    walk = Track([(0.0, 7.0, 3.0), (20.0, 1.0, 3.0)])
    route = Route(((1.0, 1.0), (7.0, 1.0), (7.0, 3.0)), speed_m_s=1.0, turn_rad_s=2.0)
    laser = Laser(n_beams=31, sweep_s=0.08, sigma_m=0.0, dropout=0.0)
    simulation = simulate(World(route, ROOM, (), Crowd(tracks=(walk,)), laser), 20.0)
    instant = simulate(World(route, ROOM, (), Crowd(tracks=(walk,)), replace(laser, sweep_s=0.0)), 20.0)
    np.testing.assert_array_equal(simulation.poses, instant.poses)
    np.testing.assert_array_equal(instant.poses, instant.sweep_ends)
    faces = np.concatenate([outline(wall.corners) for wall in ROOM])
    turns = drives = 0
    for k in range(0, len(simulation.t) - 1, 7):
        x, y, theta = simulation.poses[k]
        step = simulation.poses[k + 1] - simulation.poses[k]
        step[2] = math.remainder(step[2], 2 * math.pi)
        turns += abs(step[2]) > 0.1
        drives += abs(step[:2]).max() > 0.05
        for i in range(31):
            u = 0.8 * i / 30  # of the way to the next scan
            angle = theta + u * step[2] + laser.angles[i]
            start = (x + u * step[0], y + u * step[1])
            expected = slow_distances(*start, angle, faces, [(*simulation.people[k, 0], 0.25)]).min()
            if expected < laser.max_range_m:
                assert simulation.distances[k, i] == pytest.approx(expected, abs=1e-9)
                end = np.array(start) + expected * np.array([math.cos(angle), math.sin(angle)])
                np.testing.assert_allclose(simulation.end_points[k, i], end, atol=1e-9)
            else:
                assert np.isnan(simulation.end_points[k, i]).all()
    assert turns > 2
    assert drives > 10
    assert abs(simulation.distances - instant.distances)[np.isfinite(simulation.distances)].max() > 0.05
    scan = simulation.scans[-1]
    np.testing.assert_allclose((scan.x, scan.y, scan.theta), simulation.poses[-1])


# --- what cannot be ---


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: simulate(World(DRIVING, ROOM), 0.0), "duration_s = 0.0"),
        (lambda: Wall(((0.0, 0.0), (1.0, 0.0))), "2 corners"),
        (lambda: Laser(n_beams=0), "n_beams = 0"),
        (lambda: Laser(sweep_s=0.11), r"sweep_s = 0\.11 .* 10 scans a second; wanted 0 to 0\.1 s"),
        (lambda: Glass((0, 0), (1, 0), pass_share=1.2), r"pass_share = 1\.2"),
        (lambda: Glass((0, 0), (0, 0)), "glass stays at"),
        (lambda: Glass((0, 0), (1, 0), seen_within_deg=91), "seen_within_deg = 91; wanted degrees from 0 to 90"),
        (
            lambda: World(DRIVING, ROOM, glass=(Glass((4.0, 1.0), (4.0, 3.0)),)),
            r"the way from .* is 0\.00 m from the glass around \(4\.00, 2\.00\) m",
        ),
        (lambda: Crowd(legs=True, radius_m=0.2), r"people\.radius_m = 0\.2 is too narrow for people\.legs"),
        (lambda: Laser(dropout=1.5), "dropout = 1.5"),
        (
            lambda: simulate(World(DRIVING, ROOM), 1.0, people=500),
            r"people\.number = 500, but only \d+ find room",
        ),
        (lambda: simulate(World(DRIVING, ROOM), 1.0, people=-1), "people.number = -1"),
        (lambda: simulate(World(DRIVING, ROOM), 1.0).states("D9"), "no 'D9' in this world"),
        (lambda: simulate(World(DRIVING, (Wall.box(0, 50, 9e4, 60),)), 1.0, people=1), "square metres"),
    ],
)
def test_what_cannot_be_simulated_is_refused(make, words):
    with pytest.raises((WorldError, ConfigError), match=words):
        make()
