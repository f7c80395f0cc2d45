"""What a simulated world consists of. Metres and radians in the map frame, seconds since its start."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tempog.errors import ConfigError

Point = tuple[float, float]
RestState = Literal["closed", "open"]
DoorState = Literal["closed", "open", "moving"]


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
class Door:
    """A hinged leaf that swings between two angles at the given times, at a constant rate.

    Attributes
    ----------
    hinge : (x, y) metres
        The pin, at the end of the leaf and on the face that leads when the door opens. The thickness lies
        behind that face, so an open leaf can stand flush with its jamb.
    closed_rad, open_rad : float, radians
        Direction from the hinge along that face.
    length_m, thickness_m : float, metres
    schedule : tuple of (t, state)
        When the leaf starts to move (seconds), and to which state, "open" or "closed". Between two of
        these lies at least one swing.
    swing_s : float, seconds
        Time from one state to the other.
    initial : "closed" or "open"

    Examples
    --------
    >>> door = Door((0.0, 0.0), closed_rad=0.0, open_rad=np.pi / 2, schedule=((5.0, "open"),))
    >>> door.states(duration_s=10.0)
    [(0.0, 'closed'), (5.0, 'moving'), (6.0, 'open')]
    >>> np.rad2deg(door.angles(5.5)).round().item()
    45.0
    """

    hinge: Point
    closed_rad: float
    open_rad: float
    length_m: float = 0.9
    thickness_m: float = 0.05
    schedule: tuple[tuple[float, RestState], ...] = ()
    swing_s: float = 1.0
    initial: RestState = "closed"

    def __post_init__(self) -> None:
        if not (self.length_m > 0 and self.thickness_m > 0 and self.swing_s > 0):
            raise ConfigError(
                f"a door of length_m = {self.length_m!r}, thickness_m = {self.thickness_m!r} and"
                f" swing_s = {self.swing_s!r}; wanted all three above 0"
            )
        if self.closed_rad == self.open_rad:
            raise ConfigError(f"a door stands at {self.open_rad!r} rad both open and closed; wanted two angles")
        if self.schedule and self.schedule[0][0] < 0:
            raise ConfigError(f"a door first moves at {self.schedule[0][0]} s; wanted 0 s or later")
        for (t, _), (t_next, _) in pairwise(self.schedule):
            if t_next < t + self.swing_s:
                raise ConfigError(
                    f"a door moves at {t} s and again at {t_next} s, but a swing takes {self.swing_s} s;"
                    " wanted a schedule in time order, one swing or more apart"
                )
        for (_, state), (t, target) in pairwise([(0.0, self.initial), *self.schedule]):
            if target not in ("open", "closed"):
                raise ConfigError(f'a door is to be {target!r} from {t} s; wanted "open" or "closed"')
            if target == state:
                raise ConfigError(f"a door that is {state} is to be {state} from {t} s; wanted them in turn")

    def rest_angle(self, state: RestState) -> float:
        """Angle of the leaf when it stands still; radians."""
        if state not in ("open", "closed"):
            raise ConfigError(f'a door stands still "open" or "closed", not {state!r}')
        return self.open_rad if state == "open" else self.closed_rad

    def angles(self, t: ArrayLike) -> NDArray[np.float64]:
        """Angle of the leaf at the times `t` (any shape, seconds); radians, same shape."""
        times = [0.0]
        angles = [self.rest_angle(self.initial)]
        for start, state in self.schedule:
            times += [start, start + self.swing_s]
            angles += [angles[-1], self.rest_angle(state)]
        return np.asarray(np.interp(np.asarray(t, dtype=np.float64), times, angles))

    def states(self, duration_s: float) -> list[tuple[float, DoorState]]:
        """The door's state from 0 to `duration_s`, as (t, state from then on); seconds."""
        changes: list[tuple[float, DoorState]] = [(0.0, self.initial)]
        for start, state in self.schedule:
            changes += [(start, "moving"), (start + self.swing_s, state)]
        return [
            (t, state)
            for (t, state), (t_next, _) in pairwise([*changes, (math.inf, self.initial)])
            if t < duration_s and t_next > t  # a state that ends as it begins never was
        ]

    def leaf_corners(self, angle: float) -> NDArray[np.float64]:
        """Corners of the leaf at `angle` (radians); (4, 2) metres, the hinge first."""
        ahead = np.array([math.cos(angle), math.sin(angle)])
        left = np.array([-ahead[1], ahead[0]])
        behind = -left if self.open_rad > self.closed_rad else left
        hinge = np.array(self.hinge)
        tip = hinge + self.length_m * ahead
        back = self.thickness_m * behind
        return np.array([hinge, tip, tip + back, hinge + back])


