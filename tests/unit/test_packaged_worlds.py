"""The worlds that come with tempog are sound: nothing stands in anything else, and no corner is open."""

import math
from dataclasses import replace
from functools import cache
from itertools import combinations, permutations

import numpy as np
import pytest

from tempog.cli.app import run
from tempog.errors import WorldError
from tempog.simulation import Crowd, Glass, Hit, Laser, load_world, simulate
from tempog.simulation.buildings import _one_corridor, _ring, random_building, turned
from tempog.simulation.polygons import disc_gap, leg_gap, outline, placed
from tempog.simulation.tracks import Track
from tempog.simulation.truth import truth_paths

FEW_BEAMS = Laser(n_beams=5)
PACKAGED = ("hallway", "office", "ring", "rooms")
WORLDS = [*((name, 0) for name in PACKAGED), *(("random", seed) for seed in range(31))]
SIMULATED = [*((name, 0) for name in PACKAGED), *(("random", seed) for seed in range(3))]
TOUCHING_M = 1e-6  # leaves and jambs share a face

world = cache(load_world)


def stands(thing):
    """The thing at all of its places, and on its way from each to each of the others; (n, 4, 2) metres."""
    poses = [np.array(pose) for pose in thing.places.values()]
    if thing.kind != "box":
        poses += [a + part * (b - a) for a, b in permutations(poses, 2) for part in (0.25, 0.5, 0.75)]
    return np.array([placed(thing.rectangle, pose) for pose in poses])


def meet(a, b):
    """Whether convex quadrilaterals (n, 4, 2) and (m, 4, 2) overlap, as (n, m): no side of either parts them."""
    parted = np.zeros((len(a), len(b)), dtype=bool)
    for one, other, swapped in ((a, b, False), (b, a, True)):
        sides = np.roll(one, -1, axis=1) - one
        normals = np.stack([-sides[..., 1], sides[..., 0]], axis=-1) / np.linalg.norm(sides, axis=-1)[..., None]
        own = np.einsum("ist,ikt->isk", normals, one)
        along = np.einsum("ist,jkt->ijsk", normals, other)
        low, high = own.min(axis=-1)[:, None] + TOUCHING_M, own.max(axis=-1)[:, None] - TOUCHING_M
        apart = ((along.max(axis=-1) <= low) | (along.min(axis=-1) >= high)).any(axis=-1)
        parted |= apart.T if swapped else apart
    return ~parted


def gaps(points, corners):
    """Distances of points (n, 2) to polygons (n, k, 2) or (k, 2); 0 inside."""
    corners = np.broadcast_to(corners, (len(points), *np.shape(corners)[-2:]))
    side, way = np.roll(corners, -1, axis=1) - corners, points[:, None] - corners
    u = np.clip((way * side).sum(-1) / (side**2).sum(-1), 0, 1)
    left = side[..., 0] * way[..., 1] - side[..., 1] * way[..., 0]
    inside = (left > 0).all(axis=1) | (left < 0).all(axis=1)
    return np.where(inside, 0.0, np.linalg.norm(u[..., None] * side - way, axis=-1).min(axis=1))


def wall_quads(site):
    return np.array([wall.corners for wall in site.walls])


@pytest.mark.parametrize(("name", "seed"), WORLDS)
def test_things_keep_out_of_walls_and_of_each_other_wherever_they_are(name, seed):
    site = world(name, seed)
    walls = wall_quads(site)
    for thing in site.things:
        if thing.kind != "sliding":  # an open one is inside the wall
            assert not meet(stands(thing), walls).any(), thing.label
    for one, other in combinations(site.things, 2):
        assert not meet(stands(one), stands(other)).any(), (one.label, other.label)


@pytest.mark.parametrize(("name", "seed"), WORLDS)
def test_closed_doors_fill_their_doorways(name, seed):
    site = world(name, seed)
    for door in site.things:
        if door.kind != "box":
            beside = placed(
                np.array([(-0.01, 0.0), (door.length_m + 0.01, 0.0)]) + door.rectangle.mean(axis=0) * (0, 1),
                door.places["closed"],
            )
            for point in beside:
                assert min(disc_gap(tuple(point), np.array(wall.corners)) for wall in site.walls) == 0, door.label


@pytest.mark.parametrize(("name", "seed"), WORLDS)
def test_the_robots_way_is_clear_wherever_things_are(name, seed):
    site = world(name, seed)
    stops = site.robot.round_trip
    for thing in site.things:
        for start, end in zip(stops, (*stops[1:], stops[0]), strict=True):
            for corners in stands(thing):
                assert leg_gap(start, end, corners) > site.robot.radius_m + 0.02, thing.label


@pytest.mark.parametrize(("name", "seed"), WORLDS)
def test_no_beam_leaves_the_building(name, seed):
    site = world(name, seed)
    stops = np.array(site.robot.round_trip)
    parts = np.linspace(0, 1, 5)[:-1, None, None]
    points = (stops + parts * (np.roll(stops, -1, axis=0) - stops)).reshape(-1, 1, 1, 2)
    angles = np.linspace(0, 2 * math.pi, 400)
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[None, :, None]
    sides = np.concatenate([outline(corners) for corners in wall_quads(site)])
    a, b = sides[:, :2] - points, sides[:, 2:] - points
    a_left, b_left = (beams[..., 0] * end[..., 1] - beams[..., 1] * end[..., 0] for end in (a, b))
    a_ahead, b_ahead = ((beams * end).sum(axis=-1) for end in (a, b))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = a_ahead + a_left / (a_left - b_left) * (b_ahead - a_ahead)
    hit = (a_left * b_left <= 0) & (distance > 0)
    assert hit.any(axis=-1).all()


