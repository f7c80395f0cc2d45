"""What a simulation gives: scans, and the truth behind every beam."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tempog.errors import WorldError
from tempog.scans.scan import Scan
from tempog.simulation.polygons import covered_cells, outline
from tempog.simulation.world import Laser, World

START_S = 1_750_000_000  # s, Unix: every simulation starts on 15 June 2025, 15:06:40 UTC
MOVING = -1  # instead of a place


class Hit(IntEnum):
    """What a beam has hit."""

    NOTHING = 0
    WALL = 1
    DOOR = 2
    PERSON = 3
    BOX = 4
    GLASS = 5


@dataclass(frozen=True, eq=False)
class Simulation:
    """Scans of a simulated drive, and the truth about them.

    Attributes
    ----------
    world : World
    duration_s : float, seconds
    scans : list of Scan
        With noise and drop-outs, and with the world's pose error.
    t : (n_scans,) float64, seconds
        Since the start of the simulation; the scans' own clock starts at `START_S`.
    poses : (n_scans, 3) float64
        True pose of the laser at t: x, y, theta; metres, metres, radians.
    sweep_ends : (n_scans, 3) float64
        True pose at the end of each sweep, `Laser.sweep_s` later. In between it moves evenly.
    distances : (n_scans, n_beams) float64, metres
        Without noise and drop-outs; +inf where there is nothing within the laser's range.
    hits : (n_scans, n_beams) uint8
        What each beam has hit (`Hit`), also where the return was lost.
    hit_things : (n_scans, n_beams) int16
        Which of `world.things` it has hit, or -1.
    places : (n_scans, n_things) int16
        At which of its places each thing stands, or `MOVING`.
    corners : (n_scans, n_things, 4, 2) float64, metres
        NaN while a box is carried.
    people : (n_scans, n_people, 2) float64, metres
        Walkers first, then those who are replayed, NaN while they are absent.
    legs : (n_scans, n_people, 2, 2) float64, metres, or None
        Middles of left and right leg, discs of `LEG_RADIUS_M`; None where people are discs of `Crowd.radius_m`.
    """

    world: World
    duration_s: float
    scans: list[Scan]
    t: NDArray[np.float64]
    poses: NDArray[np.float64]
    sweep_ends: NDArray[np.float64]
    distances: NDArray[np.float64]
    hits: NDArray[np.uint8]
    hit_things: NDArray[np.int16]
    places: NDArray[np.int16]
    corners: NDArray[np.float64]
    people: NDArray[np.float64]
    legs: NDArray[np.float64] | None = None

    def beams(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where each beam truly starts, (n_scans, n_beams, 2) metres, and its direction, (n_scans, n_beams) radians.

        Both are in the map frame.
        """
        return beams_of(self.world.laser, self.poses, self.sweep_ends)

    @property
    def end_points(self) -> NDArray[np.float64]:
        """Where each beam truly ends in the map frame, (n_scans, n_beams, 2) metres; NaN where it hits nothing."""
        starts, angles = self.beams()
        distances = np.where(np.isfinite(self.distances), self.distances, np.nan)
        return np.asarray(starts + distances[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1))

    def states(self, name: str) -> list[tuple[float, str]]:
        """A thing's states as (t, state from then on), of places' names and "moving".

        t is in seconds of the scans' clock, that of the first scan with the state.
        """
        k = self._index(name)
        names = list(self.world.things[k].places)
        column = self.places[:, k]
        firsts = [0, *(np.flatnonzero(np.diff(column)) + 1).tolist()]
        return [(START_S + float(self.t[i]), "moving" if column[i] == MOVING else names[column[i]]) for i in firsts]

    def cells(self, name: str, place: str, resolution_m: float) -> NDArray[np.int64]:
        """The cells that a thing covers at a place; (n_cells, 2) [row, col], see `covered_cells`."""
        return covered_cells(self.world.things[self._index(name)].corners(place), resolution_m)

    def segments(self, name: str, place: str) -> NDArray[np.float64]:
        """The four faces of a thing at a place; (4, 4) metres: x0, y0, x1, y1."""
        return outline(self.world.things[self._index(name)].corners(place))

    def static_cells(self, resolution_m: float) -> NDArray[np.int64]:
        """The cells that walls (not glass) cover, inside included; (n_cells, 2) [row, col], sorted, each once."""
        cells = [covered_cells(wall.corners, resolution_m) for wall in self.world.walls]
        return np.unique(np.concatenate([np.empty((0, 2), dtype=np.int64), *cells]), axis=0)

    def _index(self, name: str) -> int:
        for k, thing in enumerate(self.world.things):
            if name in (thing.name, thing.label):
                return k
        names = ", ".join(thing.name for thing in self.world.things) or "nothing"
        raise WorldError(f"there is no {name!r} in this world; wanted one of {names}")


def beams_of(
    laser: Laser, poses: NDArray[np.float64], sweep_ends: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Starts (..., n_beams, 2) and directions (..., n_beams) of beams in the map frame, from poses (..., 3)."""
    x, y, theta = poses[..., None, 0], poses[..., None, 1], poses[..., None, 2] + laser.angles
    if laser.sweep_s:
        moved = laser.shares[:, None] * turned(sweep_ends - poses)[..., None, :]
        x, y, theta = x + moved[..., 0], y + moved[..., 1], theta + moved[..., 2]
    starts = np.empty((*theta.shape, 2))
    starts[..., 0], starts[..., 1] = x, y
    return starts, theta


def turned(step: NDArray[np.float64]) -> NDArray[np.float64]:
    """The difference (..., 3) of two poses, the turn being the shorter one."""
    return np.concatenate([step[..., :2], (step[..., 2:] + np.pi) % (2 * np.pi) - np.pi], axis=-1)
