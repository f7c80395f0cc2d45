"""Sites: nobody is ever inside anything, doors keep to their schedule or wait, and a seed says it all."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tempog.errors import WorldError
from tempog.simulation import Crowd, Hit, Laser, PoseError, Route, Site, Thing, Wall, load_world, simulate_site
from tempog.simulation.polygons import outline
from tempog.simulation.schedules import Dwell, Listed
from tempog.simulation.simulate import START_S
from tempog.simulation.simulate_site import MOVING, pose_errors

ROOM = (
    Wall.box(-0.2, -0.2, 8.2, 0.0),
    Wall.box(-0.2, 4.0, 8.2, 4.2),
    Wall.box(-0.2, 0.0, 0.0, 4.0),
    Wall.box(8.0, 0.0, 8.2, 4.0),
)
DRIVING = Route(((1.0, 2.0), (7.0, 2.0)), speed_m_s=1.0)
FEW_BEAMS = Laser(n_beams=5)


def door(schedule=None, places=None, **other):
    places = places or {"closed": (4.0, 3.9, math.pi), "open": (4.0, 3.9, 1.5 * math.pi)}
    return Thing("D", "hinged", 0.9, 0.05, places, schedule or Listed(()), **other)


def box(places, schedule, name="B"):
    return Thing(name, "box", 0.4, 0.3, places, schedule)


def gaps(points, corners):
    """Distances of points (n, 2) to polygons (n, k, 2) or (k, 2); 0 inside."""
    corners = np.broadcast_to(corners, (len(points), *np.shape(corners)[-2:]))
    p, q = corners, np.roll(corners, -1, axis=1)
    side, way = q - p, points[:, None] - p
    u = np.clip((way * side).sum(-1) / (side**2).sum(-1), 0, 1)
    gap = np.linalg.norm(p + u[..., None] * side - points[:, None], axis=-1).min(axis=1)
    left = side[..., 0] * way[..., 1] - side[..., 1] * way[..., 0]
    return np.where((left > 0).all(axis=1) | (left < 0).all(axis=1), 0.0, gap)


def assert_nobody_overlaps(simulation):
    site = simulation.site
    robot, people = simulation.poses[:, :2], simulation.people
    radius = site.people.radius_m
    everybody = [(robot, site.robot.radius_m), *((people[:, i], radius) for i in range(people.shape[1]))]
    for points, reach in everybody:
        for wall in site.walls:
            assert gaps(points, wall.corners).min() >= reach
        for k in range(len(site.things)):
            there = np.isfinite(simulation.corners[:, k, 0, 0])
            assert gaps(points[there], simulation.corners[there, k]).min() >= reach
    for (one, reach), (two, other_reach) in combinations(everybody, 2):
        assert np.linalg.norm(one - two, axis=1).min() >= reach + other_reach


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
    site = Site(DRIVING, ROOM, things, Crowd(12, speed_m_s=(0.05, 1.5)), FEW_BEAMS)
    simulation = simulate_site(site, 90.0, seed=seed)
    assert_nobody_overlaps(simulation)
    assert all((np.diff(simulation.places[:, k]) != 0).sum() > 5 for k in range(3))


@pytest.mark.parametrize("people", [0, 20, 60])
def test_nobody_in_the_hallway_ever_overlaps_anything(people):
    site = replace(load_world("hallway"), laser=FEW_BEAMS)
    simulation = simulate_site(site, 300.0, seed=people, people=people)
    assert_nobody_overlaps(simulation)
    assert np.linalg.norm(np.diff(simulation.poses[:, :2], axis=0), axis=1).sum() > 30  # the robot gets on


def test_the_robot_goes_from_a_to_b_and_back_several_times_even_through_a_crowd():
    site = replace(load_world("hallway"), laser=FEW_BEAMS)
    x = simulate_site(site, people=60).poses[:, 0]
    assert x.min() < 1.6
    assert x.max() > 34.4
    middle_passed = np.count_nonzero((x[:-1] < 18) != (x[1:] < 18))
    assert middle_passed >= 3


def test_nobody_walks_faster_than_they_can_or_leaves_the_building():
    site = replace(load_world("hallway"), laser=FEW_BEAMS, people=Crowd(30, speed_m_s=(0.4, 0.8)))
    people = simulate_site(site, 120.0).people
    speed = np.linalg.norm(np.diff(people, axis=0), axis=2) / 0.1
    assert speed.max() <= 0.8 + 1e-9
    assert np.sort(speed.max(axis=0))[3] >= 0.4 - 1e-9
    assert (speed.mean(axis=0) > 0.05).mean() > 0.9
    assert people.min() > -5
    assert people[..., 0].max() < 36
    assert people[..., 1].max() < 8


def test_a_robot_keeps_to_its_speed_and_turn_rate():
    route = Route(((1.0, 1.0), (7.0, 1.0), (7.0, 3.0)), speed_m_s=0.7, turn_rad_s=1.0)
    poses = simulate_site(Site(route, ROOM, laser=FEW_BEAMS), 120.0).poses
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
    site = Site(Route(((1.0, 1.0),)), ROOM, (door(schedule, move_s=1.5),), laser=FEW_BEAMS)
    simulation = simulate_site(site, 12.0)
    states = [(round(t - START_S, 1), state) for t, state in simulation.states("D")]
    assert states[:3] == [(0.0, "closed"), (2.0, "moving"), (3.5, "open")]
    assert states[3] == (5.0, "moving")  # wanted open again on the way: it closes first, then opens
    assert states[-1] == (8.0, "open")
    np.testing.assert_allclose(simulation.corners[45, 0], site.things[0].corners("open"), atol=1e-9)


def test_a_robot_waits_until_the_door_in_its_way_opens():
    across = door(Listed(((20.0, "open"),)), {"closed": (4.0, 2.4, 1.5 * math.pi), "open": (4.0, 2.4, 0.5 * math.pi)})
    x = simulate_site(Site(DRIVING, ROOM, (across,), laser=FEW_BEAMS), 40.0).poses[:, 0]
    assert x[:200].max() == pytest.approx(3.95 - 0.3 - 0.2 - 0.9, abs=0.12)  # out of reach of the leaf
    assert x.max() == pytest.approx(7.0)


def test_a_door_waits_until_the_robot_in_its_way_has_gone():
    across = door(
        Listed(((3.0, "closed"),)),
        {"closed": (4.0, 2.4, 1.5 * math.pi), "open": (4.0, 2.4, 0.5 * math.pi)},
        initial="open",
    )
    simulation = simulate_site(Site(DRIVING, ROOM, (across,), laser=FEW_BEAMS), 20.0)
    assert simulation.states("D")[1][0] > START_S + 3.05  # the robot passes x = 4 m at 3 s
    assert_nobody_overlaps(simulation)


def test_a_box_is_nowhere_while_it_is_carried():
    crate = box({"here": (2.0, 1.0, 0.0), "there": (6.0, 3.0, 0.5)}, Listed(((1.0, "there"),)))
    simulation = simulate_site(Site(Route(((1.0, 2.0),)), ROOM, (crate,)), 4.0)
    gone = np.isnan(simulation.corners[:, 0, 0, 0])
    np.testing.assert_array_equal(gone, simulation.places[:, 0] == MOVING)
    assert gone.sum() == 10
    assert (simulation.hits[gone] != Hit.BOX).all()
    assert (simulation.hit_things[simulation.hits == Hit.BOX] == 0).all()
    assert (simulation.hits[0] == Hit.BOX).any()


def test_an_open_sliding_leaf_is_seen_by_nobody():
    site = load_world_with_sliding_door()
    simulation = simulate_site(site, 6.0)
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
    return Site(Route(((3.0, 1.0),), heading_rad=math.pi / 2), walls, (leaf,))


def test_a_seed_says_it_all():
    site = load_world("hallway")
    first, again, other = (simulate_site(site, 20.0, seed=seed, people=20) for seed in (3, 3, 4))
    for name in ("poses", "people", "places", "corners", "distances", "hits"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    for one, two in zip(first.scans, again.scans, strict=True):
        np.testing.assert_array_equal(one.ranges, two.ranges)
    assert (first.people != other.people).any()


def test_d8_is_seen_open_only_while_it_is_open():
    site = load_world("hallway")
    simulation = simulate_site(site, 400.0)
    faces = outline(site.things[7].corners("open"))
    middle = faces[:, :2].mean(axis=0)
    closed = simulation.places[:, 7] == 0
    angles = simulation.poses[:, 2:] + site.laser.angles
    ends = simulation.poses[:, None, :2] + np.where(
        np.isfinite(simulation.distances), simulation.distances, site.laser.max_range_m
    )[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    inside_room = (ends[..., 1] < middle[1]) & (abs(ends[..., 0] - middle[0]) < 3)
    assert not inside_room[closed].any()
    assert inside_room[~closed].any()


def test_pose_error_is_told_and_the_truth_is_kept():
    site = Site(DRIVING, ROOM, laser=FEW_BEAMS, pose_error=PoseError(white_m=0.02, drift_rad=0.01))
    simulation = simulate_site(site, 60.0)
    plain = simulate_site(replace(site, pose_error=PoseError()), 60.0)
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


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: simulate_site(Site(DRIVING, ROOM), 0.0), "duration_s = 0.0"),
        (
            lambda: simulate_site(Site(DRIVING, ROOM), 1.0, people=500),
            r"people\.number = 500, but only \d+ find room",
        ),
        (lambda: simulate_site(Site(DRIVING, ROOM), 1.0, people=-1), "people.number = -1"),
        (lambda: simulate_site(Site(DRIVING, ROOM), 1.0).states("D9"), "no 'D9' in this world"),
        (lambda: simulate_site(Site(DRIVING, (Wall.box(0, 50, 9e4, 60),)), 1.0), "square metres"),
    ],
)
def test_what_cannot_be_simulated_is_refused(make, words):
    with pytest.raises(WorldError, match=words):
        make()