@pytest.mark.parametrize("people", [0, 10])
@pytest.mark.parametrize(("name", "seed"), SIMULATED)
def test_a_minute_passes_in_which_nobody_is_inside_anything(name, seed, people):
    site = replace(world(name, seed), laser=FEW_BEAMS)
    simulation = simulate(site, 60.0, seed=seed, people=people)
    everybody = [(simulation.poses[:, :2], site.robot.radius_m)]
    everybody += [(simulation.people[:, i], site.people.radius_m) for i in range(people)]
    for points, reach in everybody:
        for wall in site.walls:
            assert gaps(points, wall.corners).min() >= reach
        for k in range(len(site.things)):
            there = np.isfinite(simulation.corners[:, k, 0, 0])
            assert gaps(points[there], simulation.corners[there, k]).min(initial=math.inf) >= reach
    for (one, reach), (two, other_reach) in combinations(everybody, 2):
        assert np.linalg.norm(one - two, axis=1).min() >= reach + other_reach
    walked = np.linalg.norm(np.diff(simulation.poses[:, :2], axis=0), axis=1).sum()
    assert walked > 10  # the robot gets on


def test_the_office_has_twenty_doors_of_different_widths_and_six_boxes():
    things = world("office").things
    doors = [thing for thing in things if thing.kind == "hinged"]
    assert (len(doors), len(things) - len(doors)) == (20, 6)
    assert sorted(len(door.places) for door in doors) == [2] * 19 + [3]
    assert {door.length_m for door in doors} == {0.8, 0.85, 0.9, 0.95, 1.0}


def test_open_leaves_of_the_ring_are_wholly_inside_walls():
    site = world("ring")
    doors = [thing for thing in site.things if thing.kind == "sliding"]
    assert len(doors) == 9
    for door in doors:
        corners = door.corners("open")
        assert any(all(disc_gap(tuple(c), wall) == 0 for c in corners) for wall in wall_quads(site)), door.label


def test_two_doors_of_the_rooms_always_move_together():
    things = {thing.name: thing for thing in world("rooms").things}
    assert things["D1"].schedule == things["D2"].schedule
    assert len(things["D4"].places) == 3


def test_a_random_building_follows_from_its_seed():
    assert random_building(5) == load_world("random", 5)
    assert random_building(5) != random_building(6)
    with pytest.raises(WorldError, match="seed = -1 names no building"):
        random_building(-1)


def test_random_buildings_are_of_many_kinds():
    buildings = [world("random", seed) for seed in range(31)]
    doors = [[thing for thing in site.things if thing.kind == "hinged"] for site in buildings]
    boxes = [[thing for thing in site.things if thing.kind == "box"] for site in buildings]
    assert set(range(7, 13)) <= {len(some) for some in doors} <= set(range(6, 13))
    assert {len(some) for some in boxes} == {2, 3, 4, 5}
    assert {len(door.places) for some in doors for door in some} == {2, 3}
    assert all("away" in some[0].places for some in boxes)
    assert {site.robot.back_and_forth for site in buildings} == {False, True}
    headings = [np.subtract(*site.robot.waypoints[:2]) for site in buildings]
    assert np.ptp([math.atan2(y, x) for x, y in headings]) > 5


@pytest.mark.parametrize(("draw", "n_lines", "n_rows"), [(_one_corridor, 3, 2), (_ring, 4, 3)])
def test_a_wall_parts_any_two_neighbouring_rooms(draw, n_lines, n_rows):
    for seed in range(5):
        plan = draw(np.random.default_rng(seed))
        assert len(plan.tables["wall"]) == n_lines + len(plan.rooms) - n_rows


def test_the_command_makes_the_building_that_its_seed_names(tmp_path, monkeypatch):
    log = tmp_path / "third.npz"
    monkeypatch.setattr(
        "sys.argv", ["tempog", "simulate", "random", "--seed", "3", "--duration", "5", "-o", str(log)]
    )
    with pytest.raises(SystemExit) as stop:
        run()
    assert not stop.value.code
    with np.load(truth_paths(log)[1]) as arrays:
        np.testing.assert_array_equal(arrays["distances"], simulate(random_building(3), 5.0, seed=3).distances)


def test_a_turned_world_looks_the_same_from_inside():
    people = Crowd(goals=((1.5, 0.5), (4.0, 1.0)), tracks=(Track([(0.0, 4.0, 0.5), (20.0, 8.0, 1.0)]),))
    pane = Glass((3.0, 0.9), (5.0, 0.9), pass_share=0.5)
    straight = world("hallway")
    few = Laser(n_beams=6, fov_rad=2.9)  # beams that meet no corner
    straight = replace(straight, laser=few, people=people, glass=(pane,))
    about = (3.0, -2.0)
    there = turned(straight, 1.0, about)
    back = turned(there, -1.0, about)
    np.testing.assert_allclose(back.robot.waypoints, straight.robot.waypoints)
    np.testing.assert_allclose(back.people.goals, people.goals)
    here, there = (simulate(one, 20.0) for one in (straight, there))
    np.testing.assert_allclose(there.distances, here.distances, atol=1e-6)
    assert (there.hit_things == here.hit_things).all()
    assert {Hit.GLASS, Hit.PERSON} <= set(here.hits.ravel().tolist())
