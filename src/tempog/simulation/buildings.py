"""Buildings by chance: rooms along one corridor, or around a ring of corridors, turned by any angle.

A plan is drawn along the axes, as the tables of a world file; boxes are put where the robot can see them,
and then everything is turned. Metres and degrees in plans, radians in worlds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.errors import WorldError
from tempog.simulation.polygons import Point, Pose, leg_gap, outline, placed
from tempog.simulation.schedules import Dwell
from tempog.simulation.tracks import Track
from tempog.simulation.world import Route, Thing, Wall, World
from tempog.simulation.world_file import world_from_tables

WALL_M = 0.15  # thickness
NARROWEST_ROOM_M = 3.8  # a door, a doorway and masonry beside them
JAMB_M = 0.45  # from a room's corner to its first doorway: leaves open up to 105 degrees
ROUTE_CLEAR_M = 0.45  # between the middle of the robot's way and what stands or swings beside it
BEFORE_DOORWAY_M = 0.7  # kept free of boxes: people need 0.5 m
NEARBY_M = 3.0  # no box is before a doorway that begins farther away: 1.5 m wide, half a box, and the room kept free
FROM_WALL_M = 0.1  # between a box and a wall or another box
SEEN_WITHIN_M = 8.0
SEEN_FROM = 5  # points on the robot's way, 0.5 m apart, that a place of a box must be in sight of
FORWARD = math.cos(math.radians(125))  # a place farther to the back is out of the laser's view
TRIES = 40  # in each room or corridor

Rectangle = tuple[float, float, float, float]  # x0, y0, x1, y1


@dataclass(frozen=True)
class _Room:
    x0: float
    x1: float
    wall_y: float  # middle of the wall towards the corridor
    inward: int  # +1: the room lies north of that wall, -1: south
    far_y: float

    @property
    def span_y(self) -> tuple[float, float]:
        return min(self.wall_y, self.far_y), max(self.wall_y, self.far_y)

    @property
    def floor(self) -> Rectangle:
        (y0, y1), half = self.span_y, WALL_M / 2
        return self.x0 + half, y0 + half, self.x1 - half, y1 - half


@dataclass
class _Plan:
    """Walls, doorways, doors and the robot's way; with what boxes must keep away from."""

    rooms: list[_Room]
    corridors: list[Rectangle]  # those along x, between the middles of their walls
    tables: dict[str, Any]
    sweeps: list[tuple[Point, float]] = field(default_factory=list)  # hinge and length of each leaf
    doorways: list[tuple[Point, Point]] = field(default_factory=list)
    looked_into: list[_Room] = field(default_factory=list)  # through a doorway without a door

    @property
    def corridor_m(self) -> float:
        return self.corridors[0][3] - self.corridors[0][1]


def random_building(seed: int = 0) -> World:
    """A building with 6 to 12 rooms, a door each, and 2 to 5 boxes.

    Rooms, doors and boxes differ in size; doors open to either side, some have a third place, and some rooms a
    doorway without a door. Boxes have one to three places. One that has a single place is carried in and out:
    its other place, "away", lies outside the building. All is turned by some angle about some point.

    Parameters
    ----------
    seed : int
        0 or more; the same seed gives the same building.

    Returns
    -------
    World
        900 s long, without people.

    Raises
    ------
    WorldError
        A `seed` below 0.

    Examples
    --------
    >>> building = random_building(3)
    >>> building.name, len(building.things)
    ('random 3', 12)
    """
    if seed < 0:
        raise WorldError(f"seed = {seed!r} names no building; wanted 0 or more")
    rng = np.random.default_rng([seed, 2007])  # not the numbers that the simulation with this seed draws
    plan = _ring(rng) if rng.random() < 0.5 else _one_corridor(rng)
    for k, room in enumerate(plan.rooms):
        _add_doors(plan, room, f"D{k + 1}", rng)
    plan.tables["name"] = f"random {seed}"
    world = world_from_tables(plan.tables)
    world = replace(world, things=(*world.things, *_boxes(plan, world, rng)))
    points = np.array([corner for wall in world.walls for corner in wall.corners])
    x, y = rng.uniform(points.min(axis=0), points.max(axis=0))
    return turned(world, rng.uniform(-math.pi, math.pi), (float(x), float(y)))


