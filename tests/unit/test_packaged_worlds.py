"""The worlds that come with tempog are sound: nothing stands in anything else, and no corner is open."""

import math
from dataclasses import replace
from functools import cache
from itertools import combinations, permutations

import numpy as np
import pytest

from tempog.simulation import Laser, load_world, simulate_site
from tempog.simulation.polygons import outline
from tempog.simulation.site import disc_gap, leg_gap, placed

FEW_BEAMS = Laser(n_beams=5)
PACKAGED = ("hallway", "office", "ring", "rooms")
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


@pytest.mark.parametrize("name", PACKAGED)
def test_things_keep_out_of_walls_and_of_each_other_wherever_they_are(name):
    site = world(name)
    walls = wall_quads(site)
    for thing in site.things:
        if thing.kind != "sliding":  # an open one is inside the wall
            assert not meet(stands(thing), walls).any(), thing.label
    for one, other in combinations(site.things, 2):
        assert not meet(stands(one), stands(other)).any(), (one.label, other.label)


@pytest.mark.parametrize("name", PACKAGED)
def test_closed_doors_fill_their_doorways(name):
    site = world(name)
    for door in site.things:
        if door.kind != "box":
            beside = placed(
                np.array([(-0.01, 0.0), (door.length_m + 0.01, 0.0)]) + door.rectangle.mean(axis=0) * (0, 1),
                door.places["closed"],
            )
            for point in beside:
                assert min(disc_gap(tuple(point), np.array(wall.corners)) for wall in site.walls) == 0, door.label


@pytest.mark.parametrize("name", PACKAGED)
def test_the_robots_way_is_clear_wherever_things_are(name):
    site = world(name)
    stops = site.robot.round_trip
    for thing in site.things:
        for start, end in zip(stops, (*stops[1:], stops[0]), strict=True):
            for corners in stands(thing):
                assert leg_gap(start, end, corners) > site.robot.radius_m + 0.02, thing.label


@pytest.mark.parametrize("name", PACKAGED)
def test_no_beam_leaves_the_building(name):
    site = world(name)
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
@pytest.mark.parametrize("name", PACKAGED)
def test_a_minute_passes_in_which_nobody_is_inside_anything(name, people):
    site = replace(world(name), laser=FEW_BEAMS)
    simulation = simulate_site(site, 60.0, people=people)
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
