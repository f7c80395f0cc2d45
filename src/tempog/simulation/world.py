"""A world in which everybody minds everybody: doors wait for people, people walk around each other.

Metres and radians in the map frame, seconds since the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tempog.errors import ConfigError, WorldError
from tempog.simulation.legs import SMALLEST_BODY_M
from tempog.simulation.polygons import Point, Pose, check_wall, disc_gap, leg_gap, middle_text, placed, strip_corners
from tempog.simulation.room import Room
from tempog.simulation.schedules import Never, Schedule
from tempog.simulation.tracks import Track

GAP_M = 0.01  # kept between bodies
Kind = Literal["hinged", "sliding", "box"]


@dataclass(frozen=True)
class Wall:
    """A solid convex polygon that never moves.

    Attributes
    ----------
    corners : tuple of (x, y), metres
        In order around the wall. A bent wall is several of these.
    """

    corners: tuple[Point, ...]

    def __post_init__(self) -> None:
        if len(self.corners) < 3:
            raise ConfigError(f"a wall has {len(self.corners)} corners; wanted 3 or more (a box has 4)")

    @classmethod
    def box(cls, x_min: float, y_min: float, x_max: float, y_max: float) -> Wall:
        """A rectangle along the axes of the map; metres."""
        return cls(((x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)))


@dataclass(frozen=True)
class Glass:
    """A straight pane that some beams pass through, and nobody else.

    Attributes
    ----------
    start, end : (x, y), metres
        Along its middle.
    thickness_m : float, metres
    pass_share : float, 0..1
        How many of the beams that meet it pass, drawn anew for each beam and scan. It returns the others.
    seen_within_deg : float, degrees, 0..90
        Only beams this close to square onto it are returned at all; clear panes mirror the others away.
    """

    start: Point
    end: Point
    thickness_m: float = 0.02
    pass_share: float = 0.9
    seen_within_deg: float = 90.0

    def __post_init__(self) -> None:
        if not (0 < self.thickness_m < math.inf and 0 <= self.pass_share <= 1):
            raise WorldError(
                f"glass: thickness_m = {self.thickness_m!r}, pass_share = {self.pass_share!r}; wanted metres above 0"
                " and a share in 0..1"
            )
        if not 0 <= self.seen_within_deg <= 90:
            raise WorldError(f"glass: seen_within_deg = {self.seen_within_deg!r}; wanted degrees from 0 to 90")
        if math.dist(self.start, self.end) == 0:
            raise WorldError(f"glass stays at {self.start}; wanted two points that differ")

    @property
    def corners(self) -> NDArray[np.float64]:
        """Its corners, (4, 2) metres."""
        return strip_corners(self.start, self.end, self.thickness_m)


@dataclass(frozen=True)
class Thing:
    """A rectangle with a name that stands at one of several places: a door's leaf, or a box.

    Attributes
    ----------
    name : str
    kind : "hinged", "sliding" or "box"
        Leaves swing or slide from place to place; a box is carried, and gone while it is on the way.
    length_m, thickness_m : float, metres
        A hinged leaf turns about one of its corners: the pin lies on the face that leads when it opens, and
        the thickness behind it, so that an open leaf can
        stand flush with its jamb. A sliding leaf starts at its pose and is centred across
        itself; a box has its pose at its middle.
    places : dict of name -> (x, y, theta), metres, metres, radians
        For a hinged leaf, x and y are the hinge. The first place is where it counts as closed.
    schedule : Schedule
    initial : str, optional
        Default: the first place.
    move_s : float, seconds
        From any place to any other.
    """

    name: str
    kind: Kind
    length_m: float
    thickness_m: float
    places: dict[str, Pose] = field(hash=False)
    schedule: Schedule = field(default_factory=Never)
    initial: str = ""
    move_s: float = 1.0

    def __post_init__(self) -> None:
        if not (0 < self.length_m < math.inf and 0 < self.thickness_m < math.inf and 0 < self.move_s < math.inf):
            raise WorldError(
                f"{self.label}: length_m = {self.length_m!r}, thickness_m = {self.thickness_m!r}, move_s ="
                f" {self.move_s!r}; wanted all three above 0"
            )
        if not self.places:
            raise WorldError(f"{self.label}.places is empty; wanted one place or more")
        if "moving" in self.places:
            raise WorldError(f'{self.label}.places: "moving" is what it does between places; wanted another name')
        if not self.initial:
            object.__setattr__(self, "initial", next(iter(self.places)))
        for key, name in [("initial", self.initial), *(("schedule", name) for name in self.schedule.named())]:
            if name not in self.places:
                raise WorldError(f"{self.label}.{key} names {name!r}; wanted one of {', '.join(self.places)}")

    @property
    def label(self) -> str:
        """How messages call it: the key of its table in a file."""
        return f"{'box' if self.kind == 'box' else 'door'}.{self.name}"

    @property
    def rectangle(self) -> NDArray[np.float64]:
        """Its corners in its own frame, (4, 2) metres."""
        length, thick = self.length_m, self.thickness_m
        if self.kind == "box":
            x0, x1, y0, y1 = -length / 2, length / 2, -thick / 2, thick / 2
        elif self.kind == "sliding":
            x0, x1, y0, y1 = 0.0, length, -thick / 2, thick / 2
        else:
            angles = [theta for _, _, theta in self.places.values()]
            opens_left = len(angles) > 1 and angles[1] > angles[0]
            x0, x1, y0, y1 = 0.0, length, 0.0, -thick if opens_left else thick
        return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])

    def corners(self, place: str) -> NDArray[np.float64]:
        """Its corners at a place, (4, 2) metres."""
        if place not in self.places:
            raise WorldError(f"{self.label} has no place {place!r}; wanted one of {', '.join(self.places)}")
        return placed(self.rectangle, self.places[place])


@dataclass(frozen=True)
class Crowd:
    """People who walk between goals, each with a speed and a mind of their own.

    Attributes
    ----------
    number : int
    speed_m_s : (low, high), metres per second
        Each person's is drawn evenly in between.
    turn_rate_hz : (low, high), per second
        How often a person changes direction.
    pause_s : float, seconds
        Mean length of a pause; people make one at half of their goals.
    radius_m : float, metres
    legs : bool
        Whether the laser sees two legs (see `legs.py`) of everybody rather than a disc of `radius_m`.
    goals : tuple of (x, y), metres
        Where they go. Default: anywhere.
    tracks : tuple of Track
        People beside them who are replayed, and mind nobody.
    """

    number: int = 0
    speed_m_s: tuple[float, float] = (0.05, 1.5)
    turn_rate_hz: tuple[float, float] = (0.02, 0.3)
    pause_s: float = 8.0
    radius_m: float = 0.25
    legs: bool = False
    goals: tuple[Point, ...] = ()
    tracks: tuple[Track, ...] = ()

    def __post_init__(self) -> None:
        if not 0 <= self.number <= 1000:
            raise WorldError(f"people.number = {self.number!r}; wanted 0 to 1000")
        for key, (low, high) in (("speed_m_s", self.speed_m_s), ("turn_rate_hz", self.turn_rate_hz)):
            if not 0 <= low <= high <= 3:
                raise WorldError(f"people.{key} = {[low, high]}; wanted a low and a high value from 0 to 3")
        if not (0 <= self.pause_s < math.inf and 0.05 <= self.radius_m <= 1):
            raise WorldError(
                f"people.pause_s = {self.pause_s!r}, radius_m = {self.radius_m!r}; wanted seconds of 0 or more,"
                " and a radius from 0.05 to 1 m"
            )
        if self.legs and self.radius_m < SMALLEST_BODY_M:
            raise WorldError(
                f"people.radius_m = {self.radius_m!r} is too narrow for people.legs; wanted"
                f" {SMALLEST_BODY_M:g} or more"
            )


@dataclass(frozen=True)
class Route:
    """A differential drive that turns towards each waypoint and drives there, over and over.

    It stops while somebody or a leaf is within `stop_m` ahead of it.

    Attributes
    ----------
    waypoints : tuple of (x, y), metres
        Of the laser, which sits on the robot's axis. A single one: it stands still.
    back_and_forth : bool
        From the last waypoint back over the others; else straight back to the first.
    speed_m_s, turn_rad_s : float
        The most it does.
    radius_m, stop_m : float, metres
    heading_rad : float, radians
        Where it looks if it stands still.
    """

    waypoints: tuple[Point, ...]
    back_and_forth: bool = True
    speed_m_s: float = 0.5
    turn_rad_s: float = math.pi / 2
    radius_m: float = 0.3
    stop_m: float = 0.2
    heading_rad: float = 0.0

    def __post_init__(self) -> None:
        if not self.waypoints:
            raise WorldError("robot.waypoints is empty; wanted one point or more")
        for key in ("speed_m_s", "turn_rad_s", "radius_m"):
            if not 0 < getattr(self, key) < math.inf:
                raise WorldError(f"robot.{key} = {getattr(self, key)!r}; wanted a number above 0")
        if not 0 <= self.stop_m < math.inf:
            raise WorldError(f"robot.stop_m = {self.stop_m!r}; wanted metres of 0 or more")
        for k, (point, following) in enumerate(pairwise(self.waypoints)):
            if point == following:
                raise WorldError(f"robot.waypoints: numbers {k} and {k + 1} are both {point}; wanted them to differ")

    @property
    def round_trip(self) -> tuple[Point, ...]:
        """The waypoints of one round; after the last comes the first again."""
        if len(self.waypoints) < 3 or not self.back_and_forth:
            return self.waypoints
        return (*self.waypoints, *self.waypoints[-2:0:-1])


@dataclass(frozen=True)
class Laser:
    """A planar range finder that takes the beams of a scan one after the other, or all at one moment.

    Attributes
    ----------
    n_beams : int
    fov_rad : float, radians
        Angle from the first beam to the last, centred on straight ahead.
    rate_hz : float, scans per second
    max_range_m : float, metres
        What lies at or beyond it gives no return.
    sigma_m : float, metres
        Standard deviation of the Gaussian noise on each range.
    dropout : float, 0..1
        Share of the returns that are lost.
    sweep_s : float, seconds
        From the first beam to the last; at most the time between scans. The laser moves on in the meantime,
        but a scan carries the pose of its first beam, as logs do. Everybody else is taken to stand still.
    """

    n_beams: int = 181
    fov_rad: float = math.pi
    rate_hz: float = 10.0
    max_range_m: float = 8.0
    sigma_m: float = 0.01
    dropout: float = 0.005
    sweep_s: float = 0.0

    def __post_init__(self) -> None:
        if not (self.n_beams >= 1 and self.rate_hz > 0 and self.max_range_m > 0):
            raise ConfigError(
                f"a laser of n_beams = {self.n_beams!r}, rate_hz = {self.rate_hz!r} and max_range_m ="
                f" {self.max_range_m!r}; wanted all three above 0"
            )
        if not (self.sigma_m >= 0 and 0 <= self.dropout <= 1):
            raise ConfigError(
                f"a laser of sigma_m = {self.sigma_m!r} and dropout = {self.dropout!r}; wanted a noise of 0 m"
                " or more and a share in 0..1"
            )

        if not 0 <= self.sweep_s * self.rate_hz <= 1 + 1e-9:
            raise ConfigError(
                f"a laser of sweep_s = {self.sweep_s!r} that takes {self.rate_hz:g} scans a second; wanted 0 to"
                f" {1 / self.rate_hz:g} s"
            )

    @cached_property
    def angles(self) -> NDArray[np.float64]:
        """(n_beams,) radians in the laser frame, from right to left."""
        if self.n_beams == 1:
            return np.zeros(1)
        return np.linspace(-self.fov_rad / 2, self.fov_rad / 2, self.n_beams)

    @cached_property
    def shares(self) -> NDArray[np.float64]:
        """(n_beams,) how far the sweep is when each beam is taken, 0..1."""
        return np.linspace(0.0, 1.0, self.n_beams)


@dataclass(frozen=True)
class PoseError:
    """How far the poses that scans carry are from the true ones.

    Attributes
    ----------
    white_m, white_rad : float
        Standard deviation of an error drawn anew for each scan.
    drift_m, drift_rad : float
        Standard deviation of an error that wanders slowly about zero.
    drift_s : float, seconds
        Time in which the drift forgets itself (to 1/e).
    """

    white_m: float = 0.0
    white_rad: float = 0.0
    drift_m: float = 0.0
    drift_rad: float = 0.0
    drift_s: float = 60.0

    def __post_init__(self) -> None:
        for key in ("white_m", "white_rad", "drift_m", "drift_rad"):
            if not 0 <= getattr(self, key) < math.inf:
                raise WorldError(f"pose_error.{key} = {getattr(self, key)!r}; wanted 0 or more")
        if not 0 < self.drift_s < math.inf:
            raise WorldError(f"pose_error.drift_s = {self.drift_s!r}; wanted seconds above 0")


@dataclass(frozen=True)
class World:
    """Everything `simulate` needs; built in Python, or read by `load_world`.

    Raises
    ------
    WorldError
        A wall without area, two things of one name, a route that leads through a wall, a goal that cannot
        be reached, a place of a thing at a waypoint, or one that a thing finally keeps across the route.
    """

    robot: Route
    walls: tuple[Wall, ...] = ()
    things: tuple[Thing, ...] = ()
    people: Crowd = Crowd()
    laser: Laser = field(default_factory=Laser)
    pose_error: PoseError = PoseError()
    duration_s: float = 60.0
    name: str = ""
    glass: tuple[Glass, ...] = ()

    def __post_init__(self) -> None:
        if not 0 < self.duration_s < math.inf:
            raise WorldError(f"duration_s = {self.duration_s!r}; wanted seconds above 0")
        for k, wall in enumerate(self.walls):
            check_wall(wall.corners, f"wall {k}")
        names = [thing.label for thing in self.things]
        for thing in self.things:
            if names.count(thing.label) > 1:
                raise WorldError(f"{thing.label} is there twice; wanted every name once")
        self._check_waypoints()
        if self.people.goals:
            Room(self).goal_cells(self.people.goals)

    @property
    def solids(self) -> list[tuple[str, NDArray[np.float64]]]:
        """Everything that never moves and lets nobody through: what it is, and its corners (n_corners, 2)."""
        walls = [("wall", np.array(wall.corners)) for wall in self.walls]
        return walls + [("glass", pane.corners) for pane in self.glass]

    def _check_waypoints(self) -> None:
        robot = self.robot
        stops = robot.round_trip
        legs = list(zip(stops, (*stops[1:], stops[0]), strict=True))
        for what, corners in self.solids:
            for k, point in enumerate(robot.waypoints):
                if (gap := disc_gap(point, corners)) < robot.radius_m:
                    raise WorldError(
                        f"robot.waypoints: number {k}, {point}, is {gap:.2f} m from the {what} around"
                        f" {middle_text(corners)}; wanted {robot.radius_m:g} m, the robot's radius, or more"
                    )
            for start, end in legs:
                if (gap := leg_gap(start, end, corners)) < robot.radius_m:
                    raise WorldError(
                        f"robot.waypoints: the way from {start} to {end} is {gap:.2f} m from the {what} around"
                        f" {middle_text(corners)}; wanted {robot.radius_m:g} m, the robot's radius, or more"
                    )
        for thing in self.things:
            used = [thing.initial, *thing.schedule.named()]
            for place in thing.places:
                for k, point in enumerate(robot.waypoints):
                    if place in used and disc_gap(point, thing.corners(place)) < robot.radius_m:
                        raise WorldError(
                            f"{thing.label}.schedule puts it at {place!r}, {middle_text(thing.corners(place))}, onto"
                            f" the robot at waypoint {k}, {point}; wanted {robot.radius_m:g} m or more apart"
                        )
            last = thing.schedule.rests_at(thing.initial)
            for start, end in legs if len(stops) > 1 else []:
                if last and leg_gap(start, end, thing.corners(last)) < robot.radius_m + GAP_M:
                    raise WorldError(
                        f"{thing.label}.schedule leaves it at {last!r}, {middle_text(thing.corners(last))}, for good;"
                        f" the robot could never pass from {start} to {end}. Wanted {robot.radius_m + GAP_M:g} m or"
                        " more beside its way, or a schedule that goes on"
                    )
