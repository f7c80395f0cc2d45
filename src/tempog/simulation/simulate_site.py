"""Run a site: the scans its robot takes, and the truth about everything in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tempog.errors import WorldError
from tempog.scans.scan import Scan
from tempog.simulation.polygons import covered_cells, outline
from tempog.simulation.simulate import START_S, Hit, take_scans
from tempog.simulation.site import PoseError, Site, leg_gap

CELL_M = 0.2  # of the grid that people plan their ways on; half of what a 0.9 m door leaves to their middles
LONGEST_STEP_S = 0.05  # nobody moves more than 8 cm at once, less than half of anybody
N_GOALS = 60
FREE_AROUND_M = 2.0  # room around everything, where no wall ends the world
MAX_CELLS = 4_000_000  # 400 m x 400 m; each goal keeps a map of the way to it
CLEAR_OF_ROBOT_M = 0.5  # at the start
MOVING = -1  # instead of a place


@dataclass(frozen=True, eq=False)
class SiteSimulation:
    """Scans of a simulated drive through a site, and the truth about them.

    Attributes
    ----------
    site : Site
    duration_s : float, seconds
    scans : list of Scan
        With noise and drop-outs, and with the site's pose error.
    t : (n_scans,) float64, seconds
        Since the start of the simulation; the scans' own clock starts at `START_S`.
    poses : (n_scans, 3) float64
        True pose of the laser: x, y, theta; metres, metres, radians.
    distances : (n_scans, n_beams) float64, metres
        Without noise and drop-outs; +inf where there is nothing within the laser's range.
    hits : (n_scans, n_beams) uint8
        What each beam has hit (`Hit`), also where the return was lost.
    hit_things : (n_scans, n_beams) int16
        Which of `site.things` it has hit, or -1.
    places : (n_scans, n_things) int16
        At which of its places each thing stands, or `MOVING`.
    corners : (n_scans, n_things, 4, 2) float64, metres
        NaN while a box is carried.
    people : (n_scans, n_people, 2) float64, metres
    """

    site: Site
    duration_s: float
    scans: list[Scan]
    t: NDArray[np.float64]
    poses: NDArray[np.float64]
    distances: NDArray[np.float64]
    hits: NDArray[np.uint8]
    hit_things: NDArray[np.int16]
    places: NDArray[np.int16]
    corners: NDArray[np.float64]
    people: NDArray[np.float64]

    def states(self, name: str) -> list[tuple[float, str]]:
        """A thing's states as (t, state from then on), of places' names and "moving".

        t is in seconds of the scans' clock, that of the first scan with the state.
        """
        k = self._index(name)
        names = list(self.site.things[k].places)
        column = self.places[:, k]
        firsts = [0, *(np.flatnonzero(np.diff(column)) + 1).tolist()]
        return [(START_S + float(self.t[i]), "moving" if column[i] == MOVING else names[column[i]]) for i in firsts]

    def cells(self, name: str, place: str, resolution_m: float) -> NDArray[np.int64]:
        """The cells that a thing covers at a place; (n_cells, 2) [row, col], see `covered_cells`."""
        return covered_cells(self.site.things[self._index(name)].corners(place), resolution_m)

    def segments(self, name: str, place: str) -> NDArray[np.float64]:
        """The four faces of a thing at a place; (4, 4) metres: x0, y0, x1, y1."""
        return outline(self.site.things[self._index(name)].corners(place))

    def static_cells(self, resolution_m: float) -> NDArray[np.int64]:
        """The cells that walls cover, inside included; (n_cells, 2) [row, col], sorted, each once."""
        cells = [covered_cells(wall.corners, resolution_m) for wall in self.site.walls]
        return np.unique(np.concatenate([np.empty((0, 2), dtype=np.int64), *cells]), axis=0)

    def _index(self, name: str) -> int:
        for k, thing in enumerate(self.site.things):
            if name in (thing.name, thing.label):
                return k
        names = ", ".join(thing.name for thing in self.site.things) or "nothing"
        raise WorldError(f"there is no {name!r} in this world; wanted one of {names}")


def simulate_site(
    site: Site, duration_s: float | None = None, seed: int = 0, people: int | None = None
) -> SiteSimulation:
    """Take the scans that the robot of a site would take.

    Doors wait until nobody is in their way; the robot stops for leaves and people; people walk around walls,
    closed doors, the robot and each other. Nobody ever overlaps anything.

    Parameters
    ----------
    site : Site
    duration_s : float, seconds, optional
        Default: `site.duration_s`. The first scan is taken at 0 s, the last before `duration_s`.
    seed : int
        Of people, dwell times, noise and pose error. The same seed gives the same simulation.
    people : int, optional
        How many, instead of `site.people.number`.

    Returns
    -------
    SiteSimulation

    Raises
    ------
    WorldError
        A `duration_s` not above 0, or more people than there is room for.

    Examples
    --------
    >>> from tempog.simulation import load_world
    >>> simulation = simulate_site(load_world("hallway"), duration_s=60.0, people=5)
    >>> len(simulation.scans), simulation.people.shape
    (600, (600, 5, 2))
    """
    from tempog.simulation.raycast import cast_beams  # here, so that describing a world needs no Numba
    from tempog.simulation.walking import advance

    if people is not None:
        site = replace(site, people=replace(site.people, number=people))
    duration_s = site.duration_s if duration_s is None else duration_s
    if not 0 < duration_s < np.inf:
        raise WorldError(f"duration_s = {duration_s!r} leaves nothing to simulate; wanted seconds above 0")
    laser, robot, crowd, things = site.laser, site.robot, site.people, site.things
    noise_rng, error_rng, people_rng, *thing_rngs = (
        np.random.default_rng(sequence) for sequence in np.random.SeedSequence(seed).spawn(3 + len(things))
    )
    n_scans = int(np.ceil(round(duration_s * laser.rate_hz, 6)))
    t = np.arange(n_scans) / laser.rate_hz
    n_steps = int(np.ceil(round(1.0 / laser.rate_hz / LONGEST_STEP_S, 6)))
    dt = 1.0 / laser.rate_hz / n_steps

    # Things: all their places in one array, all their moves in another.
    place_poses = [pose for thing in things for pose in thing.places.values()]
    place_start = np.cumsum([0, *(len(thing.places) for thing in things)])
    event_t: list[float] = []
    event_place: list[int] = []
    event_stop: list[int] = []
    at = []
    for thing, first, rng in zip(things, place_start[:-1], thing_rngs, strict=True):
        names = list(thing.places)
        for when, place in thing.schedule.moves(names, thing.initial, duration_s, rng):
            event_t.append(when)
            event_place.append(int(first) + names.index(place))
        event_stop.append(len(event_t))
        at.append(int(first) + names.index(thing.initial))
    rectangles = np.array([thing.rectangle for thing in things]).reshape(-1, 4, 2)
    corners = np.array([thing.corners(thing.initial) for thing in things]).reshape(-1, 4, 2)
    travel = np.column_stack([at, at, at]).astype(np.int32).reshape(-1, 3)
    fraction, held_s = np.ones(len(things)), np.zeros(len(things))
    stops = np.array(event_stop, dtype=np.int32)
    event_next = np.array([0, *event_stop][: len(things)], dtype=np.int32)

    route = np.array(robot.round_trip)
    pose = np.array([*route[0], robot.heading_rad])
    if len(route) > 1:
        pose[2] = np.arctan2(*(route[1] - route[0])[::-1])
    target = np.array([1 % len(route)], dtype=np.int32)

    walls = np.concatenate([np.empty((0, 4)), *(outline(wall.corners) for wall in site.walls)])
    (x0, y0), wall_mask = _wall_mask(site, walls)
    where = _start(site, walls, corners, wall_mask, (x0, y0), people_rng)
    inside = np.argwhere(_reached(wall_mask, route[0], (x0, y0)))
    goals = inside[people_rng.integers(0, len(inside), N_GOALS)].astype(np.int32)
    n = crowd.number
    traits = np.column_stack([people_rng.uniform(*crowd.speed_m_s, n), people_rng.uniform(*crowd.turn_rate_hz, n)])
    mind = np.zeros((n, 7))
    mind[:, 0] = people_rng.uniform(-np.pi, np.pi, n)
    goal = people_rng.integers(0, N_GOALS, n).astype(np.int32)
    n_goals = N_GOALS if n else 1
    fields = np.zeros((n_goals, *wall_mask.shape), dtype=np.int32)
    field_epoch, epoch = np.full(n_goals, -1, dtype=np.int32), np.array([0, -1], dtype=np.int32)
    blocked, queued = wall_mask.copy(), np.zeros_like(wall_mask)
    queue = np.zeros(wall_mask.size, dtype=np.int32)

    segments = np.concatenate([walls, np.zeros((4 * len(things), 4))])
    discs = np.full((n, 3), crowd.radius_m)
    kinds = np.full(len(segments) + n + 1, Hit.NOTHING, dtype=np.uint8)  # the last is for the id NOTHING
    owner = np.full(len(kinds), -1, dtype=np.int16)
    kinds[: len(walls)] = Hit.WALL
    for k, thing in enumerate(things):
        faces = slice(len(walls) + 4 * k, len(walls) + 4 * k + 4)
        kinds[faces] = Hit.BOX if thing.kind == "box" else Hit.DOOR
        owner[faces] = k
    kinds[len(segments) : -1] = Hit.PERSON

    poses = np.empty((n_scans, 3))
    positions = np.empty((n_scans, n, 2))
    all_corners = np.empty((n_scans, len(things), 4, 2))
    places = np.empty((n_scans, len(things)), dtype=np.int16)
    distances = np.empty((n_scans, laser.n_beams))
    ids = np.empty((n_scans, laser.n_beams), dtype=np.int32)
    for i in range(n_scans):
        poses[i], positions[i], all_corners[i] = pose, where, corners
        places[i] = np.where(fraction >= 1.0, travel[:, 1] - place_start[:-1], MOVING)
        segments[len(walls) :, :2] = corners.reshape(-1, 2)
        segments[len(walls) :, 2:] = np.roll(corners, -1, axis=1).reshape(-1, 2)
        discs[:, :2] = where
        cast_beams(
            pose[0], pose[1], pose[2] + laser.angles, segments, discs, float(laser.max_range_m), distances[i], ids[i]
        )
        advance(
            t=float(t[i]), dt=dt, n_steps=n_steps, rng=people_rng,
            walls=walls, rectangles=rectangles,
            carried=np.array([thing.kind == "box" for thing in things], dtype=np.uint8),
            move_s=np.array([thing.move_s for thing in things], dtype=np.float64),
            swing_m=np.array([thing.length_m * (thing.kind == "hinged") for thing in things], dtype=np.float64),
            places=np.array(place_poses, dtype=np.float64).reshape(-1, 3),
            event_t=np.array(event_t, dtype=np.float64), event_place=np.array(event_place, dtype=np.int32),
            event_stop=stops, event_next=event_next, travel=travel, fraction=fraction, held_s=held_s,
            corners=corners, route=route,
            drive=np.array([robot.speed_m_s, robot.turn_rad_s, robot.radius_m, robot.stop_m], dtype=np.float64),
            target=target, robot=pose, people=where, mind=mind, traits=traits, goal=goal,
            radius=float(crowd.radius_m), pause_mean_s=float(crowd.pause_s), goals=goals, fields=fields,
            field_epoch=field_epoch, epoch=epoch, wall_mask=wall_mask, blocked=blocked, queue=queue,
            queued=queued, x0=x0, y0=y0, cell_m=CELL_M,
        )  # fmt: skip

    all_corners[abs(all_corners[..., 0, 0]) > 1e5] = np.nan
    told = poses + pose_errors(site.pose_error, t, error_rng)
    return SiteSimulation(
        site=site,
        duration_s=float(duration_s),
        scans=take_scans(laser, t, told, distances, noise_rng),
        t=t,
        poses=poses,
        distances=distances,
        hits=kinds[ids],
        hit_things=owner[ids],
        places=places,
        corners=all_corners,
        people=positions,
    )


def pose_errors(error: PoseError, t: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """What poses are off by, (n_scans, 3): white noise, plus a drift that forgets itself in `drift_s`."""
    white = rng.normal(size=(len(t), 3)) * (error.white_m, error.white_m, error.white_rad)
    kicks = rng.normal(size=(len(t), 3))
    kept = np.exp(-np.diff(t, prepend=t[0]) / error.drift_s)
    drift = np.empty_like(kicks)
    state = kicks[0]
    for i in range(len(t)):
        state = kept[i] * state + np.sqrt(1.0 - kept[i] ** 2) * kicks[i]
        drift[i] = state
    return white + drift * (error.drift_m, error.drift_m, error.drift_rad)


def _wall_mask(site: Site, walls: NDArray[np.float64]) -> tuple[tuple[float, float], NDArray[np.uint8]]:
    """Origin and cells of the grid that people plan on; 1 where walls leave no room for a person's middle."""
    points = np.concatenate([walls.reshape(-1, 2), np.array(site.robot.waypoints)])
    low = points.min(axis=0) - FREE_AROUND_M
    n_cols, n_rows = np.ceil((points.max(axis=0) + FREE_AROUND_M - low) / CELL_M).astype(int).tolist()
    if n_rows * n_cols > MAX_CELLS:
        raise WorldError(
            f"the world is {n_cols * CELL_M:.0f} x {n_rows * CELL_M:.0f} m; wanted at most"
            f" {MAX_CELLS * CELL_M**2:,.0f} square metres. Are its lengths metres?"
        )
    x = low[0] + (np.arange(n_cols) + 0.5)[None, :] * CELL_M
    y = low[1] + (np.arange(n_rows) + 0.5)[:, None] * CELL_M
    mask = np.zeros((n_rows, n_cols), dtype=np.uint8)
    mask[[0, -1]] = 1  # nobody leaves the world
    mask[:, [0, -1]] = 1
    for ax, ay, bx, by in walls:
        sx, sy = bx - ax, by - ay
        u = np.clip(((x - ax) * sx + (y - ay) * sy) / (sx * sx + sy * sy), 0.0, 1.0)
        mask[np.hypot(ax + u * sx - x, ay + u * sy - y) < site.people.radius_m + 0.01] = 1
    for wall in site.walls:
        sides = outline(wall.corners)
        left = [(x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0 for x0, y0, x1, y1 in sides]
        mask[np.all(left, axis=0) | ~np.any(left, axis=0)] = 1
    return (float(low[0]), float(low[1])), mask


def _reached(mask: NDArray[np.uint8], start: NDArray[np.float64], origin: tuple[float, float]) -> NDArray[np.bool_]:
    """The cells that can be walked to from near `start`, were all doors open."""
    from tempog.simulation.walking import UNREACHED, fill_field

    free = np.argwhere(mask == 0)
    if not len(free):
        raise WorldError("people: there is no room for anybody between the walls; wanted some")
    centre = np.array([(start[1] - origin[1]) / CELL_M - 0.5, (start[0] - origin[0]) / CELL_M - 0.5])
    row, col = free[np.argmin(((free - centre) ** 2).sum(axis=1))].tolist()
    field = np.empty(mask.shape, dtype=np.int32)
    fill_field(mask, row, col, field, np.zeros(mask.size, dtype=np.int32), np.zeros_like(mask))
    return np.asarray(field < UNREACHED)


def _start(
    site: Site,
    walls: NDArray[np.float64],
    corners: NDArray[np.float64],
    mask: NDArray[np.uint8],
    origin: tuple[float, float],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Where people are at first: anywhere inside, clear of everything."""
    crowd, robot = site.people, site.robot
    people = np.empty((crowd.number, 2))
    if not crowd.number:
        return people
    start = np.array(robot.waypoints[0])
    cells = np.argwhere(_reached(mask, start, origin))
    rng.shuffle(cells)
    n = 0
    for row, col in cells.tolist():
        if n == crowd.number:
            break
        x, y = origin[0] + (col + 0.5) * CELL_M, origin[1] + (row + 0.5) * CELL_M
        if np.hypot(*(start - (x, y))) < robot.radius_m + crowd.radius_m + CLEAR_OF_ROBOT_M:
            continue
        if n and np.hypot(*(people[:n] - (x, y)).T).min() < 2 * crowd.radius_m + 0.02:
            continue
        if any(leg_gap((x, y), (x, y), quad) < crowd.radius_m + 0.02 for quad in corners):
            continue
        people[n] = x, y
        n += 1
    if n < crowd.number:
        raise WorldError(f"people.number = {crowd.number}, but only {n} find room; wanted fewer, or more space")
    return people