@dataclass(frozen=True)
class Person:
    """A disc that walks a path there and back without end.

    Attributes
    ----------
    path : tuple of (x, y), metres
    speed_m_s : float, metres per second
    radius_m : float, metres
    start_s : float, seconds
        Stands at the start of the path until then. May be negative: already on the way.

    Examples
    --------
    >>> walker = Person(path=((0.0, 0.0), (10.0, 0.0)), speed_m_s=1.0)
    >>> walker.positions([4.0, 13.0]).tolist()
    [[4.0, 0.0], [7.0, 0.0]]
    """

    path: tuple[Point, ...]
    speed_m_s: float = 1.0
    radius_m: float = 0.25
    start_s: float = 0.0

    def __post_init__(self) -> None:
        if not (self.path and self.speed_m_s > 0 and self.radius_m > 0):
            raise ConfigError(
                f"a person of radius_m = {self.radius_m!r} walks {len(self.path)} points at speed_m_s ="
                f" {self.speed_m_s!r}; wanted one point or more, and the others above 0"
            )

    def positions(self, t: ArrayLike) -> NDArray[np.float64]:
        """Where the person is at the times `t` (any shape, seconds); (..., 2) metres."""
        points = np.asarray(self.path, dtype=np.float64)
        walked = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        length = walked[-1]
        distance = self.speed_m_s * np.maximum(np.asarray(t, dtype=np.float64) - self.start_s, 0.0)
        if length > 0:
            distance = length - abs(length - distance % (2 * length))
        return np.stack(
            [np.interp(distance, walked, points[:, 0]), np.interp(distance, walked, points[:, 1])], axis=-1
        )


@dataclass(frozen=True)
class Robot:
    """Drives a path there and back without end, looking ahead, and turns on the spot at its corners.

    Attributes
    ----------
    path : tuple of (x, y), metres
        Of the laser, which sits on the robot's axis. With a single point the robot stands still.
    speed_m_s : float, metres per second
    turn_rad_s : float, radians per second
    radius_m : float, metres
        Room the robot takes up. Nothing in the simulation stops it: the path must keep clear.
    heading_rad : float, radians
        Where a robot that stands still looks; otherwise unused.
    """

    path: tuple[Point, ...]
    speed_m_s: float = 0.5
    turn_rad_s: float = math.pi / 2
    radius_m: float = 0.3
    heading_rad: float = 0.0

    def __post_init__(self) -> None:
        if not (self.path and self.speed_m_s > 0 and self.turn_rad_s > 0 and self.radius_m > 0):
            raise ConfigError(
                f"a robot of radius_m = {self.radius_m!r} drives {len(self.path)} points at speed_m_s ="
                f" {self.speed_m_s!r} and turn_rad_s = {self.turn_rad_s!r}; wanted one point or more, and"
                " the others above 0"
            )
        for point, following in pairwise(self.path):
            if point == following:
                raise ConfigError(f"the robot's path stays at {point}; wanted every point to differ from the next")

    def poses(self, t: ArrayLike) -> NDArray[np.float64]:
        """Poses of the laser in the map frame at the times `t` (any shape, seconds).

        Returns
        -------
        (..., 3) float64
            x, y, theta; metres, metres, radians in -π..π.
        """
        t = np.asarray(t, dtype=np.float64)
        if len(self.path) == 1:
            return np.broadcast_to([*self.path[0], self.heading_rad], (*t.shape, 3)).copy()
        times, poses = self._one_round()
        in_round = t % times[-1]
        x, y, theta = (np.interp(in_round, times, column) for column in poses.T)
        return np.stack([x, y, np.arctan2(np.sin(theta), np.cos(theta))], axis=-1)

    def _one_round(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times (n,) and poses (n, 3) between which a round is linear; theta is not wrapped."""
        way = [*self.path, *self.path[-2::-1]]
        legs = [(x1, y1, x1 - x0, y1 - y0) for (x0, y0), (x1, y1) in pairwise(way)]
        headings = [math.atan2(dy, dx) for _, _, dx, dy in legs]
        t, theta = 0.0, headings[0]
        times = [t]
        poses = [(*way[0], theta)]
        for (x, y, dx, dy), next_heading in zip(legs, headings[1:] + headings[:1], strict=True):
            t += math.hypot(dx, dy) / self.speed_m_s
            times.append(t)
            poses.append((x, y, theta))
            turn = (next_heading - theta + math.pi) % (2 * math.pi) - math.pi
            t += abs(turn) / self.turn_rad_s
            theta += turn
            times.append(t)
            poses.append((x, y, theta))
        return np.array(times), np.array(poses)


@dataclass(frozen=True)
class Laser:
    """A planar range finder that takes all beams of a scan at one moment.

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
    """

    n_beams: int = 181
    fov_rad: float = math.pi
    rate_hz: float = 10.0
    max_range_m: float = 8.0
    sigma_m: float = 0.01
    dropout: float = 0.005

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

    @property
    def angles(self) -> NDArray[np.float64]:
        """(n_beams,) radians in the laser frame, from right to left."""
        if self.n_beams == 1:
            return np.zeros(1)
        return np.linspace(-self.fov_rad / 2, self.fov_rad / 2, self.n_beams)


@dataclass(frozen=True)
class World:
    """Everything that a simulation needs to know; `duration_s` is how long it runs unless told otherwise."""

    robot: Robot
    walls: tuple[Wall, ...] = ()
    doors: tuple[Door, ...] = ()
    people: tuple[Person, ...] = ()
    laser: Laser = Laser()
    duration_s: float = 60.0