def turned(world: World, angle_rad: float, about: Point) -> World:
    """The same world, turned to the left about a point."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)

    def turn(x: float, y: float) -> Point:
        dx, dy = x - about[0], y - about[1]
        return about[0] + c * dx - s * dy, about[1] + s * dx + c * dy

    def turn_thing(thing: Thing) -> Thing:
        places = {name: (*turn(x, y), theta + angle_rad) for name, (x, y, theta) in thing.places.items()}
        return replace(thing, places=places)

    def turn_track(track: Track) -> Track:
        return Track([(t, *turn(x, y)) for t, x, y in track.samples.tolist()])

    return replace(
        world,
        walls=tuple(Wall(tuple(turn(*corner) for corner in wall.corners)) for wall in world.walls),
        things=tuple(turn_thing(thing) for thing in world.things),
        robot=replace(
            world.robot,
            waypoints=tuple(turn(*point) for point in world.robot.waypoints),
            heading_rad=world.robot.heading_rad + angle_rad,
        ),
        people=replace(
            world.people,
            goals=tuple(turn(*goal) for goal in world.people.goals),
            tracks=tuple(turn_track(track) for track in world.people.tracks),
        ),
        glass=tuple(replace(pane, start=turn(*pane.start), end=turn(*pane.end)) for pane in world.glass),
    )


# ---- plans -----------------------------------------------------------------------------------------------


def _one_corridor(rng: np.random.Generator) -> _Plan:
    """A corridor along x, rooms north and south of it."""
    n_north, n_south = (int(n) for n in rng.integers(3, 7, 2))
    length, width = _length(max(n_north, n_south), rng), rng.uniform(2.6, 3.2)
    north, south = rng.uniform(3.5, 5.5, 2)
    rooms = [
        *_row(0.0, length, n_south, 0.0, -south, rng),
        *_row(0.0, length, n_north, width, width + north, rng),
    ]
    lines = [_box_line(0.0, -south, length, width + north), [[0, 0], [length, 0]], [[0, width], [length, width]]]
    middle = width / 2
    waypoints = [[1.0, middle], [length - 1.0, middle]]
    return _plan(rooms, [(0.0, 0.0, length, width)], lines, waypoints, "back and forth")


def _ring(rng: np.random.Generator) -> _Plan:
    """Two corridors along x, joined at both ends; rooms between them, north and south."""
    n_south, n_middle, n_north = (int(n) for n in rng.integers(2, 5, 3))
    length, width = _length(max(n_south, n_middle, n_north), rng), rng.uniform(2.6, 3.0)
    north, middle, south = rng.uniform(3.5, 5.0, 3)
    inner, upper, top = width + middle, 2 * width + middle, 2 * width + middle + north
    x0, x1 = -width, length + width
    between = [
        room if rng.random() < 0.5 else replace(room, wall_y=inner, inward=-1, far_y=width)
        for room in _row(0.0, length, n_middle, width, inner, rng)
    ]
    rooms = [*_row(x0, x1, n_south, 0.0, -south, rng), *between, *_row(x0, x1, n_north, upper, top, rng)]
    lines = [
        _box_line(x0, -south, x1, top),
        _box_line(0.0, width, length, inner),
        [[x0, 0], [x1, 0]],
        [[x0, upper], [x1, upper]],
    ]
    left, right, low, high = x0 + width / 2, x1 - width / 2, width / 2, upper - width / 2
    waypoints = [[left, low], [right, low], [right, high], [left, high]]
    return _plan(rooms, [(0.0, 0.0, length, width), (0.0, inner, length, upper)], lines, waypoints, "round")


def _plan(
    rooms: list[_Room], corridors: list[Rectangle], lines: list[Any], waypoints: list[list[float]], route: str
) -> _Plan:
    sides = Counter((x, *room.span_y) for room in rooms for x in (room.x0, room.x1))
    between = [[[x, y0], [x, y1]] for (x, y0, y1), n_rooms in sides.items() if n_rooms == 2]
    tables = {
        "duration_s": 900.0,
        "robot": {"waypoints": waypoints, "route": route, "speed_m_s": 0.6},
        "laser": {"n_beams": 271, "fov_deg": 270.0, "max_range_m": 10.0, "sigma_m": 0.01, "dropout": 0.005},
        "wall": [{"line": line, "thickness_m": WALL_M, "closed": len(line) > 2} for line in [*lines, *between]],
        "opening": [],
        "door": {},
    }
    return _Plan(rooms, corridors, tables)


def _length(n_rooms: int, rng: np.random.Generator) -> float:
    return n_rooms * float(rng.uniform(NARROWEST_ROOM_M + 0.4, NARROWEST_ROOM_M + 1.4))


def _row(x0: float, x1: float, n: int, wall_y: float, far_y: float, rng: np.random.Generator) -> list[_Room]:
    spare = x1 - x0 - n * NARROWEST_ROOM_M
    shares = np.cumsum([0.0, *rng.dirichlet(np.full(n, 2.0))])
    xs = (x0 + spare * shares + NARROWEST_ROOM_M * np.arange(n + 1)).tolist()
    return [_Room(a, b, wall_y, 1 if far_y > wall_y else -1, far_y) for a, b in pairwise(xs)]


def _box_line(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def _add_doors(plan: _Plan, room: _Room, name: str, rng: np.random.Generator) -> None:
    """A door, and perhaps a doorway beside it, through which its open leaf is seen also when it is closed."""
    leaf, inwards = float(rng.uniform(0.8, 1.0)), rng.random() < 0.6
    if not inwards:
        leaf = min(leaf, (plan.corridor_m - WALL_M) / 2 - ROUTE_CLEAR_M)
    open_width = float(rng.uniform(1.1, 1.5)) if rng.random() < (0.95 if inwards else 0.5) else 0.0
    pier = float(rng.uniform(0.2, 0.35)) if open_width else 0.0
    block = leaf + pier + open_width
    start = float(rng.uniform(room.x0 + JAMB_M, room.x1 - JAMB_M - block))
    eastward = rng.random() < 0.5  # the leaf from its hinge; a doorway lies on the hinge's side
    hinge_x = start + pier + open_width if eastward else start + leaf
    if open_width:
        first = start if eastward else start + leaf + pier
        ends = (first, room.wall_y), (first + open_width, room.wall_y)
        plan.tables["opening"].append({"from": list(ends[0]), "to": list(ends[1])})
        plan.doorways.append(ends)
        plan.looked_into.append(room)
    tip_x = hinge_x + (leaf if eastward else -leaf)
    plan.doorways.append(((hinge_x, room.wall_y), (tip_x, room.wall_y)))
    side = room.inward if inwards else -room.inward
    hinge = (hinge_x, room.wall_y + side * WALL_M / 2)
    plan.sweeps.append((hinge, leaf))
    swing = float(rng.uniform(75, 105))
    angles = {"closed": 0.0, "open": swing}
    if rng.random() < 0.2:
        angles["half"] = swing / 2
    plan.tables["door"][name] = {
        "hinge": list(hinge),
        "length_m": leaf,
        "thickness_m": float(rng.uniform(0.04, 0.06)),
        "places": {place: side * a if eastward else 180 - side * a for place, a in angles.items()},
        "schedule": {"dwell_s": {place: float(rng.uniform(40, 90)) for place in angles}},
    }


# ---- boxes -----------------------------------------------------------------------------------------------


def _boxes(plan: _Plan, world: World, rng: np.random.Generator) -> list[Thing]:
    """Boxes at places that the robot sees from its way; the first has one place, and is carried in and out."""
    sight = _Sight(world)
    taken: list[tuple[NDArray[np.float64], float]] = []  # middle and radius
    boxes: list[Thing] = []
    wanted = [1, *rng.integers(1, 4, int(rng.integers(1, 5))).tolist()]
    for k, n_places in enumerate(wanted):
        size = rng.uniform(0.3, 0.8, 2)
        radius = float(np.hypot(*size)) / 2
        poses: list[Pose] = []
        for pose in _poses(plan, size, rng):
            middle = np.array(pose[:2])
            clear = all(np.hypot(*(middle - other)) > radius + reach + FROM_WALL_M for other, reach in taken)
            if clear and _fits(plan, world.robot, pose, size) and sight.reaches(middle):
                poses.append(pose)
                taken.append((middle, radius))
            if len(poses) == n_places:
                break
        if not poses:
            continue
        places = dict(zip("abc", poses, strict=False))
        if len(places) == 1:
            west, south = np.array([corner for wall in world.walls for corner in wall.corners]).min(axis=0)
            places["away"] = (float(west) - 1.0, float(south) + 1.5 * k, 0.0)
        dwell = Dwell({place: float(rng.uniform(40, 80)) for place in places})
        boxes.append(Thing(f"B{k + 1}", "box", float(size[0]), float(size[1]), places, dwell))
    return boxes


def _poses(plan: _Plan, size: NDArray[np.float64], rng: np.random.Generator) -> Iterator[Pose]:
    """Where a box might stand: all in one room or along one corridor, then in the next, in any order."""
    n_rooms = len(plan.looked_into)
    for zone in rng.permutation(n_rooms + len(plan.corridors)).tolist():
        for _ in range(TRIES):
            if zone < n_rooms:
                x0, y0, x1, y1 = plan.looked_into[zone].floor
                reach = float(np.hypot(*size)) / 2 + FROM_WALL_M
                x, y = rng.uniform((x0 + reach, y0 + reach), (x1 - reach, y1 - reach))
                yield float(x), float(y), float(rng.uniform(-math.pi, math.pi))
            else:
                x0, y0, x1, y1 = plan.corridors[zone - n_rooms]
                inset = WALL_M / 2 + FROM_WALL_M / 2 + float(size[1]) / 2
                y = y0 + inset if rng.random() < 0.5 else y1 - inset
                yield float(rng.uniform(x0 + 1.0, x1 - 1.0)), y, 0.0


def _fits(plan: _Plan, robot: Route, pose: Pose, size: NDArray[np.float64]) -> bool:
    middle, radius = (pose[0], pose[1]), float(np.hypot(*size)) / 2
    if any(math.dist(middle, hinge) < leaf + radius + FROM_WALL_M for hinge, leaf in plan.sweeps):
        return False
    corners = placed(np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size / 2, pose)
    near = (ends for ends in plan.doorways if math.dist(middle, ends[0]) < NEARBY_M)
    if any(leg_gap(*ends, corners) < BEFORE_DOORWAY_M for ends in near):
        return False
    stops = robot.round_trip
    return all(
        leg_gap(start, end, corners) > ROUTE_CLEAR_M for start, end in zip(stops, (*stops[1:], stops[0]), strict=True)
    )


class _Sight:
    """What the robot sees from its way, while all doors are closed and no box stands in between."""

    def __init__(self, world: World) -> None:
        leaves = [outline(thing.corners("closed")) for thing in world.things]
        self.segments = np.concatenate([*(outline(wall.corners) for wall in world.walls), *leaves])
        stops = np.array(world.robot.round_trip)
        points, ahead = [], []
        for start, end in zip(stops, np.roll(stops, -1, axis=0), strict=True):
            length = float(np.hypot(*(end - start)))
            points.append(start + np.linspace(0, 1, int(length / 0.5) + 1)[:, None] * (end - start))
            ahead.append(np.broadcast_to((end - start) / length, points[-1].shape))
        self.points, self.ahead = np.concatenate(points), np.concatenate(ahead)

    def reaches(self, target: NDArray[np.float64]) -> bool:
        """Whether a point is in sight of enough of the way."""
        way = target - self.points
        distance = np.hypot(*way.T)
        near = (distance < SEEN_WITHIN_M) & ((way * self.ahead).sum(axis=1) > FORWARD * distance)
        p, way = self.points[near][:, None], way[near][:, None]
        a, b = self.segments[None, :, :2], self.segments[None, :, 2:]
        beside = _cross(way, a - p) * _cross(way, b - p) < 0
        across = _cross(b - a, p - a) * _cross(b - a, target - a) < 0
        return int((~(beside & across).any(axis=1)).sum()) >= SEEN_FROM


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
