"""Worlds as TOML files. `worlds/hallway.toml` shows every table; docstrings of `world` say what keys mean.

Lengths are metres, angles degrees, times seconds::

    duration_s = 900.0
    name = "hall", or else as the file
    [robot]        waypoints = [[x, y], ...], route = "back and forth" | "round", speed_m_s, turn_deg_s,
                   radius_m, stop_m, heading_deg
    [people]       number, speed_m_s = [low, high], turn_rate_hz = [low, high], pause_s, radius_m, legs,
                   goals = [[x, y], ...]
    [[people.track]]  file = "rows of: t person x y", columns = ["t", "person", "x", "y"], rate_hz, scale,
                   rotation_deg, offset = [x, y], start_s
    [laser]        n_beams, fov_deg, rate_hz, max_range_m, sigma_m, dropout, sweep_s
    [pose_error]   white_m, white_deg, drift_m, drift_deg, drift_s
    [[wall]]       line = [[x, y], ...] along its middle, thickness_m, closed; or corners of a convex block
    [[opening]]    from = [x, y], to = [x, y], along the middle of a wall
    [[glass]]      line = [[x, y], ...] along its middle, thickness_m, pass_share, seen_within_deg
    [door.NAME]    hinge = [x, y], length_m, thickness_m, places = {closed = 0, open = 90}, initial, move_s;
                   or, sliding: closed = [x, y], open = [x, y], direction_deg instead of hinge and places
    [box.NAME]     size_m = [length, width], places = {here = [x, y, deg], ...}, initial, move_s
    [door.NAME.schedule]  (or box) one of: moves = [[s, "open"], ...]; dwell_s = {open = 60, closed = 90};
                   daily = [["08:00", "open"], ...] and weekly.mon = [...], with start = "mon 07:59:30";
                   series = "file", values = ["closed", "open"], period_s, speed

A door cuts the wall it stands in when closed, and so does glass; walls are drawn without thinking of either.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError, WorldError
from tempog.simulation.overlaps import check_overlaps
from tempog.simulation.polygons import Point, Pose, check_wall, placed, strip_corners
from tempog.simulation.schedules import DAY_S, DAYS, Dwell, Listed, Move, Never, Schedule, Weekly, read_series
from tempog.simulation.tables import Table, to_number
from tempog.simulation.tracks import Track, read_tracks
from tempog.simulation.world import Crowd, Glass, Laser, PoseError, Route, Thing, Wall, World

PACKAGED = Path(__file__).with_name("worlds")
RANDOM = "random"  # the name of a world that no file describes
CLOCK = re.compile(r"(?:(mon|tue|wed|thu|fri|sat|sun) )?(\d\d):(\d\d)(?::(\d\d))?")
STRAIGHT = 1e-6  # rad; a cut must lie along its wall
SHORTEST_STUB_M = 0.01  # of a wall between two openings; less is rounding, not masonry


def load_world(path: str | Path, seed: int = 0) -> World:
    """Read a world from a TOML file.

    Parameters
    ----------
    path : path of the file
        Or the name of a packaged world: "hallway", "office", "ring" or "rooms"; or "random", a building made
        up by `random_building`.
    seed : int
        Which random building; of no meaning for other worlds.

    Returns
    -------
    World

    Raises
    ------
    WorldError
        Names the file, the key, what was seen and what was wanted.

    Examples
    --------
    >>> hallway = load_world("hallway")
    >>> len(hallway.things), hallway.duration_s
    (8, 900.0)
    """
    path = Path(path)
    if path.name == str(path) and not path.suffix and not path.is_file():
        if path.name == RANDOM:
            from tempog.simulation.buildings import random_building  # here, as it builds from tables, too

            return random_building(seed)
        if packaged(path.name).is_file():
            path = packaged(path.name)
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # ValueError: no UTF-8, no TOML, or a null byte in the path
        names = ", ".join(sorted([RANDOM, *(world.stem for world in PACKAGED.glob("*.toml"))]))
        hint = f"\n  Packaged worlds: {names}." if isinstance(error, OSError) else ""
        raise WorldError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}{hint}") from error
    try:
        return world_from_tables({"name": path.stem, **tables}, path.parent)
    except (WorldError, ConfigError) as error:
        raise WorldError(f"{path}: {error}") from error


def world_from_tables(tables: Mapping[str, Any], folder: Path = Path()) -> World:
    """The world that a file with these tables would describe; series are read from `folder`."""
    return _world(Table(tables, ""), folder)


def packaged(name: str) -> Path:
    """Where the packaged world called `name` would be."""
    return PACKAGED / f"{name}.toml"


def _world(world: Table, folder: Path) -> World:
    name, duration_s = world.text("name", ""), world.number("duration_s", 60.0)
    keyed = [(table.key, piece) for table in world.tables("wall") for piece in _wall(table)]
    check_overlaps([(key, np.array(wall.corners)) for key, (wall, _) in keyed])
    walls = [piece for _, piece in keyed]
    cuts = [_opening(table) for table in world.tables("opening")]
    panes: list[Glass] = []
    for table in world.tables("glass"):
        here = _glass(table)
        cuts += [(pane.start, pane.end, table.key) for pane in here]
        panes += here
    things = []
    for kind in ("door", "box"):
        named = world.table(kind)
        for thing_name in list(named.values):
            table = named.table(thing_name)
            thing = _door(table, thing_name, folder) if kind == "door" else _box(table, thing_name, folder)
            table.done()
            things.append(thing)
            if kind == "door":
                pose = next(iter(thing.places.values()))
                tip = placed(np.array([(thing.length_m, 0.0)]), pose)[0]
                cuts.append(((pose[0], pose[1]), (float(tip[0]), float(tip[1])), table.key))
    robot, people = _robot(world.table("robot")), _people(world.table("people"), folder)
    laser, pose_error = _laser(world.table("laser")), _pose_error(world.table("pose_error"))
    world.done()
    for start, end, key in cuts:
        walls = _cut(walls, start, end, key)
    return World(
        robot=robot,
        walls=tuple(wall for wall, _ in walls),
        things=tuple(things),
        people=people,
        laser=laser,
        pose_error=pose_error,
        duration_s=duration_s,
        name=name,
        glass=tuple(panes),
    )


# ---- walls: (wall, (start, end, thickness) along its middle, or None for a block) ------------------------

Middle = tuple[NDArray[np.float64], NDArray[np.float64], float]
Piece = tuple[Wall, Middle | None]


def _wall(table: Table) -> list[Piece]:
    if table.has("corners"):
        corners = table.points("corners", 3)
        table.done()
        check_wall(corners, table.key)
        return [(Wall(corners), None)]
    line = table.points("line", 2)
    thickness = table.number("thickness_m", 0.15)
    closed = table.flag("closed", False)
    table.done()
    if not thickness > 0:
        raise WorldError(f"{table.key}.thickness_m = {thickness!r}; wanted metres above 0")
    ends = [*line, line[0]] if closed else list(line)
    pieces = []
    for k, (p, q) in enumerate(pairwise(ends)):
        start, end = np.array(p), np.array(q)
        length = float(np.hypot(*(end - start)))
        if not length > 0:
            raise WorldError(f"{table.key}.line stays at {p} and has no area there; wanted points that differ")
        reach = (end - start) / length * thickness / 2  # corners are filled by letting both walls reach over
        first = start - reach if closed or k > 0 else start
        last = end + reach if closed or k < len(ends) - 2 else end
        pieces.append(_straight(first, last, thickness))
    return pieces


def _straight(start: NDArray[np.float64], end: NDArray[np.float64], thickness: float) -> Piece:
    corners = strip_corners((start[0], start[1]), (end[0], end[1]), thickness)
    wall = Wall(tuple((round(float(x), 9), round(float(y), 9)) for x, y in corners))
    return wall, (start, end, thickness)


def _glass(table: Table) -> list[Glass]:
    line = table.points("line", 2)
    thickness, pass_share = table.number("thickness_m", 0.02), table.number("pass_share", 0.9)
    seen_within_deg = table.number("seen_within_deg", 90.0)
    table.done()
    try:
        return [Glass(start, end, thickness, pass_share, seen_within_deg) for start, end in pairwise(line)]
    except WorldError as error:
        raise WorldError(f"{table.key}: {error}") from error


def _opening(table: Table) -> tuple[Point, Point, str]:
    start, end = table.point("from"), table.point("to")
    table.done()
    if start == end:
        raise WorldError(f"{table.key} goes from {start} to the same point; wanted two points along a wall")
    return start, end, table.key


def _cut(walls: list[Piece], start: Point, end: Point, key: str) -> list[Piece]:
    """The walls without what lies between two points along one of them."""
    kept: list[Piece] = []
    found = False
    for wall, middle in walls:
        if middle is None:
            kept.append((wall, middle))
            continue
        first, last, thickness = middle
        length = float(np.hypot(*(last - first)))
        along = (last - first) / length
        across = np.array([-along[1], along[0]])
        s0, s1 = sorted([float((np.array(start) - first) @ along), float((np.array(end) - first) @ along)])
        off = max(abs(float((np.array(p) - first) @ across)) for p in (start, end))
        turned = abs(float((np.array(end) - np.array(start)) @ across)) / math.hypot(
            end[0] - start[0], end[1] - start[1]
        )
        if off > thickness / 2 + 1e-6 or turned > STRAIGHT or s1 <= 0 or s0 >= length:
            kept.append((wall, middle))
            continue
        found = True
        if s0 > SHORTEST_STUB_M:
            kept.append(_straight(first, first + s0 * along, thickness))
        if length - s1 > SHORTEST_STUB_M:
            kept.append(_straight(first + s1 * along, last, thickness))
    if not found and key.startswith("opening"):
        raise WorldError(f"{key} from {start} to {end} lies in no wall; wanted two points along the middle of one")
    return kept


# ---- what moves ------------------------------------------------------------------------------------------


def _door(table: Table, name: str, folder: Path) -> Thing:
    length, thickness = table.number("length_m", 0.9), table.number("thickness_m", 0.05)
    places: dict[str, Pose]
    if table.has("hinge"):
        x, y = table.point("hinge")
        angles = table.table("places")
        places = {place: (x, y, math.radians(angles.number(place))) for place in list(angles.values)}
        kind = "hinged"
    else:
        if not table.has("direction_deg"):
            raise WorldError(
                f"{table.key} has neither hinge nor direction_deg; wanted a hinged door (hinge, places) or a"
                " sliding one (closed, open, direction_deg)"
            )
        theta = math.radians(table.number("direction_deg"))
        places = {place: (*table.point(place), theta) for place in ("closed", "open")}
        kind = "sliding"
    return _thing(table, name, kind, length, thickness, places, folder)


def _box(table: Table, name: str, folder: Path) -> Thing:
    length, width = table.numbers("size_m", 2)
    named = table.table("places")
    places: dict[str, Pose] = {}
    for place in list(named.values):
        x, y, deg = named.numbers(place, 3)
        places[place] = (x, y, math.radians(deg))
    return _thing(table, name, "box", length, width, places, folder)


def _thing(
    table: Table, name: str, kind: Any, length: float, thickness: float, places: dict[str, Pose], folder: Path
) -> Thing:
    initial = table.text("initial", "") if table.has("initial") else ""
    move_s = table.number("move_s", 1.0)
    schedule_table = table.table("schedule")
    try:
        schedule = _schedule(schedule_table, folder)
    except WorldError as error:
        start = "" if str(error).startswith(table.key) else f"{schedule_table.key}."
        raise WorldError(f"{start}{error}") from error
    return Thing(name, kind, length, thickness, places, schedule, initial, move_s)


def _schedule(table: Table, folder: Path) -> Schedule:
    kinds = [kind for kind in ("moves", "dwell_s", "series") if table.has(kind)]
    clock = [kind for kind in ("daily", "weekly") if table.has(kind)]
    if len(kinds) + bool(clock) > 1:
        raise WorldError(f"{table.key} has {' and '.join(kinds + clock)}; wanted one way to say when it moves")
    schedule: Schedule = Never()
    if clock:
        schedule = _weekly(table)
    elif kinds == ["moves"]:
        schedule = Listed(tuple((to_number(t, table.full("moves")), p) for t, p in _pairs(table, "moves")))
    elif kinds == ["dwell_s"]:
        dwell = table.table("dwell_s")
        schedule = Dwell({place: dwell.number(place) for place in list(dwell.values)})
    elif kinds == ["series"]:
        file = folder / table.text("series")
        values = table.take("values", ["closed", "open"])
        if not (isinstance(values, list) and len(values) > 1 and all(isinstance(value, str) for value in values)):
            raise WorldError(f"{table.full('values')} = {values!r}; wanted two places or more, for 0, 1, ...")
        schedule = read_series(file, values, table.number("period_s", 60.0), table.number("speed", 1.0))
    table.done()
    return schedule


def _weekly(table: Table) -> Weekly:
    times: list[Move] = []
    if table.has("daily"):
        daily = [(_clock(t, table.full("daily")), place) for t, place in _pairs(table, "daily")]
        times += [(day * DAY_S + t, place) for day in range(7) for t, place in daily]
    weekly = table.table("weekly")
    for day, day_name in enumerate(DAYS):
        if weekly.has(day_name):
            pairs = _pairs(weekly, day_name)
            times = [(t, place) for t, place in times if not day * DAY_S <= t < (day + 1) * DAY_S]
            times += [(day * DAY_S + _clock(t, weekly.full(day_name)), place) for t, place in pairs]
    weekly.done()
    return Weekly(tuple(sorted(times)), _clock(table.text("start", "mon 00:00"), table.full("start")))


def _pairs(table: Table, key: str) -> list[tuple[Any, str]]:
    value = table.take(key)
    if not isinstance(value, list):
        raise WorldError(f'{table.full(key)} = {value!r}; wanted pairs like [12.5, "open"]')
    for k, pair in enumerate(value):
        if not (isinstance(pair, list) and len(pair) == 2 and isinstance(pair[1], str)):
            raise WorldError(f'{table.full(key)}[{k}] = {pair!r}; wanted a time and a place, like [12.5, "open"]')
    return [(t, place) for t, place in value]


def _clock(value: Any, key: str) -> float:
    """Seconds since midnight, or since Monday 00:00 where a day is named."""
    match = CLOCK.fullmatch(value) if isinstance(value, str) else None
    if match is None or int(match[2]) > 23 or int(match[3]) > 59 or int(match[4] or 0) > 59:
        raise WorldError(f'{key} holds {value!r}; wanted a time of day like "08:30", "08:30:15" or "mon 08:30"')
    day = DAYS.index(match[1]) if match[1] else 0
    return day * DAY_S + int(match[2]) * 3600 + int(match[3]) * 60 + int(match[4] or 0)


# ---- who moves, and who looks ----------------------------------------------------------------------------


def _robot(table: Table) -> Route:
    default = Route(((0.0, 0.0),))
    route = table.text("route", "back and forth")
    if route not in ("back and forth", "round"):
        raise WorldError(f'{table.full("route")} = {route!r}; wanted "back and forth" or "round"')
    robot = Route(
        waypoints=table.points("waypoints", 1),
        back_and_forth=route == "back and forth",
        speed_m_s=table.number("speed_m_s", default.speed_m_s),
        turn_rad_s=math.radians(table.number("turn_deg_s", 90.0)),
        radius_m=table.number("radius_m", default.radius_m),
        stop_m=table.number("stop_m", default.stop_m),
        heading_rad=math.radians(table.number("heading_deg", 0.0)),
    )
    table.done()
    return robot


def _people(table: Table, folder: Path) -> Crowd:
    default = Crowd()
    number = table.take("number", 0)
    if isinstance(number, bool) or not isinstance(number, int):
        raise WorldError(f"{table.full('number')} = {number!r}; wanted a whole number")
    slow, fast = table.numbers("speed_m_s", 2, list(default.speed_m_s))
    rare, often = table.numbers("turn_rate_hz", 2, list(default.turn_rate_hz))
    crowd = Crowd(
        number=number,
        speed_m_s=(slow, fast),
        turn_rate_hz=(rare, often),
        pause_s=table.number("pause_s", default.pause_s),
        radius_m=table.number("radius_m", default.radius_m),
        legs=table.flag("legs", default.legs),
        goals=table.points("goals", 1) if table.has("goals") else (),
        tracks=tuple(track for one in table.tables("track") for track in _tracks(one, folder)),
    )
    table.done()
    return crowd


def _tracks(table: Table, folder: Path) -> list[Track]:
    columns = table.take("columns") if table.has("columns") else None
    if columns is not None and not (isinstance(columns, list) and all(isinstance(name, str) for name in columns)):
        raise WorldError(f'{table.full("columns")} = {columns!r}; wanted names like ["t", "person", "x", "y"]')
    file = folder / table.text("file")
    offset = table.numbers("offset", 2, [0.0, 0.0])
    start_s = table.number("start_s") if table.has("start_s") else None
    rate_hz, scale = table.number("rate_hz", 1.0), table.number("scale", 1.0)
    rotation_rad = math.radians(table.number("rotation_deg", 0.0))
    table.done()
    try:
        return read_tracks(file, columns, rate_hz, scale, rotation_rad, (offset[0], offset[1]), start_s)
    except WorldError as error:
        raise WorldError(f"{table.full('file') if 'cannot read' in str(error) else table.key}: {error}") from error


def _laser(table: Table) -> Laser:
    default = Laser()
    n_beams = table.take("n_beams", default.n_beams)
    if isinstance(n_beams, bool) or not isinstance(n_beams, int):
        raise WorldError(f"{table.full('n_beams')} = {n_beams!r}; wanted a whole number")
    laser = Laser(
        n_beams=n_beams,
        fov_rad=math.radians(table.number("fov_deg", 180.0)),
        rate_hz=table.number("rate_hz", default.rate_hz),
        max_range_m=table.number("max_range_m", default.max_range_m),
        sigma_m=table.number("sigma_m", default.sigma_m),
        dropout=table.number("dropout", default.dropout),
        sweep_s=table.number("sweep_s", default.sweep_s),
    )
    table.done()
    return laser


def _pose_error(table: Table) -> PoseError:
    error = PoseError(
        white_m=table.number("white_m", 0.0),
        white_rad=math.radians(table.number("white_deg", 0.0)),
        drift_m=table.number("drift_m", 0.0),
        drift_rad=math.radians(table.number("drift_deg", 0.0)),
        drift_s=table.number("drift_s", 60.0),
    )
    table.done()
    return error
